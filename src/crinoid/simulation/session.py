"""Session: a run whose commands come from a program outside, step by step."""

from __future__ import annotations

import gc
import math
import time
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace

import jax
import numpy as np

from crinoid.actuation import Input
from crinoid.assembly.actuators import ActuatorParameters
from crinoid.assembly.arrays import array
from crinoid.assembly.plan import Parts
from crinoid.assembly.prepared import Prepared
from crinoid.control import ControllerInput, Sensor
from crinoid.diagnostics.control_loop import loop_notes
from crinoid.elements import Element
from crinoid.flow import Flow
from crinoid.foundation.atomic_file import FilePath
from crinoid.foundation.representation import Represented, cut_list, titled, with_units
from crinoid.results.chunks import join
from crinoid.results.dataset import chosen
from crinoid.results.result import Result
from crinoid.scenario import Scenario, ScenarioError, counted, refusal
from crinoid.scenario.library import Source, scenario_of
from crinoid.simulation.chunk import one_instant
from crinoid.simulation.conclusion import conclude, dataset_builder, start_failure
from crinoid.simulation.external import (
    CommandLike,
    ExternalCommand,
    ExternalSignals,
    checked_command,
    inputs_in_words,
)
from crinoid.simulation.lateness import Lateness
from crinoid.simulation.loop import see
from crinoid.simulation.run import SimulationError, begin
from crinoid.simulation.setup import set_up
from crinoid.simulation.sink import Sink, require_space
from crinoid.simulation.stepped_run import SteppedRun, alone

_ATTRIBUTE = "external"  # of a result: the last values from outside, to continue from


class Session(Represented, SteppedRun):
    """A closed loop whose controller is your program: it steps from one command to the next.

    Sensors, noise, delay, servos, limits and target are those of a run of the scenario;
    ``control.kind`` is replaced. What a controller sees, and in which order, is described in
    "Your program in the loop".

    Parameters
    ----------
    scenario : Scenario, str or path
        One case (`crinoid.Scenario.cases`), the name of a built-in scenario, or a file.
    seed : int
        Seed of everything random; that of the scenario if None.
    paced : bool
        Whether each step ends when as much time has passed on the wall clock as in the simulation.
    external : iterable of str
        What else comes from outside: ``"current"``, a uniform current added to the scenario's
        flows, and ``"base"``, a prescribed motion of the base added to its channels.
    elements, flows, sensors, actuators : iterable
        Parts of your own that are added to those of the scenario.
    resume : Result, str or path
        A result of an earlier session of this scenario, or its folder, to continue from its end.

    Raises
    ------
    ScenarioError
        If anything is wrong with the scenario, or the result is of another one.
    ResultError
        If the result cannot be read, or has no state to continue from.
    SimulationError
        If the arm has no equilibrium to start from, or a time step before the first command could
        not be solved.
    ValueError
        If the scenario describes several cases.

    Examples
    --------
    >>> scenario = crinoid.load("still-water", ["arm.nodes=5", "control.start=0"])
    >>> session = crinoid.Session(scenario)
    >>> [each.name for each in session.inputs]
    ['slide', 'tilt']
    >>> seen = session.step({"tilt": 0.1})  # rad
    >>> float(seen.time), seen.measured.shape
    (0.01, (3,))
    """

    def __init__(
        self,
        scenario: Source,
        *,
        seed: int | None = None,
        paced: bool = False,
        external: Iterable[str] = (),
        elements: Iterable[Element] = (),
        flows: Iterable[Flow] = (),
        sensors: Iterable[Sensor] = (),
        actuators: Iterable[ActuatorParameters] = (),
        resume: Result | FilePath | None = None,
    ) -> None:
        given = scenario_of(scenario)
        if seed is not None:
            given = given.with_values({"seed": seed})
        require_space(given, None)
        self.paced = paced
        self._origin: float | None = None  # wall clock at the start (s); None while it pauses
        self._spent = 0.0
        self.late: Lateness
        """Delay behind the wall clock since the start or the last reset, of a paced session."""
        self._signals = signals = ExternalSignals(external, given)
        parts = Parts(
            lambda plan: ExternalCommand(array(np.zeros(len(plan.inputs)))),
            tuple(elements),
            (*flows, *signals.flows),
            tuple(sensors),
            tuple(actuators),
            signals.motions,
        )
        self._prepared = Prepared.with_parts(given, parts)
        self.scenario = self._prepared.scenario
        """The scenario, with ``control.kind`` "custom"."""
        self._setup = setup = set_up(self._prepared)
        self.seen: ControllerInput
        """What a controller sees at the present instant; its arrays are NumPy's."""
        every = setup.loop.system.inputs
        self._rows = np.flatnonzero([each.lower < each.upper for each in every])
        self.inputs: tuple[Input, ...] = tuple(every[row] for row in self._rows)
        """The inputs that can move: those that a command is for, in its order."""
        step, stride = self.scenario.simulation.time_step, self.scenario.output_steps
        super().__init__(stride, math.ceil(1 / (step * stride * given.control_rate_hz)) + 1)
        self._start()
        if trouble := start_failure(setup):
            dataset = self._sink.close(self.state, 0.0)
            raise SimulationError(conclude(setup, self.state, dataset, trouble, None, 0.0))
        self.compile()
        if resume is not None:
            self._resume(resume)
        self._go_to_command()

    @property
    def period(self) -> float:
        """Time between two commands (s)."""
        return 1.0 / self.scenario.control_rate_hz

    @property
    def next_time(self) -> float:
        """Time to which the next step goes (s): a whole number of time steps."""
        return min(self._next, self.scenario.simulation.steps) * self.scenario.simulation.time_step

    @property
    def ended(self) -> str:
        """Reason for which the session has ended; empty while it runs."""
        if self.failed is not None:
            return "a time step failed"
        if self.steps < self.scenario.simulation.steps:
            return ""
        return f"simulation.duration = {self.scenario.simulation.duration:g} s is over"

    def _representation(self) -> tuple[str, dict[str, str]]:
        now = f"at {self.time:g} of {self.scenario.simulation.duration:g} s"
        names, units = ([row[at] for row in self.loop.readings] for at in (0, 1))
        return titled("Session", self.scenario.title, now), {
            "ended": self.ended,
            "inputs": cut_list(inputs_in_words(self.inputs)) or "none",
            "readings": cut_list(with_units(names, units)),
            "command": f"every {self.period:g} s{', paced' if self.paced else ''}",
            "external": ", ".join(self._signals.kinds),
        }

    def __enter__(self) -> Session:
        return self

    def __exit__(self, *_: object) -> None:
        self.pause()

    @alone
    def reset(self) -> ControllerInput:
        """Return to the start.

        Returns
        -------
        ControllerInput
            The input of a controller at its first command.

        Raises
        ------
        SimulationError
            If a time step before the first command could not be solved.
        """
        self._start()
        return self._go_to_command()

    @alone
    def step(
        self,
        command: CommandLike,
        *,
        current: Sequence[float] | None = None,
        base: Mapping[str, float | tuple[float, float]] | None = None,
    ) -> ControllerInput:
        """Hold a command for one control period.

        Parameters
        ----------
        command : array (input), or mapping of str to float
            A number for each of the ``inputs``, in its unit, as an array or by name. Inputs that
            are not named keep their last command. It is limited to the range of each input.
        current : array (axis)
            Velocity of the external current at the end of the period (m/s), which it reaches
            linearly; the last one if None.
        base : mapping of str to float or pair of float
            Displacement of channels of the base at the end of the period (m or rad), or a pair
            with its velocity; that of a straight line by default. Others keep their last one.

        Returns
        -------
        ControllerInput
            The input of a controller at the end of the period.

        Raises
        ------
        ValueError
            If a value has another shape, is not finite, or is for an unknown input or channel.
        RuntimeError
            If the session has ended.
        SimulationError
            If a time step could not be solved; its ``result`` has the computed part.
        """
        if self.ended:
            raise RuntimeError(f"the session has ended: {self.ended}. Call reset().")
        given, before = np.array(self.state.command), self.time
        given[self._rows] = checked_command(command, self.inputs, given[self._rows])
        if self._origin is None:
            if self.paced:  # a search for garbage among all of JAX would stop the loop for 0.2 s
                gc.collect()
                gc.freeze()
            self._origin = time.perf_counter() - before
        self._signals.advance(before, self.next_time, current, base)
        loop = replace(self.loop, controller=ExternalCommand(array(given)))
        self.loop = self._signals.fed(loop)
        seen = self._go_to(min(self._next, self.scenario.simulation.steps))
        if self.paced:
            self.late = self.late.with_step(time.perf_counter() - self._origin - self.time)
            time.sleep(max(0.0, -self.late.last))
        return seen

    @alone
    def pause(self) -> None:
        """Stop the wall clock of a paced session until the next step."""
        self._origin = None

    @alone
    def result(self) -> Result:
        """Return the result so far: that of a run that lasted until now.

        ``result.save`` writes it, and ``Session(scenario, resume=...)`` continues from there.

        Returns
        -------
        Result
        """
        setup, cut = self._setup, self._cut()
        trouble = ""
        if cut is not None:
            setup = setup._replace(prepared=self._prepared.with_scenario(cut))
        elif self.steps < self.scenario.simulation.steps and self.failed is None:
            trouble = f"interrupted at t = {self.time:.6g} s"
        dataset = self._sink.close(self.state, self._spent).copy()
        if int(self.state.tally.steps):  # steps since the last saved instant
            angle = float(dataset["tip_angle"][-1])
            last = dataset_builder(setup)(one_instant(self.record()), angle)
            dataset = join([dataset, last])
        found = conclude(setup, self.state, dataset, trouble, self.failed, self._spent)
        notes = [*found.notes, *loop_notes(found)]
        if late := self.late.late:
            text = f"{late} of {counted(self.late.steps, 'paced step')} ended late"
            notes.append(f"{text}, by at most {1e3 * self.late.largest:.3g} ms")
        found.dataset.attrs["notes"] = "\n".join(notes)
        if self.ended:  # else it may be continued, which needs all variables
            found.dataset = chosen(found.dataset, self.scenario.output.variables)
        found.dataset.attrs[_ATTRIBUTE] = self._signals.to_json()
        return found

    def _start(self) -> None:
        self.loop, self.failed = self._setup.loop, None
        self.state, first = begin(self.loop, self._setup.state)
        self._sink = Sink(one_instant(first), dataset_builder(self._setup), None)
        self._signals = ExternalSignals(self._signals.kinds, self.scenario)
        self._origin, self._spent = None, 0.0
        self.late = Lateness()

    def _go_to_command(self) -> ControllerInput:
        """Advance to the present or the first command."""
        _, due, _ = see(self.loop, self.state, self._rows)
        return self._go_to(min(int(due), self.scenario.simulation.steps))

    def _go_to(self, end: int) -> ControllerInput:
        """Advance to a time step; return what a controller sees."""
        started = time.perf_counter()
        while self.steps < end and self.failed is None:
            if (some := self.advance_to(end)) is not None:
                self._sink.append(some)
        found, _, following = see(self.loop, self.state, self._rows)
        self._next = int(following)
        self.seen = jax.tree.map(np.asarray, found)
        self._spent += time.perf_counter() - started
        if self.failed is not None:
            raise SimulationError(self.result())
        return self.seen

    def _cut(self) -> Scenario | None:
        """Return the scenario of a run that lasts until now; None if there is none."""
        values: dict[str, float] = {"control.compare": False}
        if not self.ended:
            values["simulation.duration"] = float(f"{self.time:.10g}")
        with suppress(ScenarioError):  # such as no time at all
            return self.scenario.with_values(values)
        return None

    def _resume(self, given: Result | FilePath) -> None:
        """Continue from a result of an earlier session."""
        earlier = given if isinstance(given, Result) else Result.load(given)
        described = earlier.scenario
        values = {
            "simulation.duration": self.scenario.simulation.duration,
            "control.compare": self.scenario.control.compare,
        }
        if described.with_values(values) != self.scenario:
            text = "got a result of another scenario"
            raise refusal("resume", text, "be of a session of this one")
        self.state, self._spent = self._sink.resume(earlier, self.state, self._stride)
        try:
            self._signals.from_json(str(earlier.dataset.attrs.get(_ATTRIBUTE)))
        except ValueError as error:
            text = f"got a result with {error}"
            raise refusal("resume", text, "be of a session with the same external") from None
        self.loop = self._signals.fed(self.loop)
