"""Channels: what a controller may drive, and how far and fast."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple

from pydantic import Field, create_model

from crinoid.scenario.dimension import Only
from crinoid.scenario.errors import Mistake, one_of, shown
from crinoid.scenario.model import Model
from crinoid.scenario.quantity import Hertz, MetresPerSecond, Pair, Quantity
from crinoid.space import CHANNEL_TABLE, CHANNELS, Channel

__all__ = ["AngularChannel", "ChannelLimits", "ChannelName", "Channels", "LinearChannel"]

if TYPE_CHECKING:
    ChannelName = str
else:
    ChannelName = Annotated[
        Literal[CHANNELS[3]], Quantity(takes=one_of(CHANNELS[2]), in_space=one_of(CHANNELS[3]))
    ]


class ChannelLimits(NamedTuple):
    """Limits of a channel in SI units: m for a shift, rad for a turn."""

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
    """A channel that shifts the base."""

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
    """A channel that turns the base."""

    range_deg: Annotated[Pair, Quantity("degrees", "[low, high]")] = Field(
        default=(-60.0, 60.0), description="Travel, measured from the base's set angle."
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


def by_channel(
    of: Callable[[Channel], type[Model]], about: Callable[[Channel], str]
) -> dict[str, Any]:
    """Return a field of pydantic for each channel: a table that may be left out."""

    def field(channel: Channel) -> tuple[Any, Any]:
        table: Any = of(channel) | None
        if 2 not in channel.dimensions:
            table = Annotated[table, Only(3)]
        return table, Field(default=None, description=about(channel))

    return {channel.name: field(channel) for channel in CHANNEL_TABLE}


_Fields: Any = create_model(
    "_Fields",
    __base__=Model,
    **by_channel(
        lambda channel: AngularChannel if channel.turns else LinearChannel,
        lambda channel: channel.about,
    ),
)


class Channels(_Fields):
    """The channels a controller may drive; one left out stays put."""

    @property
    def present(self) -> dict[str, LinearChannel | AngularChannel]:
        """The channels there are, by name, in the order of `crinoid.space.CHANNELS`."""
        every = {name: getattr(self, name) for name in CHANNELS[3]}
        return {name: channel for name, channel in every.items() if channel is not None}
