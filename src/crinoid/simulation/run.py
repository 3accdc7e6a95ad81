"""Running a scenario: chunks of compiled time, with progress and interruption between them."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable, Iterable
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np

from crinoid.assembly.actuators import ActuatorParameters
from crinoid.assembly.plan import AssembledScenario, Parts
from crinoid.assembly.prepared import Prepared
from crinoid.compilation import ONCE, compiled
from crinoid.control import Controller, Sensor
from crinoid.diagnostics.control_loop import loop_notes
from crinoid.elements import Element
from crinoid.flow import Flow
from crinoid.results.dataset import chosen
from crinoid.results.result import RESULT, UNCONTROLLED, Result
from crinoid.scenario.library import Source
from crinoid.simulation.chunk import CAPACITY, chunk_program, one_instant, record, start_loop
from crinoid.simulation.conclusion import conclude, dataset_builder, start_failure
from crinoid.simulation.setup import Setup, set_up
from crinoid.simulation.sink import Sink, require_space

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
    """A run that failed. ``result`` contains its computed part.

    Parameters
    ----------
    result : Result
        The run, whose ``failure`` is the message.

    Examples
    --------
    >>> scenario = crinoid.load("still-water", ["arm.nodes=5", "load.0.force=[0, 1e5]"])
    >>> try:
    ...     crinoid.simulate(scenario)
    ... except crinoid.SimulationError as error:
    ...     print(error.result.status[:17])
    failed at t = 0 s
    """

    def __init__(self, result: Result) -> None:
        super().__init__(result.failure)
        self.result = result


def simulate(
    scenario: Source,
    *,
    controller: Controller | Callable[[AssembledScenario], Controller] | None = None,
    elements: Iterable[Element] = (),
    flows: Iterable[Flow] = (),
    sensors: Iterable[Sensor] = (),
    actuators: Iterable[ActuatorParameters] = (),
    report: Report | None = None,
) -> Result:
    """Run a scenario; with a controller and ``control.compare``, also the same case without it.

    Parameters
    ----------
    scenario : Scenario, str or path
        What to run: a scenario, the name of a built-in one, or a file.
    controller : Controller or function
        A controller to replace the scenario's, or a function that builds it from the assembled
        scenario at the start. The result's scenario has ``control.kind = "custom"``.
    elements, flows, sensors, actuators : iterable
        Parts of your own that are added to those of the scenario.
    report : function
        Called between chunks of the run with a `crinoid.simulation.Progress`.

    Returns
    -------
    Result

    Raises
    ------
    SimulationError
        If a time step or the equilibrium at the start could not be solved.
    ScenarioError
        If a file that the scenario names is not valid.
    ValueError
        If the scenario describes several cases (`crinoid.Scenario.cases`), or an element has
        windows that the arm has no nodes for.

    Examples
    --------
    >>> scenario = crinoid.load("still-water", ["arm.nodes=5", "simulation.duration=0.2"])
    >>> result = crinoid.simulate(scenario)
    >>> result.status
    'ok'
    >>> result.dataset.tip_position[-1].round(2).values.tolist()  # x, z (m)
    [0.46, -9.83]
    """
    parts = Parts(controller, tuple(elements), tuple(flows), tuple(sensors), tuple(actuators))
    result = play(Prepared.with_parts(scenario, parts), report=report)
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
    steps: int | None = None,
    notes: bool = True,
    idle_notes: bool = True,
) -> Result:
    """Run a scenario to its end, a failure or an interruption; `Result.status` says which.

    ``resume`` is an earlier result of the same scenario, to continue from where it stopped; its
    duration may have grown. Between chunks of the run, ``report`` is called with a
    `crinoid.simulation.Progress`, and ``stop`` is asked whether to interrupt it; Ctrl-C does by
    default. ``tell`` is called before the run with notes on a loop that is unstable or nearly so.

    Files in the folder ``into`` grow while the run lasts, so that it neither fills the memory nor
    is lost. Large variables stay there until `Result.save` replaces these files. By the time
    ``steps`` of all runs of such a scenario `crinoid.simulation.chunk.chunk_program` chooses their
    program; those of this run if left out. Without ``notes`` the scenario and its loop are not
    judged, without ``idle_notes`` the run without control.
    """
    scenario = prepared.scenario
    steps = scenario.simulation.steps if steps is None else steps
    require_space(scenario, into)
    label = "controlled" if scenario.control.acts else "simulated"
    with CtrlC() if stop is None else nullcontext(stop) as asked:
        setup = set_up(prepared, notes=notes)
        if tell is not None and setup.loop_warnings:
            tell(setup.loop_warnings)
        path = None if into is None else into / RESULT
        result = _run(setup, label, report, resume, asked, path, steps)
        if scenario.control.compared:
            idle = without_control(setup)
            earlier = resume.uncontrolled if resume is not None else None
            path = None if into is None else into / UNCONTROLLED
            label = "uncontrolled"
            result.uncontrolled = _run(
                idle, label, report, earlier, asked, path, steps, with_notes=idle_notes
            )
    return with_loop_notes(result)


def without_control(setup: Setup) -> Setup:
    """Return the same case with the controller off."""
    loop = replace(setup.loop, enabled=jax.device_put(np.asarray(False)))
    return setup._replace(loop=loop, loop_warnings=[])


def with_loop_notes(result: Result) -> Result:
    """Add the notes on the loop to a run, and leave out variables that its scenario leaves out."""
    result.dataset.attrs["notes"] = "\n".join([*result.notes, *loop_notes(result)])
    if not result.interrupted:  # a run to resume needs all
        variables = result.scenario.output.variables
        for run in (result, result.uncontrolled):
            if run is not None:
                run.dataset = chosen(run.dataset, variables)
    return result


def _run(
    setup: Setup,
    label: str,
    report: Report | None,
    earlier: Result | None,
    stop: Callable[[], bool],
    path: Path | None,
    steps_in_all: int,
    *,
    with_notes: bool = True,
) -> Result:
    scenario, loop = setup.scenario, setup.loop
    stride, run_chunk = scenario.output_steps, chunk_program(steps_in_all)
    every = jax.device_put(np.asarray(stride))
    duration, total = scenario.simulation.duration, scenario.simulation.steps
    carry, first = begin(loop, setup.state)
    sink = Sink(one_instant(first), dataset_builder(setup), path)
    spent = 0.0
    if earlier is not None:
        carry, spent = sink.resume(earlier, carry, stride)
    done, chunk = int(carry.steps), 16
    trouble, failed = start_failure(setup), None
    if done < total and not trouble:
        # a chunk without steps compiles, so that the wall time leaves it out
        jax.block_until_ready(run_chunk(loop, carry, carry.steps, every, CAPACITY))
    started = time.perf_counter() - spent
    while done < total and not (trouble or failed or stop()):
        chunk_begun = time.perf_counter()
        steps = min(chunk, total - done, stride * CAPACITY)
        done += steps
        end = jax.device_put(np.asarray(done))
        carry, kept, new, outcome = run_chunk(loop, carry, end, every, CAPACITY)
        sink.append(kept.first(int(new)))
        took = time.perf_counter() - chunk_begun
        chunk = max(1, int(min(steps * _CHUNK_SECONDS / took, 16 * chunk)))
        if not outcome.converged:
            failed = outcome
        sink.look(carry, time.perf_counter() - started)
        if report is not None:
            elapsed = time.perf_counter() - started
            report(Progress(label, float(carry.state.time), duration, elapsed))
    wall_time = time.perf_counter() - started
    if int(carry.tally.steps):  # steps since the last saved instant
        sink.append(one_instant(_keep(loop, carry)))
    if done < total and not (trouble or failed):
        trouble = f"interrupted at t = {float(carry.state.time):.6g} s"
    dataset = sink.close(carry, wall_time)
    return conclude(setup, carry, dataset, trouble, failed, wall_time, with_notes=with_notes)


begin = compiled(**ONCE)(start_loop)
"""`start_loop` as a program."""
_keep = compiled(**ONCE)(record)


class CtrlC:
    """Turns the first Ctrl-C into a request to stop after the chunk that is running."""

    def __init__(self) -> None:
        self._asked = False

    def __call__(self) -> bool:
        """Tell whether to stop."""
        return self._asked

    def __enter__(self) -> CtrlC:
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
