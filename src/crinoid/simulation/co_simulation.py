"""Co-simulation: an arm that another program steps, with variables by name."""

import math
from typing import Any

import numpy as np

from crinoid.assembly.prepared import Prepared
from crinoid.foundation.axes import AXES
from crinoid.results.chunks import unwrap_from
from crinoid.scenario import Scenario, got, refusal
from crinoid.simulation.external import moved_channels
from crinoid.simulation.host_variables import DURATION, inputs_of, outputs_of, parameters_of
from crinoid.simulation.session import Session

_NEAR = 1e-6  # share of a control period by which times may differ
_ROUND_OFF = 1e-9  # share of the time by which they may differ, as hosts sum them up


class CoSimulation:
    """An arm that a host steps from one communication point to the next.

    The host sets parameters before the first step. Commands hold over a communication step. The
    external current and the motion of the base reach their values in its first control period.

    Raises
    ------
    ScenarioError
        If anything is wrong with the scenario, it has several cases, or its control period is no
        multiple of the time step.
    """

    def __init__(self, scenario: Scenario) -> None:
        if scenario.vary:
            raise refusal("vary", "is of several cases. Choose one with --set and leave out vary.")
        # the host is the controller, from the start on
        given = scenario.with_values({"control.start": 0.0})
        rate, step = given.control_rate_hz, given.simulation.time_step
        self.period = round(1 / (rate * step)) * step
        """Time between two commands (s): the shortest communication step."""
        if abs(self.period * rate - 1) > _NEAR:
            must = f"have a period that is a multiple of simulation.time_step, {step:g} s"
            raise refusal("control.rate_hz", got(rate, must))
        # exactly, as a difference adds up over many periods
        self._scenario = given = given.with_values({"control.rate_hz": 1 / self.period})
        prepared = Prepared(given)
        prepared.check()
        self.inputs = inputs_of(prepared)
        """Inputs, all numbers."""
        self.parameters = parameters_of(given)
        self._quantities = outputs_of(prepared)
        self.outputs = [each for some in self._quantities for each in some.variables]
        """Outputs: numbers, and the array ``shape`` (node, axis)."""
        self._given = {each.name: each.start for each in self.parameters}
        self._values: dict[str, Any] = self._given | {each.name: each.start for each in self.inputs}
        self._axes = AXES[given.arm.dimension]
        self._channels = () if given.floats else moved_channels(given)
        self._session: Session | None = None
        self._found: dict[str, Any] | None = None
        self._angle: float | None = None
        self._periods = 0

    @property
    def time(self) -> float:
        """Time since the start (s)."""
        return self._periods * self.period

    def get(self, name: str) -> Any:
        """Return the value of a variable, an array for ``shape``."""
        if name in self._values:
            return self._values[name]
        if self._found is None:
            self._found = self._observed()
        return self._found[name]

    def set(self, name: str, value: float | int) -> None:
        """Set an input, or a parameter before the first step.

        Raises
        ------
        RuntimeError
            If a parameter is set later.
        """
        if name in self._given and value != self._values[name]:
            if self._periods:
                raise RuntimeError(f"{name}: got {value} after the start; must be set before it")
            self._session = self._found = self._angle = None
        self._values[name] = value

    def start(self) -> Session:
        """Return the session with the present parameters; the first call compiles it.

        Raises
        ------
        ScenarioError
            If a parameter is refused.
        SimulationError
            If the arm has no equilibrium to start from.
        """
        if self._session is None:
            external = ["current", "base"] if self._channels else ["current"]
            values = {name: self._values[name] for name in self._given}
            changed = {name: value for name, value in values.items() if value != self._given[name]}
            self._session = Session(self._scenario.with_values(changed), external=external)
        return self._session

    def advance(self, time: float, step: float) -> None:
        """Advance by a communication step (s) from a communication point (s).

        Raises
        ------
        ValueError
            If the step is no multiple of the control period, the time is not that of the arm, or
            an input is not finite.
        RuntimeError
            If a time step fails, or the duration ends within the step.
        """
        session, ratio = self.start(), step / self.period
        count = round(ratio) if math.isfinite(ratio) else 0
        if count < 1 or abs(ratio - count) > _NEAR * count:
            must = f"be a multiple of the control period, {self.period:g} s"
            raise ValueError(f"communication step: {got(step, must)}")
        if not abs(time - self.time) <= _NEAR * self.period + _ROUND_OFF * self.time:
            must = f"be {self.time:.10g} s, the time of the arm, which starts at 0"
            raise ValueError(f"communication point: {got(time, must)}")
        duration = session.scenario.simulation.duration
        if (self._periods + count - _NEAR) * self.period > duration:
            text = f"{DURATION} = {duration:g} s ends before {time + step:.10g} s"
            raise RuntimeError(f"{text}. Set this parameter before the start.")
        given = self._values
        command = {each.name: given.get(f"command_{each.name}", 0.0) for each in session.inputs}
        current = [given[f"current_{axis}"] for axis in self._axes]
        # at rest after the first of several periods, in which it holds
        base = {
            name: (given[f"base_{name}"], 0.0) if count > 1 else given[f"base_{name}"]
            for name in self._channels
        }
        self._found = None
        for _ in range(count):
            session.step(command, current=current, base=base or None)
            self._periods += 1

    def _observed(self) -> dict[str, Any]:
        """Return the outputs at the present instant."""
        session = self.start()
        record = session.record()
        found: dict[str, Any] = {}
        for each in self._quantities:
            found |= each.values(session, record)
        if "tip_angle" in found:  # turns on and on, as in results
            angle = np.array([found["tip_angle"]])
            found["tip_angle"] = self._angle = float(unwrap_from(angle, self._angle)[0])
        return found
