"""Many arms at once: one compiled program for all of one structure, on all that computes.

On a CPU a batch of arms under `jax.vmap` takes as long for each as one arm alone
(``benchmarks/vmap.py``). So each arm is run by itself, as `play` does, in as many threads as there
are cores: what comes out is equal to the bit, an arm that fails holds up no other one, and memory
holds no more arms than there are threads. On an accelerator they take their steps together
(`crinoid.simulation.together`).
"""

import os
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextvars import copy_context
from dataclasses import dataclass
from typing import Generic, TypeVar

import jax

from crinoid.assembly.prepared import Prepared
from crinoid.result import Result
from crinoid.scenario import Scenario, ScenarioError
from crinoid.simulation.room import room_for
from crinoid.simulation.run import Progress, Report, play
from crinoid.simulation.together import on_processor, play_together
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
    """Part of its result that was kept; None where nothing was."""
    status: str
    """``ok``, or what went wrong and when."""
    notes: list[str]


def run_batch(
    scenarios: Sequence[Scenario],
    take: Callable[[Result], T],
    *,
    take_unfinished: Callable[[Result], T | None] = lambda result: None,
    label: str = "simulated",
    report: Report | None = None,
    stop: Callable[[], bool] = lambda: False,
    threads: int | None = None,
    together: bool | None = None,
) -> list[Arm[T]]:
    """Run scenarios, and keep of each result no more than what ``take`` takes of it.

    Parameters
    ----------
    scenarios
        One case each (`crinoid.Scenario.cases`). Those of one structure, such as the same scenario
        with other seeds, share their compiled programs.
    take
        From the result of an arm to what is kept of it, called once for each that reached its end.
    take_unfinished
        The same for each that failed or was interrupted on its way; keeps nothing if left out.
    label
        Name of the batch in reports.
    report
        Called about ten times a second with the `crinoid.simulation.Progress` of all arms together.
    stop
        Asked as often whether to stop; what is under way then is interrupted.
    threads
        Arms that run at a time; as many as there are cores if left out.
    together
        Whether they take their steps together; if left out, where JAX computes on an accelerator.
        Arms with parts that do not go under `jax.vmap` are run in threads on the processor.

    Returns
    -------
    list of Arm
        In the order of ``scenarios``.
    """
    batch = _Batch(scenarios, take, take_unfinished, label, report, stop)
    if together is None:
        together = jax.default_backend() != "cpu"
    if together:
        try:
            batch.run_together()
        except NotImplementedError:
            batch.run_in_threads(threads or cores())
    else:
        batch.run_in_threads(threads or cores())
    return batch.found


class _Batch(Generic[T]):
    """Arms on their way, and what was found of them."""

    def __init__(
        self,
        scenarios: Sequence[Scenario],
        take: Callable[[Result], T],
        take_unfinished: Callable[[Result], T | None],
        label: str,
        report: Report | None,
        stop: Callable[[], bool],
    ) -> None:
        self.scenarios, self.label, self.report, self.stop = scenarios, label, report, stop
        self.take, self.take_unfinished = take, take_unfinished
        self.found: list[Arm[T]] = [Arm(None, _NOT_RUN, [])] * len(scenarios)
        self.reached, self.begun = [0.0] * len(scenarios), 0.0
        self.whole = sum(scenario.simulation.duration for scenario in scenarios)

    def run_together(self) -> None:
        """Run as many together as memory has room for."""
        looked = 0.0

        def moved(index: int, time_reached: float) -> None:
            nonlocal looked
            self.reached[index] = time_reached
            if time.perf_counter() - looked > _LOOK:
                looked = time.perf_counter()
                self.tell()

        start = 0
        while start < len(self.scenarios):
            most = room_for(self.scenarios[start])
            some = [Prepared(scenario) for scenario in self.scenarios[start : start + most]]
            first = start

            def moved_in_all(index: int, time_reached: float, first: int = first) -> None:
                moved(first + index, time_reached)

            for index, result in play_together(some, moved_in_all, self.stop):
                self.found[first + index] = self.arm_of(result)
            start += most

    def run_in_threads(self, most: int) -> None:
        """Run each by itself, so many at a time."""
        waiting, pending = deque(enumerate(self.scenarios)), dict[Future[Arm[T]], int]()
        cancelled, reached = threading.Event(), self.reached

        def run(index: int, prepared: Prepared) -> Arm[T]:
            def moved(progress: Progress) -> None:
                reached[index] = progress.time

            try:
                with on_processor():
                    return self.arm_of(play(prepared, report=moved, stop=cancelled.is_set))
            except ScenarioError as error:
                return self.arm_of(error)

        pool = ThreadPoolExecutor(most)
        try:
            while waiting or pending:
                # the first one compiles for all, and is alone until it moves
                while waiting and len(pending) < (most if any(reached) else 1):
                    index, scenario = waiting.popleft()
                    prepared = Prepared(scenario)
                    try:
                        with on_processor():
                            prepared.check()  # reads files, which threads must not do at once
                    except ScenarioError as error:
                        self.found[index] = self.arm_of(error)
                        continue
                    # a thread has a context of its own, in which programs would not be kept
                    pending[pool.submit(copy_context().run, run, index, prepared)] = index
                for future in wait(pending, _LOOK, FIRST_COMPLETED).done:
                    self.found[pending.pop(future)] = future.result()
                self.tell()
                if self.stop():
                    cancelled.set()
                    waiting.clear()
        finally:
            cancelled.set()
            pool.shutdown(wait=False, cancel_futures=True)

    def tell(self) -> None:
        """Report how far all of them are, once one has moved."""
        if any(self.reached):
            self.begun = self.begun or time.perf_counter() - _LOOK
            if self.report is not None:
                elapsed = time.perf_counter() - self.begun
                self.report(Progress(self.label, sum(self.reached), self.whole, elapsed))

    def arm_of(self, result: Result | ScenarioError) -> Arm[T]:
        """Return what is kept of a result, or why there is none."""
        if isinstance(result, ScenarioError):
            return Arm(None, f"refused: {'; '.join(result.lines)}", [])
        if result.failure or result.interrupted:
            status = result.failure or _NOT_RUN
            if result.failure and result.ended is Status.OK:
                status = status.replace(Status.FAILED, f"{Status.FAILED} without control", 1)
            return Arm(self.take_unfinished(result), status, result.notes)
        return Arm(self.take(result), result.status, result.notes)


def cores() -> int:
    """Return how many cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
