"""Workers that are processes of this machine."""

import multiprocessing
import os
import threading
from contextlib import suppress
from itertools import count
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import Any, NamedTuple

from crinoid.sweep.crew import DIED, CrewError, Ended, unheard
from crinoid.sweep.work import Work, perform

__all__ = ["Processes"]

_READY = "ready"
_MOST_STILLBORN = 3
"""Workers that may die before they are ready."""
_LAST_MOMENT = 1.0
"""Time that a process has to end after its pipe is closed (s)."""


class _Worker(NamedTuple):
    process: BaseProcess
    pipe: Connection


class Processes:
    """Workers that are processes of this machine, each on one core.

    Parameters
    ----------
    number
        How many.
    """

    def __init__(self, number: int) -> None:
        self._context = multiprocessing.get_context("spawn")  # a fork of JAX's threads may hang
        self._names = map(str, count(1))
        self._all: dict[str, _Worker] = {}
        self._idle: set[str] = set()
        self._starting: set[str] = set()
        self._stillborn = 0
        for _ in range(number):
            self._add()

    def workers(self) -> dict[str, int]:
        """Return the workers that wait for work."""
        return dict.fromkeys(sorted(self._idle), 1)

    def give(self, worker: str, work: Work) -> None:
        """Send a batch; that a worker died in between is told by `ended`."""
        self._idle.discard(worker)
        with suppress(OSError):
            self._all[worker].pipe.send(work)

    def ended(self, seconds: float) -> list[Ended]:
        """Wait for answers, and for processes that die."""
        by_pipe = {worker.pipe: name for name, worker in self._all.items()}
        found = []
        for pipe in wait(list(by_pipe), seconds):
            assert isinstance(pipe, Connection)
            name = by_pipe[pipe]
            try:
                answer = pipe.recv()
            except (EOFError, OSError):
                found += self._lost(name)
                continue
            self._idle.add(name)
            if name in self._starting:
                self._starting.discard(name)
            else:
                found.append(Ended(name, *answer))
        return found

    def replace(self, worker: str) -> None:
        """Kill a worker, and start another one."""
        self._end(worker)
        self._add()

    def close(self) -> None:
        """Kill all workers."""
        for name in list(self._all):
            self._end(name)

    def _add(self) -> None:
        ours, theirs = self._context.Pipe()
        process = self._context.Process(target=_serve, args=(theirs,), daemon=True)
        with unheard():
            process.start()
        theirs.close()  # so that its end is seen here
        name = next(self._names)
        self._all[name] = _Worker(process, ours)
        self._starting.add(name)

    def _end(self, name: str) -> int | None:
        process, pipe = self._all.pop(name)
        self._idle.discard(name)
        process.kill()
        process.join()
        pipe.close()
        return process.exitcode

    def _lost(self, name: str) -> list[Ended]:
        """Replace a worker that died; raise where none of them can begin."""
        worked, waited = name not in self._starting, name in self._idle
        self._starting.discard(name)
        self._all[name].process.join(_LAST_MOMENT)  # its pipe may be gone before it is
        code = self._end(name)
        how = f"signal {-code}" if code and code < 0 else f"exit code {code}"
        if not worked:
            self._stillborn += 1
            if self._stillborn > _MOST_STILLBORN:
                raise CrewError(f"workers do not start ({how})")
        self._add()
        return [Ended(name, None, f"{DIED} ({how})")] if worked and not waited else []


def _serve(pipe: Connection) -> None:
    """Run batches until there is nobody to send any."""
    threading.Thread(target=_leave_with_parent, daemon=True).start()
    pipe.send(_READY)
    while True:
        try:
            work = pipe.recv()
        except EOFError:
            return
        answer: tuple[Any, str]
        try:
            answer = (perform(work), "")
        except Exception as error:  # of whatever kind: the sweep is told, and goes on
            answer = (None, f"{type(error).__name__}: {' '.join(str(error).split())}")
        pipe.send(answer)


def _leave_with_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)
