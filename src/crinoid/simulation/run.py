"""Running a scenario: chunks of compiled time, with progress and interruption between them."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable
from contextlib import nullcontext
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr

from crinoid.dataset import build_dataset, describe, join
from crinoid.dimensionless import with_dimensionless
from crinoid.dynamics import Outcome, State, System
from crinoid.notes import notes
from crinoid.plausibility import AT_REST, doubts
from crinoid.record import Record
from crinoid.result import Result, named_leaves
from crinoid.scenario import Scenario
from crinoid.simulation.continuation import restored
from crinoid.simulation.loop import Loop, LoopState
from crinoid.simulation.setup import Setup, set_up
from crinoid.simulation.stretch import record, stretch

_CAPACITY = 256
_CHUNK_SECONDS = 0.25


class Progress(NamedTuple):
    """How far a run is."""

    label: str
    time: float
    """Simulated time so far (s)."""
    duration: float
    """Simulated time in all (s)."""
    elapsed: float
    """Time that it took so far (s)."""


Report = Callable[[Progress], None]


class SimulationError(RuntimeError):
    """A run that could not be finished. ``result`` holds what was computed."""

    def __init__(self, result: Result) -> None:
        super().__init__(result.failure)
        self.result = result


def simulate(scenario: Scenario, *, report: Report | None = None) -> Result:
    """Run a scenario; with a controller and ``control.compare``, also the same case without it.

    Parameters
    ----------
    scenario
        What to run.
    report
        Called between chunks of the run.

    Raises
    ------
    SimulationError
        If a time step or the equilibrium at the start could not be solved.
    ScenarioError
        If a file that the scenario names is not what it takes.
    ValueError
        If the scenario stands for several cases (`crinoid.Scenario.cases`).
    """
    result = play(scenario, report=report)
    if result.failure:
        raise SimulationError(result)
    return result


def play(
    scenario: Scenario,
    *,
    report: Report | None = None,
    resume: Result | None = None,
    stop: Callable[[], bool] | None = None,
) -> Result:
    """Run a scenario to its end, a failure or an interruption; `Result.status` says which.

    Parameters
    ----------
    scenario
        What to run.
    report
        Called between chunks of the run.
    resume
        An earlier result of the same scenario, to continue from where it stopped; its duration may
        have grown.
    stop
        Asked before each chunk of the run whether to interrupt it; Ctrl-C does by default.

    Raises
    ------
    ResultError
        If ``resume`` is no result that this scenario can go on from.
    ScenarioError
        If a file that the scenario names is not what it takes, or the controller cannot work.
    ValueError
        If the scenario stands for several cases (`crinoid.Scenario.cases`).
    """
    _one_case(scenario)
    controlled = scenario.control.kind != "none"
    label = "controlled" if controlled else "simulated"
    with _CtrlC() if stop is None else nullcontext(stop) as asked:
        setup = set_up(scenario)
        result = _run(scenario, setup, label, report, resume, asked)
        if controlled and scenario.control.compare:
            idle = setup._replace(
                loop=eqx.tree_at(lambda loop: loop.enabled, setup.loop, jnp.asarray(False))
            )
            earlier = resume.uncontrolled if resume is not None else None
            result.uncontrolled = _run(scenario, idle, "uncontrolled", report, earlier, asked)
    return result


def equilibrium(scenario: Scenario) -> Result:
    """Find the static equilibrium of a scenario at time zero: a result with one instant.

    Raises
    ------
    SimulationError
        If none was found.
    ValueError
        If the scenario stands for several cases (`crinoid.Scenario.cases`).
    """
    _one_case(scenario)
    begun = time.perf_counter()
    still = at_rest(scenario)
    setup = set_up(still)._replace(doubts=doubts(scenario, AT_REST))
    carry, first = _begin(setup.loop, _stand(setup.loop.system, setup.state))
    wall_time = time.perf_counter() - begun
    result = _result(
        still, setup, carry, [_one(first)], _start_failure(still, setup), wall_time, None
    )
    if result.failure:
        raise SimulationError(result)
    return result


def at_rest(scenario: Scenario) -> Scenario:
    """Return the scenario of which the result of `equilibrium` tells."""
    return scenario.with_values({"simulation.start": "equilibrium", "control.kind": "none"})


def _one_case(scenario: Scenario) -> None:
    if scenario.vary:
        raise ValueError("a scenario with [vary] stands for several cases: run scenario.cases()")


def _run(
    scenario: Scenario,
    setup: Setup,
    label: str,
    report: Report | None,
    earlier: Result | None,
    stop: Callable[[], bool],
) -> Result:
    loop, stride = setup.loop, scenario.output_steps
    duration, total = scenario.simulation.duration, scenario.simulation.steps
    carry, first = _begin(loop, setup.state)
    records, kept_earlier = [_one(first)], None
    if earlier is not None:
        start = build_dataset(loop.system, records.pop())
        carry, kept_earlier = restored(earlier, carry, start, stride)
    done, chunk = int(carry.steps), 16
    failure = _start_failure(scenario, setup)
    if done < total and not failure:
        # a stretch of nothing: compiles, so that what follows is timed without it
        jax.block_until_ready(stretch(loop, carry, carry.steps, jnp.asarray(stride), _CAPACITY))
    begun = time.perf_counter()
    if earlier is not None:
        begun -= earlier.dataset.attrs["wall_time"]
    while done < total and not failure and not stop():
        chunk_begun = time.perf_counter()
        steps = min(chunk, total - done, stride * _CAPACITY)
        done += steps
        carry, kept, new, outcome = stretch(
            loop, carry, jnp.asarray(done), jnp.asarray(stride), _CAPACITY
        )
        records.append(jax.tree.map(lambda x: np.asarray(x)[: int(new)], kept))  # noqa: B023
        took = time.perf_counter() - chunk_begun
        chunk = max(16, int(min(steps * _CHUNK_SECONDS / took, 4 * chunk)))
        if not outcome.converged:
            failure = _step_failure(scenario, loop.system, carry, outcome)
        if report is not None:
            elapsed = time.perf_counter() - begun
            report(Progress(label, float(carry.state.time), duration, elapsed))
    wall_time = time.perf_counter() - begun
    if int(carry.tally.steps):  # steps that no kept instant tells of yet
        records.append(_one(_keep(loop, carry)))
    if not failure and done < total:
        failure = f"interrupted at t = {float(carry.state.time):.6g} s"
    return _result(scenario, setup, carry, records, failure, wall_time, kept_earlier)


class _CtrlC:
    """Turns the first Ctrl-C into a request to stop after the chunk that is running."""

    def __init__(self) -> None:
        self._asked = False

    def __call__(self) -> bool:
        return self._asked

    def __enter__(self) -> _CtrlC:
        self._main = threading.current_thread() is threading.main_thread()
        if self._main:  # where alone Python lets signals be handled
            self._earlier = signal.signal(signal.SIGINT, self._ask)
        return self

    def __exit__(self, *_: object) -> None:
        if self._main:
            signal.signal(signal.SIGINT, self._earlier)

    def _ask(self, *_: object) -> None:
        self._asked = True
        signal.signal(signal.SIGINT, self._earlier)  # a second one stops at once


@eqx.filter_jit
def _stand(system: System, state: State) -> State:
    return system.stand(state)


@eqx.filter_jit
def _begin(loop: Loop, state: State) -> tuple[LoopState, Record]:
    carry = loop.start(state)
    return carry, record(loop, carry)


_keep = eqx.filter_jit(record)


def _one(record: Record) -> Record:
    return jax.tree.map(lambda x: np.asarray(x)[None], record)


def _result(
    scenario: Scenario,
    setup: Setup,
    carry: LoopState,
    records: list[Record],
    trouble: str,
    wall_time: float,
    earlier: xr.Dataset | None,
) -> Result:
    parts = [] if earlier is None else [earlier]
    if records:
        whole = jax.tree.map(lambda *parts: np.concatenate(parts), *records)
        parts.append(build_dataset(setup.loop.system, whole))
    dataset = with_dimensionless(join(parts), scenario, setup.modes)
    dataset.attrs = describe(scenario) | {
        "status": trouble or "ok",
        "wall_time": wall_time,
        "notes": "\n".join([*scenario.notes(), *setup.doubts, *notes(dataset, scenario)]),
    }
    return Result(dataset, named_leaves(carry))


def _start_failure(scenario: Scenario, setup: Setup) -> str:
    outcome = setup.outcome
    if outcome.converged:
        return ""
    return (
        "failed at t = 0 s: no static equilibrium found, "
        f"{_imbalance(setup.loop.system, outcome)}; "
        f"try {_other_base(scenario)}"
        'simulation.start = "rest", loads that come on with ramp_time, or more arm.nodes'
    )


def _other_base(scenario: Scenario) -> str:
    """Say what to try first where a joint may be bent too far."""
    jointed = scenario.arm.dimension == 3 and scenario.base.mount == "pinned"
    return "a base that points less than 170 degrees from where the arm hangs, " * jointed


def _step_failure(scenario: Scenario, system: System, carry: LoopState, outcome: Outcome) -> str:
    halvings, touch = scenario.simulation.max_halvings, carry.state.touch
    when = f"failed at t = {float(carry.state.time):.6g} s"
    smaller = "a smaller simulation.time_step"
    if not outcome.resolved:
        assert touch is not None
        gaps = np.min(np.asarray(touch.gap), axis=1)
        near = int(np.argmin(gaps))
        return (
            f"{when}: a hit is too hard or too fast for a time step even after {halvings} "
            f"halvings, obstacle {near} is nearest to the arm with {1e3 * gaps[near]:.3g} mm "
            f"between them; try {smaller}, more simulation.max_halvings, or slower obstacles"
        )
    if outcome.folded:
        facing = np.asarray(system.forces.facing(carry.state.motion.position))
        node, angle = int(np.argmin(facing)), np.rad2deg(np.arccos(np.clip(facing.min(), -1, 1)))
        return (
            f"{when}: the arm folds onto itself, two edges meet at more than 170 degrees even "
            f"after {halvings} halvings, and node {node} was bent by {angle:.0f} before; try "
            f"{_other_base(scenario)}more arm.nodes, weaker loads, a stiffer arm, or {smaller}"
        )
    caught = touch is not None and bool(np.any(np.asarray(touch.in_contact)))
    return (
        f"{when}: a time step could not be solved even after {halvings} halvings, "
        f"{_imbalance(system, outcome)}; try {smaller}, loads that come on with ramp_time, "
        f"{'obstacles that leave the arm room, ' if caught else ''}"
        "or more simulation.max_halvings"
    )


def _imbalance(system: System, outcome: Outcome) -> str:
    if not np.isfinite(outcome.residual):
        return "forces grew without bound"
    worst, nodes = int(outcome.worst_node), system.rod.nodes
    name = f"node {worst}" if worst < nodes else f"obstacle {system.forces.free[worst - nodes]}"
    return (
        f"{name} is out of balance by {float(outcome.residual):.3g} N "
        f"among forces of up to {float(outcome.scale):.3g} N"
    )
