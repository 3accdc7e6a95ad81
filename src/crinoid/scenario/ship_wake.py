"""The waves of a passing ship."""
# ruff: noqa: D102  # the base class documents its methods

import cmath
import math
from collections.abc import Iterator
from typing import Annotated, Any, Literal

from pydantic import Field

from crinoid.foundation.fixed_numbers import SPECTRUM_HIGHEST
from crinoid.scenario.model import entry
from crinoid.scenario.quantity import Degrees, Metres, MetresPerSecond, Seconds
from crinoid.scenario.waves import SurfaceWaves

_Size = Annotated[Metres, Field(ge=0.01, le=1000)]
_DEEP = 0.7  # largest depth Froude number of waves as in deep water
_LEAST, _MOST = 256, 10_000  # numbers of components


class ShipWakeFlow(SurfaceWaves):
    """Kelvin's waves behind a thin ship on a straight course, on a still surface at z = 0.

    They set in smoothly from `time`, when the ship is nearest. Its hull is a parabola of `length`
    and `beam` at the surface, and narrows to a keel at `draught`. The mean of the uniform flows
    carries ship and waves.
    """

    kind: Literal["ship-wake"] = entry("ship-wake", "The waves of a passing ship.")
    speed: MetresPerSecond = Field(ge=0.1, le=100, description="Speed of the ship over the ground.")
    distance: Metres = Field(
        description="Smallest distance of the ship from the base at rest; positive: the base is "
        "to port (left), negative: to starboard. At least the beam."
    )
    direction_deg: Degrees = entry(0.0, "Course of the ship: 0 toward +x, 90 toward +y.")
    time: Seconds = entry(0.0, "Time at which it is nearest; negative: before the run.")
    length: _Size = Field(description="Length of the hull at the surface.")
    beam: _Size | None = entry(
        None, "Largest breadth of the hull at the surface; by default a sixth of the length."
    )
    draught: _Size = Field(description="Depth of the keel below the surface.")

    @property
    def state(self) -> None:
        return None

    @property
    def breadth(self) -> float:
        """The beam, given or by default (m)."""
        return self.length / 6 if self.beam is None else self.beam

    def misfits(self, scenario: Any) -> Iterator[tuple[str, str]]:
        """Yield keys that do not fit water and run, each with what its value must be."""
        depth, gravity = scenario.water.depth, scenario.water.gravity
        drift = math.hypot(*self.current(scenario))
        if abs(self.distance) < (least := self.breadth):
            yield "distance", f"be {least:.4g} (m) or more, or -{least:.4g} or less, the beam"
        if depth is not None and self.draught >= depth:
            yield "draught", f"be below water.depth = {depth} (m)"
        if self.speed <= drift:
            yield "speed", f"be above that of the mean current, {drift:.3g} m/s"
        elif depth and (speed := abs(self._through(scenario))) > _DEEP * math.sqrt(gravity * depth):
            must = f"be at most {_DEEP * math.sqrt(gravity * depth):.3g} (m/s) through the water in"
            must += f" {depth} m of depth, a depth Froude number of {_DEEP}"
            yield "speed", must + (f", not {speed:.3g}" if drift else "")
        elif (count := self._components(scenario)) > _MOST:
            must = f"be higher, or simulation.duration shorter: the wake is a sum of {count} waves"
            yield "speed", f"{must}, above {_MOST}"

    def build(self, scenario: Any, generator: Any) -> Any:
        keys = ("speed", "distance", "time", "length", "draught")
        place, count = scenario.base.position[:-1], self._components(scenario)
        given = {"place": place, "components": count, "beam": self.breadth} | self.common(scenario)
        return self._made("ShipWake.passed", *keys, **given)

    def _through(self, scenario: Any) -> complex:
        """Return the velocity through the water, along the course and to port of it (m/s)."""
        drift = complex(*self.current(scenario))
        return self.speed - drift * cmath.exp(-1j * self.direction)

    def _components(self, scenario: Any) -> int:
        """Return the number of waves whose sum recurs after the run.

        From the largest derivative of their phases at the base by the tangent of their angle to the
        velocity through the water, and a fifth more.
        """
        through, steepest = self._through(scenario), math.sqrt(SPECTRUM_HIGHEST**2 - 1)
        way = max(0.0, scenario.simulation.duration - self.time) * self.speed / abs(through)
        aside = abs(self.distance) + way * abs(through.imag)
        change = steepest * way * abs(through.real) + (2 * SPECTRUM_HIGHEST**2 - 1) * aside
        change *= scenario.water.gravity / abs(through) ** 2 / SPECTRUM_HIGHEST
        return max(_LEAST, math.ceil(min(1e9, 1.2 * steepest / math.pi * change)))
