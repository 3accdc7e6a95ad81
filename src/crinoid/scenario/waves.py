"""Surface waves: regular and random."""
# ruff: noqa: D102  # the base class documents its methods

from __future__ import annotations

import math
from typing import Any, ClassVar, Literal, NamedTuple

from pydantic import Field

from crinoid.scenario.flow_table import FlowTable
from crinoid.scenario.model import entry
from crinoid.scenario.quantity import Degrees, Metres, Seconds


class SeaState(NamedTuple):
    """Size of surface waves."""

    deviation: float
    """Standard deviation of the elevation (m)."""
    period: float
    """Period, that of the highest waves of irregular ones (s)."""
    regular: bool
    """Whether they have one period."""

    @property
    def height(self) -> float:
        """Height, a significant one of irregular waves (m)."""
        return self.deviation * (2 * math.sqrt(2) if self.regular else 4)


class SurfaceWaves(FlowTable):
    """Surface waves of any kind."""

    keys: ClassVar[tuple[str, str]]
    """Keys of height and period."""

    @property
    def state(self) -> SeaState | None:
        """Their size; None where a file has it."""
        raise NotImplementedError

    def state_of(self, built: Any) -> SeaState:
        """Return their size, which may be that of the flow that was built."""
        return self.state or SeaState(built.deviation, built.energy_period, regular=False)

    @property
    def direction(self) -> float:
        """Mean direction of travel (rad)."""
        return math.radians(self.direction_deg)  # type: ignore[attr-defined]

    def current_along(self, scenario: Any) -> float:
        """Return the mean current along their mean direction (m/s)."""
        way = (math.cos(self.direction), math.sin(self.direction))
        return math.fsum(a * b for a, b in zip(self.current(scenario), way, strict=False))

    def current(self, scenario: Any) -> tuple[float, ...]:
        """Return the level mean current (m/s): that of the flows that are uniform."""
        means = [flow.uniform_mean for flow in scenario.flow if isinstance(flow, FlowTable)]
        axes = range(scenario.arm.dimension - 1)
        return tuple(math.fsum(mean[axis] for mean in means if mean is not None) for axis in axes)

    def common(self, scenario: Any) -> dict[str, Any]:
        """Return what all kinds of surface waves need of a scenario."""
        return {
            "current": self.current(scenario),
            "direction": self.direction,
            "depth": scenario.water.depth,
            "gravity": scenario.water.gravity,
        }


class RegularWaveFlow(SurfaceWaves):
    """One linear (Airy) wave, on a still surface at z = 0.

    Its elevation is ``height / 2 * cos(k s - 2 pi t / period + phase)``, with ``s`` the distance
    from x = y = 0 along its direction. Without `water.depth` the water is deep. The mean of the
    uniform flows carries it.
    """

    kind: Literal["regular-wave"] = entry("regular-wave", "One wave of one period.")
    keys: ClassVar[tuple[str, str]] = ("height", "period")
    height: Metres = Field(gt=0, description="Height from trough to crest.")
    period: Seconds = Field(
        gt=0, description="Period at a fixed point, such as a moored buoy, in any current."
    )
    direction_deg: Degrees = entry(0.0, "Direction of travel: 0 toward +x, 90 toward +y.")
    phase_deg: Degrees = entry(
        0.0, "Phase at x = y = 0 at t = 0; 0: a crest, 90: the surface rises past z = 0."
    )

    @property
    def state(self) -> SeaState:
        return SeaState(self.height / (2 * math.sqrt(2)), self.period, regular=True)

    def build(self, scenario: Any, generator: Any) -> Any:
        phase, others = math.radians(self.phase_deg), self.common(scenario)
        return self._made("Waves.regular", "height", "period", phase=phase, **others)


class WavesFlow(SurfaceWaves):
    """Surface waves: linear, with a JONSWAP spectrum, on a still surface at z = 0.

    Drawn from `seed`. Without `water.depth` the water is deep. The mean of the uniform flows
    carries them.
    """

    drawn: ClassVar[bool] = True
    kind: Literal["waves"] = entry("waves", "Surface waves.")
    keys: ClassVar[tuple[str, str]] = ("significant_height", "peak_period")
    significant_height: Metres = Field(
        gt=0, description="Significant height: four standard deviations."
    )
    peak_period: Seconds = Field(
        gt=0, description="Period of the highest waves at a fixed point, in any current."
    )
    direction_deg: Degrees = entry(0.0, "Direction of travel: 0 toward +x, 90 toward +y.")
    gamma: float = entry(3.3, "Peakedness of the spectrum; 1: Pierson-Moskowitz.", ge=1, le=10)
    components: int = entry(64, "Number of waves in the sum.", ge=1, le=10_000)

    spreading: float | None = entry(
        None,
        "Exponent s of the directional spreading cos^2s(angle / 2) about direction_deg; by default "
        "all waves have one direction.",
        gt=0,
        le=1000,
    )

    @property
    def state(self) -> SeaState:
        return SeaState(self.significant_height / 4, self.peak_period, regular=False)

    def build(self, scenario: Any, generator: Any) -> Any:
        keys = ("significant_height", "peak_period", "gamma", "components", "spreading")
        return self._made("Waves.jonswap", *keys, generator=generator, **self.common(scenario))
