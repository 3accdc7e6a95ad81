"""Surface waves: regular and random."""
# ruff: noqa: D102  # the base class documents its methods

import math
from collections.abc import Iterator
from typing import Any, ClassVar, Literal, NamedTuple

from pydantic import Field

from crinoid.scenario.errors import Mistake, refusal
from crinoid.scenario.flow_table import FlowTable
from crinoid.scenario.model import entry
from crinoid.scenario.quantity import Degrees, Metres, Seconds
from crinoid.scenario.sea_file import ElevationFile, SpectrumFile


class SeaState(NamedTuple):
    """Size of surface waves."""

    deviation: float  # standard deviation of the elevation (m)
    period: float  # period, that of the highest waves of irregular ones (s)
    regular: bool  # whether they have one period

    @property
    def height(self) -> float:
        """Height, a significant one of irregular waves (m)."""
        return self.deviation * (2 * math.sqrt(2) if self.regular else 4)


class SurfaceWaves(FlowTable):
    """Surface waves of any kind."""

    keys: ClassVar[tuple[str, str]]  # keys of height and period

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
        return math.radians(self.direction_deg or 0.0)  # type: ignore[attr-defined]

    def current_along(self, scenario: Any, built: Any = None) -> float:
        """Return the mean current along their mean direction (m/s), that of the flow if built."""
        way = (math.cos(self.direction), math.sin(self.direction))
        if self.state is None and built is not None:
            way = built.mean_heading
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
    """Surface waves: linear, on a still surface at z = 0.

    Of a JONSWAP spectrum (`significant_height` and `peak_period`), of a spectrum in a file, or with
    the elevation at a gauge as in a file. Phases and directions are drawn from `seed`. Without
    `water.depth` the water is deep. The mean of the uniform flows carries them.
    """

    drawn: ClassVar[bool] = True
    kind: Literal["waves"] = entry("waves", "Surface waves.")
    keys: ClassVar[tuple[str, str]] = ("significant_height", "peak_period")
    significant_height: Metres | None = entry(
        None, "Significant height of a JONSWAP spectrum: four standard deviations.", gt=0
    )
    peak_period: Seconds | None = entry(
        None, "Period of its highest waves at a fixed point, in any current.", gt=0
    )
    elevation: ElevationFile | None = entry(
        None, "Elevation at a gauge, in place of a JONSWAP spectrum."
    )
    spectrum: SpectrumFile | None = entry(
        None, "Spectrum in a file, in place of a JONSWAP spectrum."
    )
    direction_deg: Degrees | None = entry(
        None, "Mean direction of travel: 0, the default, toward +x, 90 toward +y."
    )
    gamma: float | None = entry(
        None,
        "Peakedness of a JONSWAP spectrum, 3.3 by default; 1: Pierson-Moskowitz.",
        ge=1,
        le=10,
    )
    components: int | None = entry(
        None,
        "Number of waves in the sum, 64 by default; of an elevation it follows from the file.",
        ge=1,
        le=10_000,
    )
    spreading: float | None = entry(
        None,
        "Exponent s of the directional spreading cos^2s(angle / 2) about direction_deg; by default "
        "all waves have one direction.",
        gt=0,
        le=1000,
    )

    def _conflicts(self) -> Iterator[Mistake]:
        files = [key for key in ("elevation", "spectrum") if getattr(self, key) is not None]
        if not files:
            hint = "Or name a file: elevation = {file = ...}, or spectrum = {file = ...}."
            for key, must in zip(self.keys, ("above 0 (m)", "above 0 (s)"), strict=True):
                if getattr(self, key) is None:
                    yield self.mistake(key, f"be a number {must}", hint)
            return
        others = [*self.keys, "gamma", *files[1:]] + ["components"] * (files[0] == "elevation")
        for key in others:
            if getattr(self, key) is not None:
                yield self.mistake(key, f"be left out with {files[0]}, whose file has it")

    @property
    def state(self) -> SeaState | None:
        if self.significant_height is None or self.peak_period is None:
            return None
        return SeaState(self.significant_height / 4, self.peak_period, regular=False)

    def build(self, scenario: Any, generator: Any, sea: Any = None) -> Any:
        """Return the waves; ``sea`` is what was read from the file."""
        others = self.common(scenario) | {"spreading": self.spreading, "generator": generator}
        if self.elevation is None:
            others["components"] = self.components or 64
        if sea is None:
            size = {key: getattr(self, key) for key in self.keys}
            return self._made("Waves.jonswap", gamma=self.gamma or 3.3, **size, **others)
        name, key = "Waves.drawn", "spectrum"
        if self.elevation is not None:
            name, key, others["origin"] = "Waves.at_gauge", "elevation", self.elevation.position
        try:
            return self._made(name, **(others | sea.given))
        except ValueError as error:
            raise refusal(f"{key}.file", f"{sea.name}: {error}", "be slower, or absent") from error
