"""Many arms at once: one compiled program for all of one structure, on all that computes.

On a CPU an arm in a batch under `jax.vmap` lasts as long as one arm alone: see
``python -m benchmarks batch``. So each arm is run by itself, as `play` does, in as many threads
as there are cores: results differ by round-off at most, an arm that fails does not delay the
others, and memory contains no more arms than there are threads. On an accelerator they take their
steps together, under `jax.vmap`.
"""

import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from functools import partial
from itertools import repeat
from typing import Any, Generic, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from crinoid.assembly.prepared import Prepared
from crinoid.compilation import ONCE, compiled
from crinoid.dynamics import Outcome, State
from crinoid.foundation.cores import cores
from crinoid.foundation.status import Status
from crinoid.results.record import Record
from crinoid.results.result import Result
from crinoid.scenario import Scenario, ScenarioError
from crinoid.simulation.chunk import one_instant, record, run_chunks, start_loop
from crinoid.simulation.conclusion import conclude, dataset_builder, start_failure
from crinoid.simulation.loop import Loop, LoopState
from crinoid.simulation.run import Progress, Report, play, with_loop_notes, without_control
from crinoid.simulation.setup import Setup, set_up
from crinoid.simulation.sink import Sink, require_space, runs_in_memory

__all__ = ["Arm", "on_processor", "play_batched", "run_batch"]

_INSTANTS = 16  # instants between two looks at the runs


def play_batched(
    prepared: Sequence[Prepared],
    moved: Callable[[int, float], None],
    stop: Callable[[], bool],
    *,
    notes: bool = True,
) -> Iterator[tuple[int, Result | ScenarioError]]:
    """Run scenarios as `crinoid.simulation.run.play` does each, and give result after result.

    The start is computed on the processor, one run after the other. Scenarios of one structure are
    run by one program. ``moved`` is called now and then with the index of a run and how far it is
    (s), ``stop`` is asked as often whether to interrupt all. Yields index and result, or why a
    scenario cannot be run.
    """
    groups: dict[Any, list[tuple[int, Setup]]] = {}
    for index, each in enumerate(prepared):
        if stop():
            return
        try:
            require_space(each.scenario, None)
            with on_processor():
                setup = set_up(each, notes=notes)
        except ScenarioError as error:
            yield index, error
        else:
            # these decide on the program of a run
            leaves, tree = jax.tree.flatten((setup.loop, setup.state))
            forms = tuple((leaf.shape, str(leaf.dtype)) for leaf in leaves)
            key = tree, forms, setup.scenario.control.compared
            groups.setdefault(key, []).append((index, setup))
    for group in groups.values():
        numbers, setups = zip(*group, strict=True)
        results = _run(setups, lambda row, reached: moved(numbers[row], reached), stop)  # noqa: B023
        others: Iterable[Result | None] = repeat(None, len(group))
        if setups[0].scenario.control.compared:
            others = _run([*map(without_control, setups)], lambda row, reached: None, stop)
        for number, result, other in zip(numbers, results, others, strict=True):
            result.uncontrolled = other
            yield number, with_loop_notes(result)


def on_processor() -> AbstractContextManager[Any]:
    """Return the context that computes on the processor."""
    if jax.default_backend() == "cpu":
        return nullcontext()
    return jax.default_device(jax.local_devices(backend="cpu")[0])


def _run(
    setups: Sequence[Setup], moved: Callable[[int, float], None], stop: Callable[[], bool]
) -> Iterator[Result]:
    """Run one group to the end, then give its results one by one."""
    loops = _stack([setup.loop for setup in setups])
    carries, firsts = _begin(loops, _stack([setup.state for setup in setups]))
    failures = [*map(start_failure, setups)]
    totals = [setup.scenario.simulation.steps for setup in setups]
    ends = np.where(np.array(failures, bool), 0, totals)
    strides = np.array([setup.scenario.output_steps for setup in setups])
    outcomes = _stack([Outcome.of_nothing(converged=True)] * len(setups))
    sinks = [
        Sink(one_instant(_of(firsts, row)), dataset_builder(setup), None)
        for row, setup in enumerate(setups)
    ]
    started = time.perf_counter()
    while True:
        steps, converged = np.asarray(carries.steps), np.asarray(outcomes.converged)
        if not np.any((steps < ends) & converged) or stop():
            break
        carries, kept, due, outcomes = run_chunks(
            loops, carries, outcomes, jnp.asarray(ends), jnp.asarray(strides), _INSTANTS
        )
        kept, counts = jax.tree.map(np.asarray, kept), np.asarray(due).sum(axis=1)
        reached = np.asarray(carries.state.time)
        for row, sink in enumerate(sinks):
            sink.append(jax.tree.map(lambda x: x[row, : counts[row]], kept))  # noqa: B023
            moved(row, float(reached[row]))
    wall_time = (time.perf_counter() - started) / len(setups)
    over = carries, _record(loops, carries), outcomes
    carries, lasts, outcomes = jax.tree.map(np.asarray, over)
    for row, (setup, sink) in enumerate(zip(setups, sinks, strict=True)):
        carry, outcome = _of(carries, row), _of(outcomes, row)
        trouble, failed = failures[row], None if outcome.converged else outcome
        if failed is not None:  # its message is computed
            carry = jax.tree.map(jnp.asarray, carry)
        if carry.tally.steps:  # steps since the last saved instant
            sink.append(one_instant(_of(lasts, row)))
        if carry.steps < totals[row] and not (trouble or failed):
            trouble = f"interrupted at t = {float(carry.state.time):.6g} s"
        dataset = sink.close(carry, wall_time)
        yield conclude(setup, carry, dataset, trouble, failed, wall_time)


@compiled(**ONCE)
def _begin(loops: Loop, states: State) -> tuple[LoopState, Record]:
    return eqx.filter_vmap(start_loop)(loops, states)


@compiled(**ONCE)
def _record(loops: Loop, carries: LoopState) -> Record:
    return eqx.filter_vmap(record)(loops, carries)


def _stack(trees: Sequence[Any]) -> Any:
    return jax.tree.map(_stacked, *trees)


def _stacked(*leaves: Any) -> Any:
    """Return arrays on top of each other, put together outside of any device."""
    if jnp.issubdtype(leaves[0].dtype, jax.dtypes.prng_key):
        data = np.stack([np.asarray(jax.random.key_data(leaf)) for leaf in leaves])
        return jax.random.wrap_key_data(jnp.asarray(data), impl=jax.random.key_impl(leaves[0]))
    return jnp.asarray(np.stack([np.asarray(leaf) for leaf in leaves]))


def _of(tree: Any, row: int) -> Any:
    return jax.tree.map(lambda x: np.asarray(x[row]), tree)


T = TypeVar("T")
_LOOK = 0.1  # time between two looks at what the threads do (s)
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
    steps: int | None = None,
    notes: bool = True,
) -> list[Arm[T]]:
    """Run scenarios, and keep of each result only what ``take`` returns, in their order.

    ``scenarios`` are one case each (`crinoid.Scenario.cases`). Those of one structure, such as the
    same scenario with other seeds, share their compiled programs. ``take`` is called once for each
    arm that reached its end, ``take_unfinished`` for each that failed or was interrupted on its
    way. ``report`` is called about ten times a second with the `crinoid.simulation.Progress` of all
    arms together, and ``stop`` is asked as often whether to interrupt them.

    As many ``threads`` run as there are cores if left out. Arms take their steps ``together``, if
    left out, where JAX computes on an accelerator; those with parts that do not go under `jax.vmap`
    are run in threads on the processor. ``steps`` are those of all arms, and ``notes`` are made, as
    for `crinoid.simulation.play`.
    """
    batch = _Batch(scenarios, take, take_unfinished, label, report, stop, steps, notes)
    if together is None:
        together = jax.default_backend() != "cpu"
    try:
        if together:
            batch.run_together()
    except NotImplementedError:
        together = False
    if not together:
        batch.run_in_threads(threads or cores())
    return batch.found


@dataclass
class _Batch(Generic[T]):
    """Arms on their way, and what was found of them."""

    scenarios: Sequence[Scenario]
    take: Callable[[Result], T]
    take_unfinished: Callable[[Result], T | None]
    label: str
    report: Report | None
    stop: Callable[[], bool]
    steps: int | None
    notes: bool

    def __post_init__(self) -> None:
        self.found: list[Arm[T]] = [Arm(None, _NOT_RUN, [])] * len(self.scenarios)
        self.reached, self.started = [0.0] * len(self.scenarios), 0.0
        self.whole = sum(scenario.simulation.duration for scenario in self.scenarios)

    def run_together(self) -> None:
        """Run as many together as memory has room for."""
        start, looked = 0, 0.0

        def moved(index: int, time_reached: float) -> None:
            nonlocal looked
            self.reached[start + index] = time_reached
            if time.perf_counter() - looked > _LOOK:
                looked = time.perf_counter()
                self.report_progress()

        while start < len(self.scenarios):
            most = runs_in_memory(self.scenarios[start])
            some = [Prepared(scenario) for scenario in self.scenarios[start : start + most]]
            for index, result in play_batched(some, moved, self.stop, notes=self.notes):
                self.found[start + index] = self.arm_of(result)
            start += most

    def run_in_threads(self, most: int) -> None:
        """Run each by itself, so many at a time."""
        waiting, pending = deque(enumerate(self.scenarios)), dict[Future[Arm[T]], int]()
        cancelled, reached = threading.Event(), self.reached
        # nobody reads the notes on a run without control
        one = partial(play, steps=self.steps, notes=self.notes, idle_notes=False)

        def run(index: int, prepared: Prepared) -> Arm[T]:
            def moved(progress: Progress) -> None:
                reached[index] = progress.time

            try:
                with on_processor():
                    return self.arm_of(one(prepared, report=moved, stop=cancelled.is_set))
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
                    pending[pool.submit(run, index, prepared)] = index
                for future in wait(pending, _LOOK, FIRST_COMPLETED).done:
                    self.found[pending.pop(future)] = future.result()
                self.report_progress()
                if self.stop():
                    cancelled.set()
                    waiting.clear()
        finally:
            cancelled.set()
            pool.shutdown(wait=False, cancel_futures=True)

    def report_progress(self) -> None:
        """Report how far all of them are, once one has moved."""
        if any(self.reached):
            self.started = self.started or time.perf_counter() - _LOOK
            if self.report is not None:
                elapsed = time.perf_counter() - self.started
                self.report(Progress(self.label, sum(self.reached), self.whole, elapsed))

    def arm_of(self, result: Result | ScenarioError) -> Arm[T]:
        """Return the part of a result to keep, or the reason for its absence."""
        if isinstance(result, ScenarioError):
            return Arm(None, f"refused: {'; '.join(result.lines)}", [])
        if result.failure or result.interrupted:
            status = result.failure or _NOT_RUN
            if result.failure and result.ended is Status.OK:
                status = status.replace(Status.FAILED, f"{Status.FAILED} without control", 1)
            return Arm(self.take_unfinished(result), status, result.notes)
        try:
            return Arm(self.take(result), result.status, result.notes)
        except ScenarioError as error:  # of a measure from a package
            return self.arm_of(error)
