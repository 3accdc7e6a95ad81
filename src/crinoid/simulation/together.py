"""Runs that take their time steps together, under `jax.vmap`: for accelerators."""

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, nullcontext
from itertools import repeat
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from crinoid.assembly.prepared import Prepared
from crinoid.dynamics import Outcome, State
from crinoid.programs import ONCE, compiled
from crinoid.record import Record
from crinoid.result import Result
from crinoid.scenario import ScenarioError
from crinoid.simulation.conclusion import builder, conclude
from crinoid.simulation.failure import start_failure
from crinoid.simulation.loop import Loop, LoopState
from crinoid.simulation.room import check_room
from crinoid.simulation.run import rounded_off, without_control
from crinoid.simulation.setup import Setup, set_up
from crinoid.simulation.sink import Sink
from crinoid.simulation.stretch import begun_with, one_instant, record, stretches

__all__ = ["on_processor", "play_together"]

_INSTANTS = 16
"""Instants between two looks at the runs."""


class _Ready(NamedTuple):
    number: int
    prepared: Prepared
    setup: Setup


def play_together(
    prepared: Sequence[Prepared], moved: Callable[[int, float], None], stop: Callable[[], bool]
) -> Iterator[tuple[int, Result | ScenarioError]]:
    """Run scenarios as `crinoid.simulation.run.play` does each, and give result after result.

    What is before the first time step is computed on the processor, one run after the other.

    Parameters
    ----------
    prepared
        The scenarios. Those of one structure are run by one program.
    moved
        Called now and then with the index of a run and how far it is (s).
    stop
        Asked as often whether to interrupt all of them.

    Yields
    ------
    (index, result)
        A result, or why a scenario cannot be run.
    """
    groups: dict[Any, list[_Ready]] = {}
    for index, each in enumerate(prepared):
        if stop():
            return
        try:
            check_room(each.scenario, None)
            with on_processor():
                ready = _Ready(index, each, set_up(each))
        except ScenarioError as error:
            yield index, error
        else:
            groups.setdefault(_form(ready), []).append(ready)
    for group in groups.values():
        results = _run(group, moved, stop)
        control = group[0].prepared.scenario.control
        others: Iterable[Result | None]
        if control.kind != "none" and control.compare:
            idle = [ready._replace(setup=without_control(ready.setup)) for ready in group]
            others = _run(idle, lambda index, reached: None, stop)
        else:
            others = repeat(None, len(group))
        yield from _paired(group, results, others)


def on_processor() -> AbstractContextManager[Any]:
    """Return the context in which what is computed is computed on the processor."""
    if jax.default_backend() == "cpu":
        return nullcontext()
    return jax.default_device(jax.local_devices(backend="cpu")[0])


def _paired(
    group: Sequence[_Ready], results: Iterator[Result], others: Iterator[Result | None]
) -> Iterator[tuple[int, Result]]:
    for ready, result, other in zip(group, results, others, strict=True):
        result.uncontrolled = other
        yield ready.number, rounded_off(result)


def _form(ready: _Ready) -> Any:
    """Return what decides on the program of a run."""
    control = ready.prepared.scenario.control
    leaves, tree = jax.tree.flatten((ready.setup.loop, ready.setup.state))
    compared = control.kind != "none" and control.compare
    return tree, tuple((leaf.shape, str(leaf.dtype)) for leaf in leaves), compared


def _run(
    group: Sequence[_Ready], moved: Callable[[int, float], None], stop: Callable[[], bool]
) -> Iterator[Result]:
    """Run one group to the end, then give its results one by one."""
    scenarios = [ready.prepared.scenario for ready in group]
    loops = _stack([ready.setup.loop for ready in group])
    carries, firsts = _begin(loops, _stack([ready.setup.state for ready in group]))
    failures = [
        start_failure(scenario, ready.setup.loop.system, ready.setup.outcome)
        for scenario, ready in zip(scenarios, group, strict=True)
    ]
    totals = [scenario.simulation.steps for scenario in scenarios]
    ends = np.where(np.array(failures, bool), 0, totals)
    strides = np.array([scenario.output_steps for scenario in scenarios])
    outcomes = _stack([Outcome.of_nothing(converged=True)] * len(group))
    sinks = [
        Sink(one_instant(_of(firsts, row)), builder(ready.prepared, ready.setup), None, {})
        for row, ready in enumerate(group)
    ]
    begun = time.perf_counter()
    while True:
        steps, converged = np.asarray(carries.steps), np.asarray(outcomes.converged)
        if not np.any((steps < ends) & converged) or stop():
            break
        carries, kept, due, outcomes = stretches(
            loops, carries, outcomes, jnp.asarray(ends), jnp.asarray(strides), _INSTANTS
        )
        kept, counts = jax.tree.map(np.asarray, kept), np.asarray(due).sum(axis=1)
        for row, (sink, ready, reached) in enumerate(
            zip(sinks, group, np.asarray(carries.state.time), strict=True)
        ):
            sink.append(jax.tree.map(lambda x: x[row, : counts[row]], kept))  # noqa: B023
            moved(ready.number, float(reached))
    wall_time = (time.perf_counter() - begun) / len(group)
    carries, lasts, outcomes = jax.tree.map(
        np.asarray, (carries, _record(loops, carries), outcomes)
    )
    for row, (ready, sink) in enumerate(zip(group, sinks, strict=True)):
        carry, outcome = _of(carries, row), _of(outcomes, row)
        trouble, failed = failures[row], None if outcome.converged else outcome
        if failed is not None:  # what is told of it is computed
            carry = jax.tree.map(jnp.asarray, carry)
        if carry.tally.steps:  # steps that no kept instant tells of yet
            sink.append(one_instant(_of(lasts, row)))
        if carry.steps < totals[row] and not (trouble or failed):
            trouble = f"interrupted at t = {float(carry.state.time):.6g} s"
        dataset = sink.close(carry, wall_time)
        yield conclude(ready.prepared, ready.setup, carry, dataset, trouble, failed, wall_time)


@compiled(**ONCE)
def _begin(loops: Loop, states: State) -> tuple[LoopState, Record]:
    return eqx.filter_vmap(begun_with)(loops, states)


@compiled(**ONCE)
def _record(loops: Loop, carries: LoopState) -> Record:
    return eqx.filter_vmap(record)(loops, carries)


def _stack(trees: Sequence[Any]) -> Any:
    return jax.tree.map(lambda *leaves: _stacked(leaves), *trees)


def _stacked(leaves: Sequence[Any]) -> Any:
    """Return arrays on top of each other, put together outside of any device."""
    if jnp.issubdtype(leaves[0].dtype, jax.dtypes.prng_key):
        data = np.stack([np.asarray(jax.random.key_data(leaf)) for leaf in leaves])
        return jax.random.wrap_key_data(jnp.asarray(data), impl=jax.random.key_impl(leaves[0]))
    return jnp.asarray(np.stack([np.asarray(leaf) for leaf in leaves]))


def _of(tree: Any, row: int) -> Any:
    return jax.tree.map(lambda x: np.asarray(x[row]), tree)
