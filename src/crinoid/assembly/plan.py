"""An assembled scenario: all that a controller is built from, and the mapping of errors."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Array, Float

from crinoid.actuation import Input
from crinoid.assembly.actuators import ActuatorParameters
from crinoid.assembly.door import check_element, check_flow
from crinoid.assembly.parameters import Parameters
from crinoid.base import BaseMotion
from crinoid.compilation import ONCE, compiled
from crinoid.control import Allocation, Controller, Sensor, Target, damped_inverse
from crinoid.dynamics import Outcome, State, System
from crinoid.elements import Element
from crinoid.flow import Flow
from crinoid.foundation.axes import POSE
from crinoid.scenario import Mistake, Scenario, ScenarioError, one_of, refusal, shown

if TYPE_CHECKING:
    from crinoid.recording import Recording


@dataclass(frozen=True)
class Parts:
    """Parts in Python that are added to those of a scenario."""

    controller: Controller | Callable[[AssembledScenario], Controller] | None = None
    """In place of the scenario's; a function builds it when the start is known."""
    elements: tuple[Element, ...] = ()
    flows: tuple[Flow, ...] = ()
    sensors: tuple[Sensor, ...] = ()
    actuators: tuple[ActuatorParameters, ...] = ()
    motions: tuple[BaseMotion, ...] = ()  # of the base

    def added(self, system: System) -> System:
        """Return a system with the motions, and the elements and flows if they pass the door."""
        forces = system.forces
        for index, flow in enumerate(self.flows, len(forces.water.flows)):
            check_flow(flow, f"flow {index}", forces.axes)
        for index, element in enumerate(self.elements, len(forces.elements)):
            check_element(element, f"element {index}", system)
        water = replace(forces.water, flows=(*forces.water.flows, *self.flows))
        elements = (*forces.elements, *self.elements)
        forces = replace(forces, elements=elements, water=water)
        base = replace(system.base, motions=(*system.base.motions, *self.motions))
        return replace(system, forces=forces, base=base)


@compiled(**ONCE)
def find_state(system: System, loaded: bool) -> tuple[State, Outcome]:
    """Return the state that an arm starts from, in equilibrium with its loads or without any."""
    if loaded:
        return system.find_equilibrium()
    return system.rest(), Outcome.of_nothing(converged=True)


_ROUND_OFF = 1e-9
"""Movement of the tip over that of a channel, turns at the arm's length, below round-off."""
_NO_RESPONSE = 1e-6  # response of an input to an error, over the largest one, that counts as zero


@dataclass(frozen=True)
class AssembledScenario:
    """A scenario with its system, initial state, sensors and target.

    Attributes
    ----------
    scenario
        Scenario of the run.
    parameters
        The numbers of the scenario.
    system
        The arm, its base and the water as arrays.
    state
        The arm at the start.
    jacobian
        Static Jacobian of the tip's pose by the inputs; None where the scenario maps errors
        one to one.
    sensors
        The sensors, that of the tip first.
    target
        Where the tip should be.
    current
        Mean velocity of the water (m/s).
    recordings
        Measured currents by their index in ``flow``.
    first_period
        Period of the arm's slowest vibration (s): the unit of a controller's own times.

    Examples
    --------
    A function that builds a controller receives it:

    >>> def build(assembled):
    ...     print(assembled.period, [each.name for each in assembled.inputs])
    ...     return crinoid.control.Idle()
    >>> scenario = crinoid.load("still-water", ["arm.nodes=5"])
    >>> loop, state = crinoid.closed_loop(scenario, controller=build)
    0.01 ['slide', 'heave', 'tilt']
    """

    scenario: Scenario
    parameters: Parameters
    system: System
    state: State
    jacobian: Float[Array, "pose input"] | None
    sensors: tuple[Sensor, ...]
    target: Target
    current: tuple[float, ...]
    recordings: Mapping[int, Recording]
    first_period: float

    def check_names(self) -> None:
        """Refuse two sensors, or two inputs, of one name."""
        for words, parts in (("sensors", self.sensors), ("inputs", self.inputs)):
            names = [each.name for each in parts]
            twice = sorted({name for name in names if names.count(name) > 1})
            if twice:
                text = f"two {words} are called {' and '.join(twice)}; names must be unique"
                raise ValueError(text)

    @property
    def readings(self) -> tuple[str, ...]:
        """Names of the sensors other than that of the tip (`crinoid.ControllerInput.readings`)."""
        return tuple(sensor.name for sensor in self.sensors[1:])

    @cached_property
    def inputs(self) -> tuple[Input, ...]:
        """The inputs that the controller commands."""
        return self.system.inputs

    @property
    def limits(self) -> Float[np.ndarray, "2 input"]:
        """Smallest and largest command of each input, in its unit."""
        pairs = [(float(each.lower), float(each.upper)) for each in self.inputs]
        return np.reshape(pairs, (-1, 2)).T

    @property
    def controlled(self) -> tuple[list[int], Float[np.ndarray, " coordinate"]]:
        """Indices of the controlled coordinates, and lengths that turn their errors into metres."""
        axes = self.scenario.arm.dimension
        # a direction in space has three coordinates
        columns = [
            column
            for name in self.scenario.control.controlled
            for column, coordinate in enumerate(POSE[axes])
            if coordinate == name or coordinate.startswith(f"{name}_")
        ]
        return columns, np.where(np.asarray(columns) < axes, 1.0, self.scenario.arm.length)

    @property
    def period(self) -> float:
        """Time between two commands (s)."""
        return 1.0 / self.scenario.control_rate_hz

    def mapping(
        self, driven: Iterable[str], weights: Mapping[str, float] | None = None
    ) -> Float[np.ndarray, "input pose"]:
        """Return the displacement of each input per error of the tip's pose.

        In the unit of the input over m, rad or, of a direction in space, 1. The damped inverse of
        the static Jacobian for the inputs named in ``driven``, or one to one with
        ``control.mapping = "identity"``; the others do nothing. Of more inputs than needed each
        does its share: the sum of squared commands over ``weights`` is least.

        Parameters
        ----------
        driven : iterable of str
            Names of inputs.
        weights : mapping of str to float
            Weights of inputs by name; 1 of those left out.

        Returns
        -------
        array (input, pose)

        Raises
        ------
        ScenarioError
            If a driven input moves no controlled coordinate.
        """
        mapping = np.zeros((len(self.inputs), len(POSE[self.scenario.arm.dimension])))
        names = list(driven)
        rows = self.rows(names)
        if self.jacobian is None:
            # x with slide, z with heave, angle with tilt; in space x, y, z with slide, sway, heave
            mapping[rows, rows] = 1.0
            return mapping
        columns, scale = self.controlled
        weight = _values_of(names, weights, 1.0)
        scaled = scale[:, None] * self._tip_response(rows, columns, self.jacobian)
        scaled[np.abs(scaled) < _ROUND_OFF] = 0.0
        inverse = damped_inverse(scaled)
        self._check_use(names, inverse * scale)
        # the same effect on the tip by the least weighted commands: weights do not damp
        inverse = weight[:, None] * np.linalg.pinv(scaled * weight, _ROUND_OFF) @ scaled @ inverse
        mapping[np.ix_(rows, columns)] = inverse * scale
        return mapping

    def allocation(
        self,
        driven: Iterable[str],
        weights: Mapping[str, float] | None = None,
        release: Mapping[str, float] | None = None,
    ) -> Allocation | None:
        """Return how the driven inputs share the work; None if there are no more than needed.

        ``release`` are the rates (1/s) at which inputs go back to rest; none if left out.

        Raises
        ------
        ScenarioError
            If there is no such input.
        """
        names = list(driven)
        rows = self.rows(names)
        if self.jacobian is None:
            return None
        columns, lengths = self.controlled
        response = self._tip_response(rows, columns, self.jacobian)
        if len(rows) <= len(columns):
            return None
        count, size = len(self.inputs), len(POSE[self.scenario.arm.dimension])
        jacobian, scale = np.zeros((size, count)), np.ones(size)
        weight, rate = np.zeros(count), np.zeros(count)
        jacobian[np.ix_(columns, rows)], scale[columns] = response, lengths
        weight[rows] = _values_of(names, weights, 1.0)
        rate[rows] = _values_of(names, release, 0.0)
        return Allocation.of(jacobian, scale, weight, rate)

    def rows(self, driven: Iterable[str]) -> list[int]:
        """Return the indices of inputs.

        Raises
        ------
        ScenarioError
            If there is no such input.
        """
        names = [each.name for each in self.inputs]
        unknown = [name for name in driven if name not in names]
        if unknown:
            text = f"got {shown(unknown[0])} as an input; must be {one_of(names)}"
            raise refusal(f"control.{self.scenario.control.kind}", text)
        return [names.index(name) for name in driven]

    def _tip_response(
        self, rows: list[int], columns: list[int], jacobian: Float[Array, "pose input"]
    ) -> Float[np.ndarray, "coordinate driven"]:
        """Return the static response of coordinates to inputs, by their indices."""
        needed = np.asarray(jacobian)[np.ix_(columns, rows)]
        if not np.isfinite(needed).all():
            text = (
                'got "static-jacobian", but nothing brings this arm back to rest, so its tip '
                'does not follow the base. Set "identity", or give the arm a clamp or a weight.'
            )
            raise refusal("control.mapping", text)
        return needed

    def _check_use(self, names: list[str], inverse: Float[np.ndarray, "input coordinate"]) -> None:
        """Refuse to drive inputs that move no controlled coordinate."""
        most = np.abs(inverse).max(axis=1)
        scenario = self.scenario
        wound = {name for name, each in scenario.threads.items() if each.drive == "length"}
        mistakes = [
            Mistake(
                f"control.{scenario.control.kind}.{name}",
                f"does nothing: no controlled coordinate follows {name} from the start. "
                "Drive an input that moves the tip"
                + (", or make the tendon taut by its schedule." if name in wound else "."),
            )
            for name, share in zip(names, most, strict=True)
            if share <= _NO_RESPONSE * most.max()
        ]
        if mistakes:
            raise ScenarioError(mistakes)


def _values_of(
    names: list[str], numbers: Mapping[str, float] | None, default: float
) -> Float[np.ndarray, " input"]:
    return np.array([(numbers or {}).get(name, default) for name in names])
