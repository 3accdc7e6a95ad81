"""Workers of a sweep: processes of this machine, or those of dask.distributed."""

import gc
import logging
import multiprocessing
import os
import threading
import time
from concurrent.futures import BrokenExecutor, CancelledError, Future, ProcessPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from itertools import count
from multiprocessing.context import SpawnContext
from multiprocessing.process import BaseProcess
from typing import Any

from crinoid.foundation.child_processes import signals_blocked
from crinoid.studies.sweep.engine import DIED, BatchFuture, Work, WorkerPoolError, perform

_MOST_STILLBORN = 3  # workers that may die before they are ready
_LAST_MOMENT = 1.0  # time that a process has to end once it does not answer (s)
_ANSWER = 15.0  # time that a scheduler has to answer (s)
_LOOK = 1.0  # time between two looks at the workers of a scheduler (s)


class _Context(SpawnContext):  # a fork of JAX's threads may hang
    """A context that remembers the process it starts."""

    process: BaseProcess

    def Process(self, *arguments: Any, **options: Any) -> Any:  # type: ignore[override]
        """Return a process."""
        self.process = super().Process(*arguments, **options)
        return self.process


@dataclass
class _Worker:
    """An executor of one process: where one dies, the other workers go on."""

    executor: ProcessPoolExecutor
    process: BaseProcess
    ready: Future[None]
    future: Future[Any]  # the latest task

    @property
    def is_ready(self) -> bool:
        """Whether it has started."""
        return self.ready.done() and self.ready.exception() is None

    @property
    def dead(self) -> bool:
        """Whether it died, and its task knows."""
        if not self.future.done() or self.future.cancelled():
            return False
        broken = isinstance(self.future.exception(), BrokenExecutor)
        return broken or self.process.exitcode is not None


class Processes:
    """Workers that are processes of this machine, each on one core."""

    def __init__(self, number: int) -> None:
        self._names = map(str, count(1))
        self._all: dict[str, _Worker] = {}
        self._ended: dict[str, BaseProcess] = {}
        self._stillborn = 0
        for _ in range(number):
            self._start()

    def workers(self) -> dict[str, int]:
        """Return the workers; each has one thread."""
        for name, worker in list(self._all.items()):
            if not worker.dead:
                continue
            self._stillborn += not worker.is_ready
            self.replace(name)
            if self._stillborn > _MOST_STILLBORN:
                raise WorkerPoolError(f"workers do not start{self._how(name)}")
        return {name: 1 for name, worker in self._all.items() if worker.is_ready}

    def submit(self, worker: str, work: Work) -> BatchFuture:
        """Run a batch on an idle worker."""
        found: BatchFuture
        try:
            found = self._all[worker].executor.submit(perform, work)
        except BrokenExecutor as error:  # it died a moment ago
            found = Future()
            found.set_exception(error)
        self._all[worker].future = found
        return found

    def death(self, worker: str, error: BaseException) -> str:
        """Return how a process died."""
        return f"{DIED}{self._how(worker)}" if isinstance(error, BrokenExecutor) else ""

    def replace(self, worker: str) -> None:
        """Kill a worker, and start another one."""
        self._end(worker)
        self._start()

    def close(self) -> None:
        """Kill all workers, and wait until their semaphores are released."""
        for name in list(self._all):
            self._end(name, wait=True)
        gc.collect()

    def _start(self) -> None:
        context = _Context()
        executor = ProcessPoolExecutor(1, context, _leave_with_parent)
        with signals_blocked():
            ready = executor.submit(_get_ready)
        self._all[next(self._names)] = _Worker(executor, context.process, ready, ready)

    def _end(self, name: str, *, wait: bool = False) -> None:
        worker = self._all.pop(name)
        worker.process.kill()
        worker.executor.shutdown(wait, cancel_futures=True)
        worker.process.join(_LAST_MOMENT)
        self._ended[name] = worker.process

    def _how(self, name: str) -> str:
        process = self._all[name].process if name in self._all else self._ended[name]
        process.join(_LAST_MOMENT)
        code = process.exitcode
        if code is None:
            return ""
        return f" (signal {-code})" if code < 0 else f" (exit code {code})"


def _get_ready() -> None:
    """Show that a worker answers: this module, and with it JAX, is loaded."""


def _leave_with_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None

    def wait() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=wait, daemon=True).start()


class Cluster:
    """Workers of the scheduler of dask.distributed at an address."""

    def __init__(self, address: str) -> None:
        import distributed

        self._address = address
        self._known: dict[str, int] = {}
        self._looked = 0.0
        self._abandoned: set[str] = set()
        logging.getLogger("distributed.client").setLevel(logging.CRITICAL)  # reported here
        with signals_blocked():
            try:
                self._client = distributed.Client(address, timeout=_ANSWER, set_as_default=False)
            except (OSError, ValueError, TypeError) as error:
                text = " ".join(str(error).split())
                raise WorkerPoolError(f"no scheduler answers at {address} ({text})") from error

    def workers(self) -> dict[str, int]:
        """Return the workers that the scheduler has now, without those that hang."""
        self._require()
        if time.monotonic() - self._looked > _LOOK:
            found = self._client.scheduler_info(n_workers=-1)["workers"]
            self._known = {name: int(about["nthreads"]) for name, about in found.items()}
            self._abandoned &= self._known.keys()
            self._looked = time.monotonic()
        return {name: self._known[name] for name in sorted(self._known.keys() - self._abandoned)}

    def submit(self, worker: str, work: Work) -> BatchFuture:
        """Send a batch to that worker and no other."""
        executor = self._client.get_executor(workers=[worker], pure=False)
        found: BatchFuture = executor.submit(perform, work)
        return found

    def death(self, worker: str, error: BaseException) -> str:
        """Return that a worker died: the scheduler says so, or lost the batch."""
        from distributed.scheduler import KilledWorker

        if not isinstance(error, (CancelledError, KilledWorker)):
            return ""
        self._require()
        self._looked = 0.0
        return DIED

    def replace(self, worker: str) -> None:
        """Let its nanny end a worker; one without a nanny gets no more work."""
        self._abandoned.add(worker)
        with suppress(Exception):  # it gets no more work in any case
            self._client.restart_workers([worker], timeout=_ANSWER, raise_for_error=False)

    def close(self) -> None:
        """Leave the scheduler, and its workers alone."""
        with suppress(Exception):  # it may be gone already
            self._client.close(timeout=_ANSWER)

    def _require(self) -> None:
        if self._client.status != "running":
            raise WorkerPoolError(f"the scheduler at {self._address} went away")
