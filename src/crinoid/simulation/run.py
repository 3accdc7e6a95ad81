"""Running a scenario: chunks of compiled time, with progress and interruption between them."""

import time
from collections.abc import Callable, Iterable
from contextlib import nullcontext
from pathlib import Path
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from crinoid.assembly.actuator import ActuatorParameters
from crinoid.assembly.parts import Parts
from crinoid.assembly.plan import Plan
from crinoid.assembly.prepared import Prepared
from crinoid.control import Controller, Sensor
from crinoid.dataset import chosen
from crinoid.dynamics import State, System
from crinoid.elements import Element
from crinoid.flow import Flow
from crinoid.loop_health import loop_notes
from crinoid.plausibility import AT_REST, doubts
from crinoid.programs import ONCE, compiled
from crinoid.record import Record
from crinoid.result import RESULT, UNCONTROLLED, UNFINISHED, Result
from crinoid.scenario import Scenario
from crinoid.scenario.library import Source, scenario_of
from crinoid.simulation.ahead import compile_ahead
from crinoid.simulation.conclusion import attributes_of, builder, conclude
from crinoid.simulation.continuation import restored
from crinoid.simulation.ctrl_c import CtrlC
from crinoid.simulation.failure import start_failure
from crinoid.simulation.loop import Loop, LoopState
from crinoid.simulation.room import check_room
from crinoid.simulation.setup import Setup, require_one_case, set_up
from crinoid.simulation.sink import Sink
from crinoid.simulation.stretch import CAPACITY, begun_with, one_instant, record, stretch

_CHUNK_SECONDS = 0.25


class Progress(NamedTuple):
    """How far a run is."""

    label: str
    """Which run: controlled, uncontrolled or, where nothing is controlled, simulated."""
    time: float
    """Simulated time so far (s)."""
    duration: float
    """Simulated time in all (s)."""
    elapsed: float
    """Time that it took so far (s)."""


Report = Callable[[Progress], None]
Tell = Callable[[list[str]], None]


class SimulationError(RuntimeError):
    """A run that could not be finished. ``result`` holds what was computed."""

    def __init__(self, result: Result) -> None:
        super().__init__(result.failure)
        self.result = result


def simulate(
    scenario: Source,
    *,
    controller: Controller | Callable[[Plan], Controller] | None = None,
    elements: Iterable[Element] = (),
    flows: Iterable[Flow] = (),
    sensors: Iterable[Sensor] = (),
    actuators: Iterable[ActuatorParameters] = (),
    report: Report | None = None,
) -> Result:
    """Run a scenario; with a controller and ``control.compare``, also the same case without it.

    Parameters
    ----------
    scenario
        What to run: a scenario, the name of a built-in one, or a file.
    controller
        One of your own in place of the scenario's, or a function that builds it from what is known
        at the start. The result's scenario has ``control.kind = "custom"``.
    elements, flows, sensors, actuators
        Parts of your own that are added to those of the scenario.
    report
        Called between chunks of the run with a `crinoid.simulation.Progress`.

    Raises
    ------
    SimulationError
        If a time step or the equilibrium at the start could not be solved.
    ScenarioError
        If a file that the scenario names is not what it takes.
    ValueError
        If the scenario stands for several cases (`crinoid.Scenario.cases`), or an element has
        windows that the arm has no nodes for.
    """
    parts = Parts(controller, tuple(elements), tuple(flows), tuple(sensors), tuple(actuators))
    if controller is not None:
        scenario = scenario_of(scenario).with_values({"control.kind": "custom"})
    result = play(Prepared(scenario, parts), report=report)
    if result.failure:
        raise SimulationError(result)
    return result


def play(
    prepared: Prepared,
    *,
    report: Report | None = None,
    resume: Result | None = None,
    stop: Callable[[], bool] | None = None,
    tell: Tell | None = None,
    into: Path | None = None,
) -> Result:
    """Run a scenario to its end, a failure or an interruption; `Result.status` says which.

    Parameters
    ----------
    prepared
        The scenario to run.
    report
        Called between chunks of the run with a `crinoid.simulation.Progress`.
    resume
        An earlier result of the same scenario, to continue from where it stopped; its duration may
        have grown.
    stop
        Asked before each chunk of the run whether to interrupt it; Ctrl-C does by default.
    tell
        Called before the run with notes on the loop, if it is unstable or nearly so.
    into
        The folder of files that take the run while it lasts, so that it neither fills the memory
        nor is lost; none to hold it in memory. What is large of the result stays there until
        `Result.save` replaces these files.
    """
    scenario = prepared.scenario
    require_one_case(scenario)
    check_room(scenario, into)
    controlled = scenario.control.kind != "none"
    label = "controlled" if controlled else "simulated"
    with CtrlC() if stop is None else nullcontext(stop) as asked:
        compile_ahead(prepared)
        setup = set_up(prepared)
        if tell is not None and setup.loop_doubts:
            tell(setup.loop_doubts)
        path = None if into is None else into / RESULT
        result = _run(prepared, setup, label, report, resume, asked, path)
        if controlled and scenario.control.compare:
            idle = without_control(setup)
            earlier = resume.uncontrolled if resume is not None else None
            path = None if into is None else into / UNCONTROLLED
            result.uncontrolled = _run(prepared, idle, "uncontrolled", report, earlier, asked, path)
    return rounded_off(result)


def without_control(setup: Setup) -> Setup:
    """Return the same case with the controller off."""
    loop = eqx.tree_at(lambda loop: loop.enabled, setup.loop, jnp.asarray(False))
    return setup._replace(loop=loop, loop_doubts=[])


def rounded_off(result: Result) -> Result:
    """Say of a run, and the one without control, how the loop did; leave out what is not wanted."""
    result.dataset.attrs["notes"] = "\n".join([*result.notes, *loop_notes(result)])
    if not result.interrupted:  # else what is to go on needs all
        variables = result.scenario.output.variables
        for run in (result, result.uncontrolled):
            if run is not None:
                run.dataset = chosen(run.dataset, variables)
    return result


def equilibrium(scenario: Source) -> Result:
    """Find the static equilibrium of a scenario at time zero: a result with one instant.

    Raises
    ------
    SimulationError
        If none was found.
    ScenarioError
        If a file that the scenario names is not what it takes.
    ValueError
        If the scenario stands for several cases (`crinoid.Scenario.cases`).
    """
    described = scenario_of(scenario)
    require_one_case(described)
    return settle(Prepared(at_rest(described)))


def settle(prepared: Prepared) -> Result:
    """Find the static equilibrium of a scenario that `at_rest` gave."""
    begun = time.perf_counter()
    setup = set_up(prepared)._replace(doubts=doubts(prepared, AT_REST))
    carry, first = begin(setup.loop, _stand(setup.loop.system, setup.state))
    wall_time = time.perf_counter() - begun
    trouble = start_failure(prepared.scenario, setup.loop.system, setup.outcome)
    dataset = builder(prepared, setup)(one_instant(first), None)
    result = conclude(prepared, setup, carry, dataset, trouble, None, wall_time)
    if result.failure:
        raise SimulationError(result)
    return result


def at_rest(scenario: Scenario) -> Scenario:
    """Return the scenario of which the result of `equilibrium` tells."""
    still: dict[str, object] = {
        "simulation.start": "equilibrium",
        "control.kind": "none",
        "output.variables": None,  # of one instant all are saved
    }
    if scenario.target.feed_forward:
        still["target.feed_forward"] = False
    return scenario.with_values(still)


def _run(
    prepared: Prepared,
    setup: Setup,
    label: str,
    report: Report | None,
    earlier: Result | None,
    stop: Callable[[], bool],
    path: Path | None,
) -> Result:
    scenario, loop = prepared.scenario, setup.loop
    stride = scenario.output_steps
    duration, total = scenario.simulation.duration, scenario.simulation.steps
    carry, first = begin(loop, setup.state)
    build = builder(prepared, setup)
    sink = Sink(one_instant(first), build, path, attributes_of(prepared, UNFINISHED, 0.0, []))
    spent = 0.0
    if earlier is not None:
        carry, held = restored(earlier, carry, build(one_instant(first), None), stride)
        spent = earlier.dataset.attrs["wall_time"]
        sink.go_on(held, carry, spent)
    done, chunk = int(carry.steps), 16
    trouble, failed = start_failure(scenario, loop.system, setup.outcome), None
    if done < total and not trouble:
        # a stretch of nothing: compiles, so that what follows is timed without it
        jax.block_until_ready(stretch(loop, carry, carry.steps, jnp.asarray(stride, int), CAPACITY))
    begun = time.perf_counter() - spent
    while done < total and not (trouble or failed or stop()):
        chunk_begun = time.perf_counter()
        steps = min(chunk, total - done, stride * CAPACITY)
        done += steps
        carry, kept, new, outcome = stretch(
            loop, carry, jnp.asarray(done, int), jnp.asarray(stride, int), CAPACITY
        )
        count = int(new)
        sink.append(jax.tree.map(lambda x: np.asarray(x)[:count], kept))  # noqa: B023
        took = time.perf_counter() - chunk_begun
        chunk = max(1, int(min(steps * _CHUNK_SECONDS / took, 16 * chunk)))
        if not outcome.converged:
            failed = outcome
        sink.look(carry, time.perf_counter() - begun)
        if report is not None:
            elapsed = time.perf_counter() - begun
            report(Progress(label, float(carry.state.time), duration, elapsed))
    wall_time = time.perf_counter() - begun
    if int(carry.tally.steps):  # steps that no kept instant tells of yet
        sink.append(one_instant(_keep(loop, carry)))
    if done < total and not (trouble or failed):
        trouble = f"interrupted at t = {float(carry.state.time):.6g} s"
    dataset = sink.close(carry, wall_time)
    return conclude(prepared, setup, carry, dataset, trouble, failed, wall_time)


@compiled(**ONCE)
def _stand(system: System, state: State) -> State:
    return system.stand(state)


@compiled(**ONCE)
def begin(loop: Loop, state: State) -> tuple[LoopState, Record]:
    """Close a loop around a state; return that with its first instant."""
    return begun_with(loop, state)


_keep = compiled(**ONCE)(record)
