"""Many arms at once: one compiled program for all of one structure, on all cores.

On a CPU a batch of arms under `jax.vmap` takes as long for each as one arm alone
(``benchmarks/batch.py``). So each arm is run by itself, as `play` does, in as many threads as there
are cores: what comes out is equal to the bit, an arm that fails holds up no other one, and memory
holds no more arms than there are threads.
"""

from __future__ import annotations

import os
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextvars import copy_context
from dataclasses import dataclass
from typing import Generic, TypeVar

from crinoid.assembly.prepared import Prepared
from crinoid.result import Result
from crinoid.scenario import Scenario, ScenarioError
from crinoid.simulation.run import Progress, Report, play
from crinoid.status import Status

__all__ = ["Arm", "cores", "run_batch"]

T = TypeVar("T")
_LOOK = 0.1
"""Time between two looks at what the threads do (s)."""
_NOT_RUN = f"{Status.INTERRUPTED} before its end"


@dataclass(frozen=True)
class Arm(Generic[T]):
    """Outcome of one arm of a batch."""

    taken: T | None
    """Part of its result that was kept; None where it was not run to its end."""
    status: str
    """``ok``, or what went wrong and when."""
    notes: list[str]


def run_batch(
    scenarios: Sequence[Scenario],
    take: Callable[[Result], T],
    *,
    label: str = "simulated",
    report: Report | None = None,
    stop: Callable[[], bool] = lambda: False,
    threads: int | None = None,
) -> list[Arm[T]]:
    """Run scenarios, and keep of each result no more than what ``take`` takes of it.

    Parameters
    ----------
    scenarios
        One case each (`crinoid.Scenario.cases`). Those of one structure, such as the same scenario
        with other seeds, share their compiled programs.
    take
        From the result of an arm to what is kept of it, called once for each that reached its end.
    label
        Name of the batch in reports.
    report
        Called about ten times a second with the `crinoid.simulation.Progress` of all arms together.
    stop
        Asked as often whether to stop; what is under way then is interrupted.
    threads
        Arms that run at a time; as many as there are cores if left out.

    Returns
    -------
    list of Arm
        In the order of ``scenarios``.
    """
    found: list[Arm[T]] = [Arm(None, _NOT_RUN, [])] * len(scenarios)
    reached = [0.0] * len(scenarios)
    waiting, pending = deque(enumerate(scenarios)), dict[Future[Arm[T]], int]()
    cancelled, begun = threading.Event(), 0.0
    whole = sum(scenario.simulation.duration for scenario in scenarios)
    most = threads or cores()

    def run(index: int, prepared: Prepared) -> Arm[T]:
        def moved(progress: Progress) -> None:
            reached[index] = progress.time

        try:
            result = play(prepared, report=moved, stop=cancelled.is_set)
        except ScenarioError as error:
            return _refused(error)
        if result.failure or result.interrupted:
            return Arm(None, result.failure or _NOT_RUN, result.notes)
        return Arm(take(result), result.status, result.notes)

    pool = ThreadPoolExecutor(most)
    try:
        while waiting or pending:
            # the first one compiles for all, and is alone until it moves
            while waiting and len(pending) < (most if any(reached) else 1):
                index, scenario = waiting.popleft()
                prepared = Prepared(scenario)
                try:
                    prepared.check()  # reads files, which threads must not do at once
                except ScenarioError as error:
                    found[index] = _refused(error)
                    continue
                # a thread has a context of its own, in which programs would not be kept
                pending[pool.submit(copy_context().run, run, index, prepared)] = index
            for future in wait(pending, _LOOK, FIRST_COMPLETED).done:
                found[pending.pop(future)] = future.result()
            if any(reached):
                begun = begun or time.perf_counter() - _LOOK
                if report is not None:
                    report(Progress(label, sum(reached), whole, time.perf_counter() - begun))
            if stop():
                cancelled.set()
                waiting.clear()
    finally:
        cancelled.set()
        pool.shutdown(wait=False, cancel_futures=True)
    return found


def _refused(error: ScenarioError) -> Arm[T]:
    return Arm(None, f"refused: {'; '.join(error.lines)}", [])


def cores() -> int:
    """Return how many cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
