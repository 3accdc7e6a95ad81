"""Everything that a controller is built from."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Array, Float

from crinoid.actuation import Input
from crinoid.assembly.parameters import Parameters
from crinoid.control import damped_inverse
from crinoid.dynamics import State, System
from crinoid.scenario import Mistake, Scenario, ScenarioError, one_of
from crinoid.space import POSE

_ROUND_OFF = 1e-9
"""Movement of the tip over that of a channel, turns at the arm's length, that is none."""
_UNUSED = 1e-6
"""Answer of a channel to an error, over that of the channel that answers most: none at all."""

Mapping = Float[np.ndarray, "input pose"]


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
    jacobian: Float[Array, "pose channel"] | None
    """How the tip's pose follows the base's channels when they move slowly; None where the
    scenario maps errors one to one."""
    readings: tuple[str, ...] = ()
    """Names of the sensors beside that of the tip (`crinoid.Seen.readings`)."""

    @property
    def inputs(self) -> tuple[Input, ...]:
        """The inputs that the controller commands."""
        return self.system.inputs

    @property
    def period(self) -> float:
        """Time between two commands (s)."""
        return 1.0 / self.scenario.control_rate_hz

    def mapping(self, driven: Iterable[str]) -> Mapping:
        """Return the displacement of each input per error of the tip's pose.

        In the unit of the input over m, rad or, of a direction in space, 1. The damped inverse of
        the static Jacobian for the inputs named in ``driven``, or one to one with
        ``control.mapping = "identity"``; the others do nothing.

        Raises
        ------
        ScenarioError
            If an input that is to be driven does not move what is controlled.
        """
        control, axes = self.scenario.control, self.scenario.arm.dimension
        names, coordinates = [each.name for each in self.inputs], POSE[axes]
        mapping, driven = np.zeros((len(names), len(coordinates))), list(driven)
        unknown = [name for name in driven if name not in names]
        if unknown:
            text = f"{unknown[0]} is to be driven, takes {one_of(names)}"
            raise ScenarioError([Mistake(f"control.{control.kind}", text)])
        rows = [names.index(name) for name in driven]
        if self.jacobian is None:
            # x with slide, z with heave, angle with tilt; in space x, y, z with slide, sway, heave
            mapping[rows, rows] = 1.0
            return mapping
        # a direction in space has three coordinates
        columns = [
            column
            for name in control.controlled
            for column, coordinate in enumerate(coordinates)
            if coordinate == name or coordinate.startswith(f"{name}_")
        ]
        needed = np.asarray(self.jacobian)[np.ix_(columns, rows)]
        if not np.isfinite(needed).all():
            text = (
                'got "static-jacobian", but nothing brings this arm back to where it is at rest, '
                'so its tip does not follow the base; takes "identity", or an arm with a clamp or '
                "a weight"
            )
            raise ScenarioError([Mistake("control.mapping", text)])
        weights = np.where(np.asarray(columns) < axes, 1.0, self.scenario.arm.length)
        weighed = weights[:, None] * needed
        weighed[np.abs(weighed) < _ROUND_OFF] = 0.0
        inverse = damped_inverse(weighed) * weights
        self._check_use(driven, inverse)
        mapping[np.ix_(rows, columns)] = inverse
        return mapping

    def _check_use(self, names: list[str], inverse: Float[np.ndarray, "input coordinate"]) -> None:
        """Refuse to drive inputs that do nothing for what is controlled."""
        most = np.abs(inverse).max(axis=1)
        kind = self.scenario.control.kind
        mistakes = [
            Mistake(
                f"control.{kind}.{name}",
                "does nothing: nothing of the tip that is controlled follows "
                f"{name} from the start; takes a channel that moves it",
            )
            for name, share in zip(names, most, strict=True)
            if share <= _UNUSED * most.max()
        ]
        if mistakes:
            raise ScenarioError(mistakes)
