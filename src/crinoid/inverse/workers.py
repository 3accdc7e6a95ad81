"""Threads of a search: their results, while progress is reported."""

from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_EXCEPTION, Future, wait
from typing import TypeVar

_POLL = 0.1
"""Time between two checks of the threads (s)."""

T = TypeVar("T")


def results(futures: Sequence[Future[T]], poll: Callable[[], None]) -> list[T]:
    """Wait for futures, polling meanwhile."""
    waiting = set(futures)
    while waiting:
        done, waiting = wait(waiting, _POLL, FIRST_EXCEPTION)
        poll()
        for future in done:
            future.result()
    return [future.result() for future in futures]
