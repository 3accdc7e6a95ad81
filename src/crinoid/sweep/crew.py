"""Workers of a sweep: whoever runs batches, one at a time each."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import resource_tracker
from typing import Protocol, runtime_checkable

from crinoid.sweep.work import Row, Work

__all__ = ["DIED", "Crew", "CrewError", "Ended", "unheard"]

DIED = "its worker died"


class CrewError(RuntimeError):
    """There is nobody to go on with: a scheduler that is gone, workers that cannot start."""


@dataclass(frozen=True)
class Ended:
    """A batch is over: with its rows, or the reason why there are none."""

    worker: str
    rows: list[Row] | None
    reason: str = ""


@runtime_checkable
class Crew(Protocol):
    """Workers, by their names. A worker that dies is replaced by another one, of another name."""

    def workers(self) -> dict[str, int]:
        """Return how many threads each worker has that can be given work."""
        ...

    def give(self, worker: str, work: Work) -> None:
        """Let an idle worker run a batch."""
        ...

    def ended(self, seconds: float) -> list[Ended]:
        """Wait for a batch to be over, no longer than some seconds, and return those that are."""
        ...

    def replace(self, worker: str) -> None:
        """End a worker that hangs, whatever it does."""
        ...

    def close(self) -> None:
        """End all workers of one's own, whatever they do."""
        ...


@contextmanager
def unheard() -> Iterator[None]:
    """Keep Ctrl-C and the end of the terminal from processes and threads that begin meanwhile.

    They come to all programs of a terminal; only the sweep itself is to answer them, afterwards.
    """
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    resource_tracker.ensure_running()  # which would end by unblocking the signals
    earlier = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGHUP})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, earlier)
