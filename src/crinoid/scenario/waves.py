"""Surface waves: regular and random."""
# ruff: noqa: D102  # the base class documents its methods

from __future__ import annotations

import math
from typing import Any, ClassVar, Literal

from pydantic import Field

from crinoid.scenario.flow_table import FlowTable
from crinoid.scenario.model import entry
from crinoid.scenario.quantity import Degrees, Metres, Seconds


class SurfaceWaves(FlowTable):
    """Surface waves of any kind."""

    height_key: ClassVar[str]
    """Key of the height."""
    period_key: ClassVar[str]
    """Key of the period."""
    regular: ClassVar[bool]
    """Whether they have one period."""

    @property
    def wave_height(self) -> float:
        """The height, a significant one of irregular waves (m)."""
        return float(getattr(self, self.height_key))

    @property
    def wave_period(self) -> float:
        """The period, that of the highest waves of irregular ones (s)."""
        return float(getattr(self, self.period_key))

    @property
    def deviation(self) -> float:
        """Standard deviation of the elevation (m)."""
        return self.wave_height / (2 * math.sqrt(2) if self.regular else 4)

    def heading(self, scenario: Any) -> tuple[float, ...]:
        """Return the level components of the direction of travel."""
        angle = math.radians(self.direction_deg)  # type: ignore[attr-defined]
        return (math.cos(angle), math.sin(angle))[: scenario.arm.dimension - 1]

    def current(self, scenario: Any) -> float:
        """Return the mean current along the waves (m/s): that of the flows that are uniform."""
        heading = self.heading(scenario)
        means = (flow.uniform_mean for flow in scenario.flow if isinstance(flow, FlowTable))
        return math.fsum(
            way * part
            for mean in means
            if mean is not None
            for way, part in zip(heading, mean[:-1], strict=True)
        )

    def common(self, scenario: Any) -> dict[str, Any]:
        """Return what all kinds of surface waves need of a scenario."""
        return {
            "current": self.current(scenario),
            "heading": self.heading(scenario),
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
    height_key: ClassVar[str] = "height"
    period_key: ClassVar[str] = "period"
    regular: ClassVar[bool] = True
    height: Metres = Field(gt=0, description="Height from trough to crest.")
    period: Seconds = Field(
        gt=0, description="Period at a fixed point, such as a moored buoy, in any current."
    )
    direction_deg: Degrees = entry(0.0, "Direction of travel: 0 toward +x, 90 toward +y.")
    phase_deg: Degrees = entry(
        0.0, "Phase at x = y = 0 at t = 0; 0: a crest, 90: the surface rises past z = 0."
    )

    def build(self, scenario: Any, generator: Any) -> Any:
        phase, others = math.radians(self.phase_deg), self.common(scenario)
        return self._made("Waves.regular", "height", "period", phase=phase, **others)


class WavesFlow(SurfaceWaves):
    """Surface waves: linear, with a JONSWAP spectrum, on a still surface at z = 0.

    Drawn from `seed`. They need `water.depth`. The mean of the uniform flows carries them.
    """

    drawn: ClassVar[bool] = True
    kind: Literal["waves"] = entry("waves", "Surface waves.")
    height_key: ClassVar[str] = "significant_height"
    period_key: ClassVar[str] = "peak_period"
    regular: ClassVar[bool] = False
    significant_height: Metres = Field(
        gt=0, description="Significant height: four standard deviations."
    )
    peak_period: Seconds = Field(
        gt=0, description="Period of the highest waves at a fixed point, in any current."
    )
    direction_deg: Degrees = entry(0.0, "Direction of travel: 0 toward +x, 90 toward +y.")
    gamma: float = entry(3.3, "Peakedness of the spectrum; 1: Pierson-Moskowitz.", ge=1, le=10)
    components: int = entry(64, "Number of waves in the sum.", ge=1, le=10_000)

    def build(self, scenario: Any, generator: Any) -> Any:
        keys = ("significant_height", "peak_period", "gamma", "components")
        return self._made("Waves.of", *keys, generator=generator, **self.common(scenario))
