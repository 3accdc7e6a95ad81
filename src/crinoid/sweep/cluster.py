"""Workers of dask.distributed, on this machine or on many."""

import logging
import queue
import time
from contextlib import suppress

import distributed
from distributed.scheduler import KilledWorker

from crinoid.sweep.crew import DIED, CrewError, Ended, unheard
from crinoid.sweep.work import OtherVersionError, Row, Work, perform

Future = distributed.Future[list[Row]]

__all__ = ["Cluster"]

_ANSWER = 15.0
"""Time that a scheduler has to answer (s)."""
_LOOK = 1.0
"""Time between two looks at which workers there are (s)."""


class Cluster:
    """Workers of dask.distributed.

    Parameters
    ----------
    number
        How many to start on this machine.
    address
        Scheduler whose workers are taken instead.
    """

    def __init__(self, number: int = 1, address: str | None = None) -> None:
        self._own: distributed.LocalCluster | None = None
        self._address = address or "this machine"
        self._futures: dict[str, Future] = {}
        self._done: queue.Queue[tuple[str, Future]] = queue.Queue()
        self._there: dict[str, int] = {}
        self._looked = 0.0
        self._left: set[str] = set()
        self._given = 0
        logging.getLogger("distributed.client").setLevel(logging.CRITICAL)  # it is told here
        with unheard():
            if address is None:
                self._own = distributed.LocalCluster(
                    n_workers=number,
                    threads_per_worker=1,
                    dashboard_address="127.0.0.1:0",  # any free port: several sweeps may run
                    silence_logs=logging.CRITICAL,
                )
            try:
                self._client = distributed.Client(
                    self._own or address, timeout=_ANSWER, set_as_default=False
                )
            except (OSError, ValueError, TypeError) as error:
                text = " ".join(str(error).split())
                raise CrewError(f"no scheduler answers at {address} ({text})") from error

    def workers(self) -> dict[str, int]:
        """Return the workers that wait for work."""
        self._require()
        if time.monotonic() - self._looked > _LOOK:
            found = self._client.scheduler_info(n_workers=-1)["workers"]
            self._there = {name: int(about["nthreads"]) for name, about in found.items()}
            self._left &= self._there.keys()
            self._looked = time.monotonic()
        free = self._there.keys() - self._futures.keys() - self._left
        return {name: self._there[name] for name in sorted(free)}

    def give(self, worker: str, work: Work) -> None:
        """Send a batch to that worker and no other."""
        self._given += 1
        future = self._client.submit(
            perform, work, workers=[worker], pure=False, key=f"crinoid-{self._given}"
        )
        self._futures[worker] = future
        future.add_done_callback(lambda future: self._done.put((worker, future)))

    def ended(self, seconds: float) -> list[Ended]:
        """Wait for a batch to be over, and look for workers that are gone."""
        found = []
        with suppress(queue.Empty):
            worker, future = self._done.get(timeout=seconds)
            if self._futures.get(worker) is future:
                del self._futures[worker]
                found.append(self._outcome(worker, future))
        self._require()
        self.workers()
        for worker in self._futures.keys() - self._there.keys():
            self._drop(worker)
            found.append(Ended(worker, None, DIED))
        return found

    def replace(self, worker: str) -> None:
        """Let its nanny end it; where it has none, leave it alone from now on."""
        self._drop(worker)
        self._left.add(worker)
        with suppress(Exception):  # of whatever kind: it is left alone
            self._client.restart_workers([worker], timeout=_ANSWER, raise_for_error=False)

    def close(self) -> None:
        """End one's own workers, and leave others alone."""
        for worker in list(self._futures):
            self._drop(worker)
        with suppress(Exception):  # whatever is gone is closed
            self._client.close(timeout=_ANSWER)
        if self._own is not None:
            with suppress(Exception):
                self._own.close(timeout=_ANSWER)

    def _outcome(self, worker: str, future: Future) -> Ended:
        if future.status == "finished":
            return Ended(worker, future.result())
        if future.status != "error":  # lost with its scheduler, or cancelled by others
            self._require()
            return Ended(worker, None, DIED)
        error = future.exception()
        if isinstance(error, (ImportError, OtherVersionError)):
            raise CrewError(f"{worker}: {error}")
        if isinstance(error, KilledWorker):
            self._looked = 0.0
            return Ended(worker, None, DIED)
        return Ended(worker, None, f"{type(error).__name__}: {' '.join(str(error).split())}")

    def _drop(self, worker: str) -> None:
        future = self._futures.pop(worker, None)
        if future is not None:
            with suppress(Exception):  # the scheduler may be gone
                future.cancel()

    def _require(self) -> None:
        if self._client.status != "running":
            raise CrewError(f"the scheduler at {self._address} went away")
