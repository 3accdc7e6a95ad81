"""Channels: what a controller may drive, and how far and fast."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, Literal, NamedTuple

from pydantic import Field

from crinoid.scenario.errors import Mistake, shown
from crinoid.scenario.model import Model
from crinoid.scenario.quantity import Hertz, MetresPerSecond, Pair, Quantity

__all__ = ["AngularChannel", "ChannelLimits", "ChannelName", "Channels", "LinearChannel"]

ChannelName = Literal["slide", "heave", "tilt"]


class ChannelLimits(NamedTuple):
    """Limits of a channel in SI units: m for slide and heave, rad for tilt."""

    low: float
    high: float
    speed: float
    acceleration: float
    bandwidth_hz: float


def _range_conflict(key: str, limits: tuple[float, float]) -> Iterator[Mistake]:
    low, high = limits
    if not (low <= 0 <= high and low < high):
        yield Mistake(
            key, f"got {shown(limits)}, takes [low, high] with low <= 0 <= high, not both 0"
        )


class LinearChannel(Model):
    """A channel that shifts the base: slide along x, heave along z."""

    range: Annotated[Pair, Quantity("m", "[low, high]")] = Field(
        default=(-0.2, 0.2), description="Travel, measured from the base's position."
    )
    max_speed: MetresPerSecond = Field(default=0.3, gt=0, description="Greatest speed.")
    max_acceleration: Annotated[float, Quantity("m/s2")] = Field(
        default=2.0, gt=0, description="Greatest acceleration."
    )
    bandwidth_hz: Hertz = Field(default=5.0, gt=0, description="Bandwidth of the actuator.")

    def _conflicts(self) -> Iterator[Mistake]:
        yield from _range_conflict("range", self.range)

    @property
    def limits(self) -> ChannelLimits:
        """The limits in m, m/s, m/s2 and Hz."""
        return ChannelLimits(*self.range, self.max_speed, self.max_acceleration, self.bandwidth_hz)


class AngularChannel(Model):
    """A channel that turns the base: tilt."""

    range_deg: Annotated[Pair, Quantity("degrees", "[low, high]")] = Field(
        default=(-60.0, 60.0), description="Travel, measured from the base's tilt."
    )
    max_speed_deg: Annotated[float, Quantity("degrees/s")] = Field(
        default=90.0, gt=0, description="Greatest speed."
    )
    max_acceleration_deg: Annotated[float, Quantity("degrees/s2")] = Field(
        default=720.0, gt=0, description="Greatest acceleration."
    )
    bandwidth_hz: Hertz = Field(default=5.0, gt=0, description="Bandwidth of the actuator.")

    def _conflicts(self) -> Iterator[Mistake]:
        yield from _range_conflict("range_deg", self.range_deg)

    @property
    def limits(self) -> ChannelLimits:
        """The limits in rad, rad/s, rad/s2 and Hz."""
        angles = (*self.range_deg, self.max_speed_deg, self.max_acceleration_deg)
        low, high, speed, acceleration = map(math.radians, angles)
        return ChannelLimits(low, high, speed, acceleration, self.bandwidth_hz)


class Channels(Model):
    """The channels a controller may drive; one left out stays put."""

    slide: LinearChannel | None = Field(default=None, description="Moves the base along x.")
    heave: LinearChannel | None = Field(default=None, description="Moves the base along z.")
    tilt: AngularChannel | None = Field(default=None, description="Turns the base.")

    @property
    def present(self) -> dict[ChannelName, LinearChannel | AngularChannel]:
        """The channels there are, by name, in the order slide, heave, tilt."""
        every: dict[ChannelName, LinearChannel | AngularChannel | None]
        every = {"slide": self.slide, "heave": self.heave, "tilt": self.tilt}
        return {name: channel for name, channel in every.items() if channel is not None}
