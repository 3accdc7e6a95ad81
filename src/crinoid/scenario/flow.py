"""The flow: how the water moves; several flows add up.

A new kind is one class here and one entry in `Flow`; or a table of an installed package
(`crinoid.scenario.kinds`).
"""

from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field

from crinoid.scenario.dimension import Count
from crinoid.scenario.errors import Mistake, shown
from crinoid.scenario.flow_table import FlowTable
from crinoid.scenario.kinds import KindOf
from crinoid.scenario.measured import MeasuredFlow
from crinoid.scenario.quantity import (
    AsTuple,
    Degrees,
    Hertz,
    Metres,
    Quantity,
    Seconds,
    Velocity,
)

__all__ = [
    "Flow",
    "GaussMarkovFlow",
    "GustFlow",
    "MeasuredFlow",
    "ShearFlow",
    "SineFlow",
    "TurbulenceFlow",
    "UniformFlow",
    "WavesFlow",
]

_From0 = Annotated[float, Field(ge=0)]
StandardDeviation = Annotated[
    _From0 | Annotated[tuple[_From0, ...], AsTuple, Field(min_length=2, max_length=3)],
    Quantity(
        "m/s",
        "a number of 0 or more, or [x, z], both 0 or more",
        "a number of 0 or more, or [x, y, z], all 0 or more",
    ),
    Count(plane=(1, 2), space=(1, 3)),
]


class UniformFlow(FlowTable):
    """The same velocity everywhere."""

    kind: Literal["uniform"] = Field(default="uniform", description="The same velocity everywhere.")
    velocity: Velocity = Field(description="Velocity.")


class ShearFlow(FlowTable):
    """A current that slows down towards the bed.

    At a height ``h`` above the bed, with ``h_ref = water.depth - reference_depth``, it is
    ``velocity * (h / h_ref)**exponent``, or with a roughness length ``z0``
    ``velocity * ln(h / z0) / ln(h_ref / z0)``.
    """

    kind: Literal["shear"] = Field(
        default="shear", description="A current that slows towards the bed."
    )
    velocity: Velocity = Field(description="Velocity at the reference depth.")
    reference_depth: Metres = Field(
        ge=0, description="Depth below the surface at which the velocity is reached."
    )
    exponent: float | None = Field(
        default=None, ge=0, description="Exponent of the power law; 0.142857 if nothing is given."
    )
    roughness_length: Metres | None = Field(
        default=None, gt=0, description="Roughness of the bed; selects the logarithmic profile."
    )

    def _conflicts(self) -> Iterator[Mistake]:
        if self.exponent is not None and self.roughness_length is not None:
            yield Mistake("exponent", "does not go with roughness_length; takes one of the two")

    @property
    def power_exponent(self) -> float | None:
        """The exponent of the power law; None if the profile is logarithmic."""
        if self.roughness_length is not None:
            return None
        return 0.142857 if self.exponent is None else self.exponent


class GustFlow(FlowTable):
    """One gust that rises and falls: ``velocity * (1 - cos(2 pi (t - start) / duration)) / 2``."""

    kind: Literal["gust"] = Field(default="gust", description="One gust that rises and falls.")
    velocity: Velocity = Field(description="Velocity at the peak.")
    duration: Seconds = Field(gt=0, description="How long it blows, from start.")


class SineFlow(FlowTable):
    """A velocity that swings: ``amplitude * sin(2 pi frequency_hz t + phase)``."""

    kind: Literal["sine"] = Field(default="sine", description="A velocity that swings.")
    amplitude: Velocity = Field(description="Velocity at the peak.")
    frequency_hz: Hertz = Field(gt=0, description="Frequency.")
    phase_deg: Degrees = Field(default=0.0, description="Phase at t = 0.")


class GaussMarkovFlow(FlowTable):
    """A velocity that wanders about its mean: a Gauss-Markov process for each axis.

    The same everywhere; drawn from `seed`.
    """

    kind: Literal["gauss-markov"] = Field(
        default="gauss-markov", description="A velocity that wanders about its mean."
    )
    mean: Velocity = Field(description="Mean velocity.")
    standard_deviation: StandardDeviation = Field(
        description="Standard deviation of each component, or one for each."
    )
    correlation_time: Seconds = Field(
        gt=0, description="Time over which its correlation falls to 1/e."
    )


class TurbulenceFlow(FlowTable):
    """Turbulence that the water carries along: Fourier modes with a von Karman spectrum.

    The mean and all flows that are the same everywhere carry it past the arm. The mean is part of
    the flow: a uniform flow of the same velocity would double it.

    Drawn from `seed`. A planar arm sees a cut through three-dimensional turbulence.
    """

    kind: Literal["turbulence"] = Field(
        default="turbulence", description="Turbulence that the water carries along."
    )
    mean: Velocity = Field(description="Mean velocity.")
    intensity: float = Field(
        gt=0,
        le=1,
        description="Standard deviation of each component, as a share of the mean's magnitude.",
    )
    length_scale: Metres = Field(gt=0, description="Longitudinal integral scale.")
    modes: int = Field(default=256, ge=8, le=10_000, description="Number of Fourier modes.")

    def _conflicts(self) -> Iterator[Mistake]:
        if not any(self.mean):
            text = f"got {shown(self.mean)}, takes a velocity other than 0: "
            yield Mistake("mean", f"{text}intensity is a share of it")


class WavesFlow(FlowTable):
    """Surface waves: linear, with a JONSWAP spectrum, on a still surface at z = 0.

    Drawn from `seed`. They need `water.depth`.
    """

    kind: Literal["waves"] = Field(default="waves", description="Surface waves.")
    significant_height: Metres = Field(
        gt=0, description="Significant height, four standard deviations of the surface."
    )
    peak_period: Seconds = Field(gt=0, description="Period of the highest waves.")
    direction_deg: Degrees = Field(
        default=0.0, description="Where they travel: 0 toward +x, 90 toward +y."
    )
    gamma: float = Field(
        default=3.3, ge=1, le=10, description="How peaked the spectrum is; 1: Pierson-Moskowitz."
    )
    components: int = Field(default=64, ge=1, le=10_000, description="Number of waves that add up.")


Flow = Annotated[
    UniformFlow
    | ShearFlow
    | GustFlow
    | SineFlow
    | GaussMarkovFlow
    | TurbulenceFlow
    | WavesFlow
    | MeasuredFlow,
    Field(discriminator="kind"),
    KindOf("flows", FlowTable),
]
