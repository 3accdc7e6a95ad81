"""The engine of a sweep: its workers run batches, and batches that fail are tried again."""

import time
from collections import Counter, deque
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from dataclasses import dataclass
from functools import lru_cache
from math import inf
from typing import Any, NamedTuple, Protocol, runtime_checkable

import tomli_w

from crinoid.compilation import make_room
from crinoid.foundation.status import Status
from crinoid.foundation.version import __version__
from crinoid.results.metrics import Measures, measured
from crinoid.scenario import Scenario, ScenarioError
from crinoid.simulation.batch import Arm, run_batch
from crinoid.studies.sweep.plan import SweepDesign
from crinoid.studies.sweep.store import SweepStore


class OtherVersionError(RuntimeError):
    """A worker has another version of crinoid than the sweep."""


@dataclass(frozen=True)
class Work:
    """One batch, as it is sent to a worker."""

    scenario: str  # TOML
    values: Sequence[dict[str, Any]]  # values of each run that replace those of the scenario
    threads: int = 1
    steps: int | None = None  # time steps of the sweep, as `crinoid.simulation.play` needs them
    version: str = __version__


def perform(work: Work) -> list[Arm[Measures]]:
    """Run a batch, and return the outcome of each of its runs, in order."""
    if work.version != __version__:
        raise OtherVersionError(f"a worker has crinoid {__version__}, the sweep is {work.version}")
    scenario = _read(work.scenario)
    cases: dict[int, Scenario] = {}
    found: dict[int, Arm[Measures]] = {}
    for index, values in enumerate(work.values):
        try:
            cases[index] = scenario.with_values(values)
        except ScenarioError as error:
            found[index] = Arm(None, f"refused: {'; '.join(error.lines)}", [])
    arms = run_batch(list(cases.values()), measured, threads=work.threads, steps=work.steps)
    found |= dict(zip(cases, arms, strict=True))
    make_room()
    return [found[index] for index in range(len(work.values))]


_read = lru_cache(maxsize=2)(Scenario.from_toml)


DIED = "its worker died"
BatchFuture = Future[list[Arm[Measures]]]


class WorkerPoolError(RuntimeError):
    """No workers are left: the scheduler is gone, or workers do not start."""


@runtime_checkable
class WorkerPool(Protocol):
    """Workers by name, each an executor of one batch at a time; a new one replaces a dead one."""

    def workers(self) -> dict[str, int]:
        """Return the number of threads of each worker that is ready or at work."""
        ...

    def submit(self, worker: str, work: Work) -> BatchFuture:
        """Run a batch on an idle worker."""
        ...

    def death(self, worker: str, error: BaseException) -> str:
        """Return how a worker died; empty if the error is one of the batch itself."""
        ...

    def replace(self, worker: str) -> None:
        """End a worker that hangs."""
        ...

    def close(self) -> None:
        """End all workers that the pool started, also while they work."""
        ...


_TRIES = 3
_LOOK = 0.2  # time between two looks at workers and at requests to stop (s)
_LEAST = 60.0  # shortest time limit of a batch (s)
_PATIENCE = 10.0  # time limit of a batch, over its time at the pace of the slowest one so far


class _Flight(NamedTuple):
    number: int
    started: float
    future: BatchFuture


def run_batches(
    plan: SweepDesign,
    store: SweepStore,
    pool: WorkerPool,
    done: set[int],
    report: Callable[[int], None],
    stop: Callable[[], bool],
    tell: Callable[[str], None] = lambda text: None,
) -> bool:
    """Run the missing batches of a plan and save each; return False if stopped before.

    A batch whose worker dies, or needs far longer than others, is tried three times in all; then
    its runs fail; ``tell`` gets a line about it at once. The numbers of the saved batches are added
    to ``done``, that of the saved runs is reported, and ``stop`` is asked five times a second.
    """
    scenario = tomli_w.dumps(plan.scenario.to_dict())
    batches = plan.batches
    waiting = deque(number for number in range(len(batches)) if number not in done)
    running: dict[str, _Flight] = {}
    tries: Counter[int] = Counter()
    slowest: dict[int, float] = {}  # time of a run, by structure
    found: list[tuple[int, list[Arm[Measures]]]] = []
    saved = sum(batches[number].runs.size for number in done)

    def failed(number: int, reason: str) -> None:
        tries[number] += 1
        ends = "is tried again" if tries[number] < _TRIES else "fails"
        tell(f"batch {number + 1} of {len(batches)} {ends}: {reason}")
        if tries[number] < _TRIES:
            waiting.append(number)
            return
        arm: Arm[Measures] = Arm(None, f"{Status.FAILED}: {reason}, {_TRIES} times", [])
        found.append((number, [arm] * batches[number].runs.size))

    report(saved)
    try:
        while waiting or running or found:
            workers = pool.workers()
            for worker, threads in workers.items():
                if waiting and worker not in running:
                    number = waiting.popleft()
                    values = [plan.values(run) for run in batches[number].runs.tolist()]
                    work = Work(scenario, values, threads, plan.steps)
                    running[worker] = _Flight(number, time.monotonic(), pool.submit(worker, work))
            for number, arms in found:  # while workers are at work again
                store.save(plan, number, batches[number], arms)
                done.add(number)
                saved += len(arms)
                report(saved)
            found.clear()
            if stop():
                return False
            if running:
                wait([each.future for each in running.values()], _LOOK, FIRST_COMPLETED)
            else:
                time.sleep(_LOOK)
            for worker, (number, started, future) in list(running.items()):
                runs, structure = batches[number]
                lasted = time.monotonic() - started
                most = max(_LEAST, _PATIENCE * slowest.get(structure, inf) * runs.size)
                if future.done():
                    outcome = _outcome(pool, worker, future)
                    if isinstance(outcome, str):
                        failed(number, outcome)
                    else:
                        each = lasted / len(outcome)
                        slowest[structure] = max(slowest.get(structure, 0.0), each)
                        found.append((number, outcome))
                elif worker not in workers:
                    failed(number, DIED)
                elif lasted > most:
                    pool.replace(worker)
                    failed(number, f"its worker took longer than {most:.0f} s")
                else:
                    continue
                del running[worker]
                future.cancel()
    finally:
        for flight in running.values():
            flight.future.cancel()
    return True


def _outcome(pool: WorkerPool, worker: str, future: BatchFuture) -> list[Arm[Measures]] | str:
    """Return the outcomes of a batch, or why it has none."""
    try:
        return future.result()
    except (ImportError, OtherVersionError) as error:
        raise WorkerPoolError(f"{worker}: {error}") from error
    except Exception as error:  # the sweep reports it, and goes on
        text = f"{type(error).__name__}: {' '.join(str(error).split())}"
        return pool.death(worker, error) or text
