"""Everything that a controller is built from."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from jaxtyping import Array, Float

from crinoid.actuation import Input
from crinoid.assembly.parameters import Parameters
from crinoid.control import Allocation, Sensor, Target, damped_inverse
from crinoid.dynamics import State, System
from crinoid.scenario import Mistake, Scenario, ScenarioError, one_of
from crinoid.space import POSE

if TYPE_CHECKING:
    from crinoid.recording import Recording  # xarray, slow to load

_ROUND_OFF = 1e-9
"""Movement of the tip over that of a channel, turns at the arm's length, that is none."""
_UNUSED = 1e-6
"""Answer of a channel to an error, over that of the channel that answers most: none at all."""


class _Answer(NamedTuple):
    """How what is controlled answers to the inputs that are driven."""

    rows: list[int]
    """Indices of the inputs."""
    columns: list[int]
    """Indices of the coordinates that are controlled, and what makes errors of them metres."""
    jacobian: Float[np.ndarray, "coordinate input"]
    scale: Float[np.ndarray, " coordinate"]
    """Length that makes an error of a coordinate one in metres."""


@dataclass(frozen=True)
class Plan:
    """An arm at its start, and what is wanted of its controller."""

    scenario: Scenario
    """The scenario that is run."""
    parameters: Parameters
    """The numbers of the scenario."""
    system: System
    """The arm, its base and the water as arrays."""
    state: State
    """The arm at the start."""
    jacobian: Float[Array, "pose input"] | None
    """How the tip's pose follows the inputs when they move slowly; None where the scenario maps
    errors one to one."""
    sensors: tuple[Sensor, ...] = ()
    """The sensors, that of the tip first."""
    target: Target | None = None
    """Where the tip should be."""
    current: tuple[float, ...] = ()
    """Mean velocity of the water (m/s)."""
    recordings: Mapping[int, Recording] = field(default_factory=dict)
    """Measured currents by their index in ``flow``."""
    first_period: float = 1.0
    """Period of the arm's slowest vibration (s): the unit of a controller's own times."""

    @property
    def readings(self) -> tuple[str, ...]:
        """Names of the sensors beside that of the tip (`crinoid.Seen.readings`)."""
        return tuple(sensor.name for sensor in self.sensors[1:])

    @cached_property
    def inputs(self) -> tuple[Input, ...]:
        """The inputs that the controller commands."""
        return self.system.inputs

    @property
    def controlled(self) -> tuple[list[int], Float[np.ndarray, " coordinate"]]:
        """Indices of the coordinates that are controlled, and what makes errors of them metres."""
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
        ``control.mapping = "identity"``; the others do nothing. Of more inputs than it takes each
        does its share: the sum of squared commands over ``weights`` (1 if left out) is least.

        Raises
        ------
        ScenarioError
            If an input that is to be driven does not move what is controlled.
        """
        mapping = np.zeros((len(self.inputs), len(POSE[self.scenario.arm.dimension])))
        names = list(driven)
        rows = self.rows(names)
        if self.jacobian is None:
            # x with slide, z with heave, angle with tilt; in space x, y, z with slide, sway, heave
            mapping[rows, rows] = 1.0
            return mapping
        answer = self._answer(rows, self.jacobian)
        weight = _of(names, weights, 1.0)
        scaled = answer.scale[:, None] * answer.jacobian
        scaled[np.abs(scaled) < _ROUND_OFF] = 0.0
        inverse = damped_inverse(scaled)
        self._check_use(names, inverse * answer.scale)
        # what it does to the tip, by the least weighted commands: weights do not damp
        inverse = weight[:, None] * np.linalg.pinv(scaled * weight, _ROUND_OFF) @ scaled @ inverse
        mapping[np.ix_(rows, answer.columns)] = inverse * answer.scale
        return mapping

    def allocation(
        self,
        driven: Iterable[str],
        weights: Mapping[str, float] | None = None,
        release: Mapping[str, float] | None = None,
    ) -> Allocation | None:
        """Return how the driven inputs share the work; None if they are no more than it takes.

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
        answer = self._answer(rows, self.jacobian)
        if len(rows) <= len(answer.columns):
            return None
        count, size = len(self.inputs), len(POSE[self.scenario.arm.dimension])
        jacobian, scale = np.zeros((size, count)), np.ones(size)
        weight, rate = np.zeros(count), np.zeros(count)
        jacobian[np.ix_(answer.columns, rows)] = answer.jacobian
        scale[answer.columns], weight[rows] = answer.scale, _of(names, weights, 1.0)
        rate[rows] = _of(names, release, 0.0)
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
            text = f"{unknown[0]} is to be driven, takes {one_of(names)}"
            raise ScenarioError([Mistake(f"control.{self.scenario.control.kind}", text)])
        return [names.index(name) for name in driven]

    def _answer(self, rows: list[int], jacobian: Float[Array, "pose input"]) -> _Answer:
        columns, scale = self.controlled
        needed = np.asarray(jacobian)[np.ix_(columns, rows)]
        if not np.isfinite(needed).all():
            text = (
                'got "static-jacobian", but nothing brings this arm back to where it is at rest, '
                'so its tip does not follow the base; takes "identity", or an arm with a clamp or '
                "a weight"
            )
            raise ScenarioError([Mistake("control.mapping", text)])
        return _Answer(rows, columns, needed, scale)

    def _check_use(self, names: list[str], inverse: Float[np.ndarray, "input coordinate"]) -> None:
        """Refuse to drive inputs that do nothing for what is controlled."""
        most = np.abs(inverse).max(axis=1)
        scenario = self.scenario
        threads = zip(scenario.thread_names, (*scenario.chamber, *scenario.tendon), strict=True)
        wound = {name for name, thread in threads if thread.drive == "length"}
        mistakes = [
            Mistake(
                f"control.{scenario.control.kind}.{name}",
                "does nothing: nothing of the tip that is controlled follows "
                f"{name} from the start; takes an input that moves it"
                + (", a tendon that its schedule makes taut" if name in wound else ""),
            )
            for name, share in zip(names, most, strict=True)
            if share <= _UNUSED * most.max()
        ]
        if mistakes:
            raise ScenarioError(mistakes)


def _of(
    names: list[str], numbers: Mapping[str, float] | None, default: float
) -> Float[np.ndarray, " input"]:
    return np.array([(numbers or {}).get(name, default) for name in names])
