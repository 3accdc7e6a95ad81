"""The flow: how the water moves; several flows add up.

A new kind is one class here and one entry in `Flow`.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field

from crinoid.scenario.errors import Mistake
from crinoid.scenario.measured import MeasuredFlow
from crinoid.scenario.onset import Onset as _Flow
from crinoid.scenario.quantity import Degrees, Hertz, Metres, Seconds, Velocity

__all__ = ["Flow", "GustFlow", "MeasuredFlow", "ShearFlow", "SineFlow", "UniformFlow"]


class UniformFlow(_Flow):
    """The same velocity everywhere."""

    kind: Literal["uniform"] = Field(default="uniform", description="The same velocity everywhere.")
    velocity: Velocity = Field(description="Velocity.")


class ShearFlow(_Flow):
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


class GustFlow(_Flow):
    """One gust that rises and falls: ``velocity * (1 - cos(2 pi (t - start) / duration)) / 2``."""

    kind: Literal["gust"] = Field(default="gust", description="One gust that rises and falls.")
    velocity: Velocity = Field(description="Velocity at the peak.")
    duration: Seconds = Field(gt=0, description="How long it blows, from start.")


class SineFlow(_Flow):
    """A velocity that swings: ``amplitude * sin(2 pi frequency_hz t + phase)``."""

    kind: Literal["sine"] = Field(default="sine", description="A velocity that swings.")
    amplitude: Velocity = Field(description="Velocity at the peak.")
    frequency_hz: Hertz = Field(gt=0, description="Frequency.")
    phase_deg: Degrees = Field(default=0.0, description="Phase at t = 0.")


Flow = Annotated[
    UniformFlow | ShearFlow | GustFlow | SineFlow | MeasuredFlow, Field(discriminator="kind")
]
