"""The base: its pose, its channels, and its motion."""

import math
from collections.abc import Callable, Iterator
from typing import Annotated, Any, Literal, NamedTuple

from pydantic import create_model

from crinoid.foundation.axes import CHANNEL_TABLE, CHANNELS, Channel
from crinoid.scenario.base_motion import Motion
from crinoid.scenario.errors import Mistake, got
from crinoid.scenario.model import Model, entry
from crinoid.scenario.quantity import (
    Degrees,
    DegreesPerSecond,
    Hertz,
    InSpace,
    ListOf,
    MetresPerSecond,
    Only,
    Pair,
    Position,
    Quantity,
)


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
        yield Mistake(key, got(limits, "be [low, high] with low <= 0 <= high, not both 0"))


class LinearChannel(Model):
    """A channel that shifts the base."""

    range: Annotated[Pair, Quantity("m", "[low, high]")] = entry(
        (-0.2, 0.2), "Travel, from the base's position."
    )
    max_speed: MetresPerSecond = entry(0.3, "Greatest speed.", gt=0)
    max_acceleration: Annotated[float, Quantity("m/s2")] = entry(
        2.0, "Greatest acceleration.", gt=0
    )
    bandwidth_hz: Hertz = entry(5.0, "Bandwidth of the actuator.", gt=0)

    def _conflicts(self) -> Iterator[Mistake]:
        yield from _range_conflict("range", self.range)

    @property
    def limits(self) -> ChannelLimits:
        """The limits in m, m/s, m/s2 and Hz."""
        return ChannelLimits(*self.range, self.max_speed, self.max_acceleration, self.bandwidth_hz)


class AngularChannel(Model):
    """A channel that turns the base."""

    range_deg: Annotated[Pair, Quantity("degrees", "[low, high]")] = entry(
        (-60.0, 60.0), "Travel, from the base's set angle."
    )
    max_speed_deg: DegreesPerSecond = entry(90.0, "Greatest speed.", gt=0)
    max_acceleration_deg: Annotated[float, Quantity("degrees/s2")] = entry(
        720.0, "Greatest acceleration.", gt=0
    )
    bandwidth_hz: Hertz = entry(5.0, "Bandwidth of the actuator.", gt=0)

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
        return table, entry(None, about(channel))

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
    """The channels a controller may drive; the base is fixed along others."""

    @property
    def present(self) -> dict[str, LinearChannel | AngularChannel]:
        """The existing channels, by name, in the order of `crinoid.foundation.axes.CHANNELS`."""
        every = {name: getattr(self, name) for name in CHANNELS[3]}
        return {name: channel for name, channel in every.items() if channel is not None}


class Base(Model):
    """Pose of the arm's root, and its motion."""

    position: Annotated[Position, InSpace((0.0, 0.0, -10.0))] = entry(
        (0.0, -10.0), "Position of the arm's root; z is up."
    )
    tilt_deg: Degrees = entry(0.0, "Turn of the arm's root from x towards z.")
    pan_deg: Annotated[Degrees, Only(3)] = entry(0.0, "Turn of the arm's root from x towards y.")
    roll_deg: Annotated[Degrees, Only(3)] = entry(
        0.0, "Turn of the arm's root about itself, from y towards z."
    )
    mount: Literal["clamped", "pinned"] = entry(
        "clamped",
        "clamped: the root points along tilt and pan; pinned: it turns freely, in space on a "
        "joint that bends both ways but transmits twist.",
    )
    channels: Channels = entry(Channels(), "Channels a controller may drive.")
    motion: ListOf[Motion] = entry((), "Prescribed motions, added to the channels.")

    @property
    def angles(self) -> tuple[float, float, float]:
        """Pan, tilt and roll of the set pose, in rad."""
        pan, tilt, roll = map(math.radians, (self.pan_deg, self.tilt_deg, self.roll_deg))
        return (pan, tilt, roll)

    def moved(self, axes: int) -> set[str]:
        """Return the channels that prescribed motions move, of a planar or spatial base."""
        return {channel for motion in self.motion for channel in motion.moved(axes)}
