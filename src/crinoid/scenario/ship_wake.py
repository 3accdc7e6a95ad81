"""The waves of a passing ship."""
# ruff: noqa: D102  # the base class documents its methods

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, Literal

from pydantic import Field

from crinoid.foundation.fixed_numbers import SPECTRUM_HIGHEST
from crinoid.scenario.errors import Mistake
from crinoid.scenario.model import entry
from crinoid.scenario.quantity import Degrees, Metres, MetresPerSecond, Seconds
from crinoid.scenario.waves import SurfaceWaves

_DEEP = 0.7
"""Largest depth Froude number of waves as in deep water."""
_MOST = 10_000
_LEAST = 64
"""Numbers of components."""


class ShipWakeFlow(SurfaceWaves):
    """Kelvin's waves behind a thin ship on a straight course, on a still surface at z = 0.

    They set in smoothly from `time`, when the ship is nearest. Its hull is a parabola of `length`
    and `beam` at the surface, and narrows to a keel at `draught`. The mean of the uniform flows
    carries ship and waves.
    """

    kind: Literal["ship-wake"] = entry("ship-wake", "The waves of a passing ship.")
    speed: MetresPerSecond = Field(gt=0, description="Speed of the ship over the ground.")
    distance: Metres = Field(
        description="Smallest distance of the ship from the base at rest; positive: the base is "
        "to port (left), negative: to starboard. Half the length or more."
    )
    direction_deg: Degrees = entry(0.0, "Course of the ship: 0 toward +x, 90 toward +y.")
    time: Seconds = entry(0.0, "Time at which it is nearest; negative: before the run.")
    length: Metres = Field(gt=0, description="Length of the hull at the surface.")
    beam: Metres = Field(gt=0, description="Largest breadth of the hull at the surface.")
    draught: Metres = Field(gt=0, description="Depth of the keel below the surface.")

    def _conflicts(self) -> Iterator[Mistake]:
        if abs(self.distance) < self.length / 2:
            must = f"be {self.length / 2:.6g} (m) or more, or negative, at least half of length"
            yield self.mistake("distance", must, "Nearer to the hull its own flow matters.")

    @property
    def state(self) -> None:
        return None

    def conflicts(self, scenario: Any) -> Iterator[tuple[str, str]]:
        """Yield keys that do not fit water and run, each with what its value must be."""
        depth, gravity, drift = scenario.water.depth, scenario.water.gravity, self._drift(scenario)
        if depth is not None and self.draught >= depth:
            yield "draught", f"be below water.depth = {depth} (m)"
        if self.speed <= math.hypot(*drift):
            yield "speed", f"be above that of the mean current, {math.hypot(*drift):.3g} m/s"
            return
        if not gravity:
            return
        speed, count = abs(self._velocity - complex(*drift)), self._components(scenario)
        if depth is not None and speed > (most := _DEEP * math.sqrt(gravity * depth)):
            must = f"be at most {most:.3g} (m/s) through the water in {depth} m of depth, a depth "
            must += f"Froude number of {_DEEP}"
            yield "speed", must + (f", not {speed:.3g}" if any(drift) else "")
        elif count > _MOST:
            must = f"be higher, or simulation.duration shorter: the wake is a sum of {count} waves"
            yield "speed", f"{must}, above {_MOST}"

    def build(self, scenario: Any, generator: Any) -> Any:
        keys = ("distance", "time", "length", "beam", "draught")
        common = self.common(scenario)
        del common["direction"]
        return self._made(
            "ShipWake.passed",
            *keys,
            velocity=(self._velocity.real, self._velocity.imag),
            place=scenario.base.position[:-1],
            duration=scenario.simulation.duration,
            components=self._components(scenario),
            **common,
        )

    @property
    def _velocity(self) -> complex:
        """Level velocity over the ground, x + i y (m/s)."""
        return self.speed * complex(math.cos(self.direction), math.sin(self.direction))

    def _drift(self, scenario: Any) -> tuple[float, float]:
        """Return the level mean current (m/s)."""
        x, y = (*self.current(scenario), 0.0)[:2]
        return x, y

    def _components(self, scenario: Any) -> int:
        """Return the number of waves whose sum recurs after the run.

        From the largest derivative of their phases at the arm by the tangent of their angle to the
        course through the water, and a fifth more.
        """
        through, reach = self._velocity - complex(*self._drift(scenario)), scenario.arm.length
        steepest, begin, changes = math.sqrt(SPECTRUM_HIGHEST**2 - 1), max(0.0, self.time), []
        for time in (begin, max(begin, scenario.simulation.duration)):
            away = self._velocity * (1j * self.distance / self.speed + self.time - time)
            away *= abs(through) / through
            aside = (2 * SPECTRUM_HIGHEST**2 - 1) * (abs(away.imag) + reach)
            changes.append(steepest * (abs(away.real) + reach) + aside)
        change = scenario.water.gravity / abs(through) ** 2 * max(changes) / SPECTRUM_HIGHEST
        return max(_LEAST, math.ceil(1.2 * steepest / math.pi * change))
