"""Prescribed motions of the submarine.

A new kind is one class here and one entry in `Motion`.
"""

import math
from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field

from crinoid.scenario.channel import ChannelName
from crinoid.scenario.errors import Mistake
from crinoid.scenario.files import File
from crinoid.scenario.model import Model
from crinoid.scenario.quantity import (
    LATEST,
    AsTuple,
    Degrees,
    Hertz,
    Metres,
    MetresPerSecond,
    Quantity,
    Seconds,
    Times,
    length_conflicts,
    time_conflicts,
)
from crinoid.space import ANGLES

__all__ = ["FileMotion", "Motion", "SineMotion", "TableMotion", "VelocityMotion"]

Interpolation = Annotated[
    Literal["monotone", "smooth"],
    Field(
        description="monotone: between two points it rises or falls as they do, and never swings "
        "past them; smooth: a cubic spline, more accurate where the points follow a smooth curve. "
        "Either has a continuous acceleration."
    ),
]


class _Motion(Model):
    kind: str
    channel: ChannelName = Field(
        description="Channel that moves: slide (x), heave (z) or tilt; in space also sway (y), pan "
        "or roll."
    )

    def _unit_conflict(self, plain: str) -> Iterator[Mistake]:
        """Check that an angle is given in degrees, and only an angle."""
        wanted, other = (
            (f"{plain}_deg", plain) if self.channel in ANGLES else (plain, f"{plain}_deg")
        )
        if getattr(self, other) is not None:
            text = f'does not go with channel "{self.channel}", which takes {wanted}'
            yield Mistake(other, text)
        elif getattr(self, wanted) is None:
            yield Mistake(wanted, f'missing, channel "{self.channel}" needs it')


class SineMotion(_Motion):
    """A motion ``amplitude * sin(2 pi frequency_hz t + phase)``."""

    kind: Literal["sine"] = Field(default="sine", description="A sine.")
    amplitude: Metres | None = Field(default=None, description="Amplitude of a shift.")
    amplitude_deg: Degrees | None = Field(default=None, description="Amplitude of a turn.")
    frequency_hz: Hertz = Field(gt=0, description="Frequency.")
    phase_deg: Degrees = Field(default=0.0, description="Phase at t = 0.")

    def _conflicts(self) -> Iterator[Mistake]:
        yield from self._unit_conflict("amplitude")

    @property
    def amplitude_si(self) -> float:
        """The amplitude in m or rad."""
        if self.amplitude_deg is not None:
            return math.radians(self.amplitude_deg)
        return self.amplitude or 0.0

    def farthest(self, duration: float) -> float:
        """Return the largest displacement during a run (m or rad), or a bound to it."""
        return abs(self.amplitude_si)


class VelocityMotion(_Motion):
    """A constant velocity, reached along half a cosine from rest."""

    kind: Literal["velocity"] = Field(default="velocity", description="A constant velocity.")
    velocity: MetresPerSecond | None = Field(default=None, description="Velocity of a shift.")
    velocity_deg: Annotated[float, Quantity("degrees/s")] | None = Field(
        default=None, description="Velocity of a turn."
    )
    start: Seconds = Field(default=0.0, ge=0, le=LATEST, description="When it sets in.")
    ramp_time: Seconds = Field(
        default=1.0, gt=0, description="How long it takes to reach its velocity."
    )

    def _conflicts(self) -> Iterator[Mistake]:
        yield from self._unit_conflict("velocity")

    @property
    def velocity_si(self) -> float:
        """The velocity in m/s or rad/s."""
        if self.velocity_deg is not None:
            return math.radians(self.velocity_deg)
        return self.velocity or 0.0

    def farthest(self, duration: float) -> float:
        """Return the largest displacement during a run (m or rad), or a bound to it."""
        return abs(self.velocity_si) * duration


class TableMotion(_Motion):
    """A motion through points in time."""

    kind: Literal["table"] = Field(default="table", description="Points in time.")
    time: Times = Field(description="Times, increasing, from 0 or before to the end of the run.")
    value: Annotated[tuple[Metres, ...], AsTuple, Quantity("m", "a list of numbers")] | None = (
        Field(default=None, description="Shift at these times.")
    )
    value_deg: (
        Annotated[tuple[Degrees, ...], AsTuple, Quantity("degrees", "a list of numbers")] | None
    ) = Field(default=None, description="Turn at these times.")

    interpolation: Interpolation = "monotone"

    def _conflicts(self) -> Iterator[Mistake]:
        yield from self._unit_conflict("value")
        yield from time_conflicts(self.time)
        for key, values in (("value", self.value), ("value_deg", self.value_deg)):
            if values is not None:
                yield from length_conflicts(key, values, self.time)

    @property
    def value_si(self) -> tuple[float, ...]:
        """The values in m or rad."""
        if self.value_deg is not None:
            return tuple(map(math.radians, self.value_deg))
        return self.value or ()

    def farthest(self, duration: float) -> float:
        """Return the largest displacement during a run (m or rad), or a bound to it."""
        return max(map(abs, self.value_si))


class FileMotion(_Motion):
    """A motion as in a file, such as a record of heave."""

    kind: Literal["file"] = Field(default="file", description="Points in time from a file.")
    file: File = Field(
        description="CSV or netCDF file. A relative path starts from the scenario file that names "
        "it, with --set and in Python from the working directory.",
    )
    time_column: str = Field(
        default="time",
        min_length=1,
        description="Its column of times, from 0 or before to the end of the run; dates count from "
        "the first one.",
    )
    value_column: str | None = Field(
        default=None,
        min_length=1,
        description="Its column of shifts or turns (in degrees if it names no unit); named as the "
        "channel if left out.",
    )
    skip: Seconds = Field(default=0.0, ge=0, description="Time of the file when the run begins.")
    interpolation: Interpolation = "monotone"


Motion = Annotated[
    SineMotion | VelocityMotion | TableMotion | FileMotion, Field(discriminator="kind")
]
