"""Chambers and tendons: soft actuators along the arm."""

import math
from collections.abc import Iterator
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from crinoid.scenario.arm import Arm
from crinoid.scenario.dimension import Only
from crinoid.scenario.errors import Mistake, shown
from crinoid.scenario.model import Model
from crinoid.scenario.quantity import (
    NAME,
    AsTuple,
    Degrees,
    Metres,
    MetresPerSecond,
    Newtons,
    Pair,
    Quantity,
    Seconds,
    SquareMetres,
    Times,
    length_conflicts,
    span_conflicts,
    time_conflicts,
)
from crinoid.space import CHANNELS

__all__ = ["Chamber", "Schedule", "Tendon", "thread_conflicts", "thread_names"]

Pascals = Annotated[float, Quantity("Pa")]
Shares = Annotated[tuple[float, ...], AsTuple, Quantity(takes="a list of numbers from -1 to 1")]
Offset = Annotated[
    float | Pair, Quantity("m", "a number, or a pair [at the root end, at the tip end]")
]


class Schedule(Model):
    """Shares of the largest drive over time, joined by straight lines."""

    time: Times = Field(description="Times; before the first and after the last it stays.")
    share: Shares = Field(description="Share of the largest, below 0 only of a pair.")

    def _conflicts(self) -> Iterator[Mistake]:
        yield from time_conflicts(self.time)
        yield from length_conflicts("share", self.share, self.time)
        for index, share in enumerate(self.share):
            if not -1 <= share <= 1:
                yield Mistake(f"share.{index}", f"got {share}, takes a number from -1 to 1")


class Thread(Model):
    """Keys that chambers and tendons share."""

    _ways: ClassVar[dict[str, dict[str, str]]]
    """Keys that go with each `drive`, with what they take where they are required.

    The first is what a share of 1 is, the last its greatest rate.
    """

    name: Annotated[str | None, NAME] = Field(
        default=None,
        pattern="^[a-z][a-z0-9_]*$",
        description="Name of its input; chamber_0, tendon_0 and so on if left out.",
    )
    drive: str
    span: Pair = Field(
        default=(0.0, 1.0), description="Where it begins and ends, over the arm's length."
    )
    offset: Offset | None = Field(
        default=None, description="Distance from the axis; a pair tapers along the span."
    )
    angle_deg: Degrees = Field(
        default=0.0,
        description="Side of the axis: in the plane 0 above or 180 below an arm along x; in space "
        "from m_1, to port, toward m_2, up.",
    )
    pair: bool = Field(
        default=False,
        description="Whether there is another one on the other side, driven by shares below 0.",
    )
    time_constant: Seconds = Field(default=0.0, ge=0, description="Lag of first order.")
    dead_band: float = Field(
        default=0.0, ge=0, lt=1, description="Change of its share that it does not follow."
    )
    schedule: Schedule | None = Field(
        default=None,
        description="Shares over time. A controller's command adds to them; one below 0 takes "
        "away from them.",
    )

    def _conflicts(self) -> Iterator[Mistake]:
        own = self.drive
        for drive, keys in self._ways.items():
            for key, takes in keys.items():
                value = getattr(self, key)
                if drive == own and takes and value is None:
                    yield Mistake(key, f"missing, takes {takes}")
                if drive != own and value != type(self).model_fields[key].default:
                    text = f"got {shown(value)}, goes with drive = {shown(drive)} only"
                    yield Mistake(key, text)
        yield from span_conflicts("span", self.span)
        offsets = self.offset if isinstance(self.offset, tuple) else (self.offset or 0.0,)
        if min(offsets) < 0:
            text = f"got {shown(self.offset)}, takes 0 or more (m); angle_deg tells the side"
            yield Mistake("offset", text)
        if self.schedule is not None and not self.pair:
            for index, share in enumerate(self.schedule.share):
                if share < 0:
                    text = f"got {share}, takes a number from 0 to 1; pair = true takes one below 0"
                    yield Mistake(f"schedule.share.{index}", text)

    @property
    def lined(self) -> bool:
        """Whether its length or volume is given, and its load follows from the arm's shape."""
        return self.drive in ("length", "volume")

    @property
    def largest_key(self) -> str:
        """Key of what a share of 1 is."""
        return next(iter(self._ways[self.drive]))

    @property
    def largest(self) -> float:
        """Drive at a share of 1: Pa, m3, N or m."""
        return float(getattr(self, self.largest_key))

    @property
    def largest_rate(self) -> float | None:
        """Greatest rate of that (per second), if there is one."""
        rate: float | None = getattr(self, list(self._ways[self.drive])[-1])
        return rate


class Chamber(Thread):
    """A chamber whose fluid pushes along the arm: hydraulic or pneumatic."""

    _ways: ClassVar[dict[str, dict[str, str]]] = {
        "pressure": {
            "max_pressure": "",
            "min_pressure": "",
            "max_curvature": "",
            "stiffening": "",
            "max_rate": "",
        },
        "volume": {
            "max_volume": "a number above 0 (m3)",
            "bulk_modulus": "a number above 0 (Pa)",
            "max_flow": "",
        },
    }

    drive: Literal["pressure", "volume"] = Field(
        default="pressure",
        description="What its share is one of: the pressure of its fluid, or the volume of fluid "
        "that is pumped into it and closed in, whose pressure follows from the arm's shape.",
    )
    area: SquareMetres | None = Field(
        default=None, gt=0, description="Area of its section, on which the pressure pushes."
    )
    max_pressure: Pascals = Field(default=1e5, gt=0, description="Largest pressure above ambient.")
    min_pressure: Pascals = Field(default=0.0, ge=0, description="Smallest pressure.")
    max_rate: Annotated[float, Quantity("Pa/s")] | None = Field(
        default=None, gt=0, description="Greatest rate of the pressure."
    )
    max_curvature: Annotated[float, Quantity("1/m")] | None = Field(
        default=None,
        gt=0,
        description="Curvature of a free arm at the largest pressure, in place of area and offset.",
    )
    stiffening: float = Field(
        default=0.0,
        ge=0,
        description="Share of the arm's bending stiffness that its largest pressure adds over the "
        "span, in proportion to the pressure.",
    )
    max_volume: Annotated[float, Quantity("m3")] | None = Field(
        default=None, gt=0, description="Volume of fluid that a share of 1 adds to that at rest."
    )
    bulk_modulus: Pascals | None = Field(
        default=None,
        gt=0,
        description="Stiffness of the closed fluid, its hoses included: 2.2e9 of water alone; of a "
        "gas its absolute pressure at rest.",
    )
    max_flow: Annotated[float, Quantity("m3/s")] | None = Field(
        default=None, gt=0, description="Greatest flow of the pump."
    )

    def _conflicts(self) -> Iterator[Mistake]:
        yield from super()._conflicts()
        routed = {"area": self.area, "offset": self.offset}
        for key, value in routed.items():
            if self.max_curvature is None and value is None:
                yield Mistake(
                    key, "missing, takes area and offset, or max_curvature in their place"
                )
            if self.max_curvature is not None and value is not None:
                yield Mistake(key, f"got {shown(value)}, does not go with max_curvature")
        if self.min_pressure >= self.max_pressure:
            text = f"got {self.min_pressure}, takes a number below max_pressure"
            yield Mistake("min_pressure", f"{text} = {self.max_pressure} (Pa)")
        if self.pair and self.min_pressure:
            text = f"got {self.min_pressure}, takes 0 with pair = true"
            yield Mistake("min_pressure", text)


class Tendon(Thread):
    """A tendon that pulls along the arm."""

    _ways: ClassVar[dict[str, dict[str, str]]] = {
        "tension": {"max_tension": "a number above 0 (N)", "max_rate": ""},
        "length": {
            "max_shortening": "a number above 0 (m)",
            "stiffness": "a number above 0 (N)",
            "max_speed": "",
        },
    }

    drive: Literal["tension", "length"] = Field(
        default="tension",
        description="What its share is one of: the tension, or the length that a winch takes in; "
        "the tension then follows from the arm's shape, and is 0 where the tendon is slack.",
    )
    max_tension: Newtons | None = Field(default=None, gt=0, description="Largest tension.")
    max_rate: Annotated[float, Quantity("N/s")] | None = Field(
        default=None, gt=0, description="Greatest rate of the tension."
    )
    max_shortening: Metres | None = Field(
        default=None,
        gt=0,
        description="Length that a share of 1 takes in, of the path along the arm at rest; with "
        "pair = true the other one is let out by as much.",
    )
    stiffness: Newtons | None = Field(
        default=None, gt=0, description="Axial stiffness EA of the tendon."
    )
    max_speed: MetresPerSecond | None = Field(
        default=None, gt=0, description="Greatest speed of the winch."
    )
    twist_deg: Annotated[Degrees, Only(3)] = Field(
        default=0.0,
        description="How far it winds about the axis over its span, from m_1 toward m_2.",
    )

    def _conflicts(self) -> Iterator[Mistake]:
        yield from super()._conflicts()
        if self.offset is None:
            yield Mistake("offset", "missing, takes a number (m)")


def thread_names(chambers: tuple[Chamber, ...], tendons: tuple[Tendon, ...]) -> tuple[str, ...]:
    """Return the names of the inputs of chambers and tendons."""
    named = {"chamber": chambers, "tendon": tendons}
    return tuple(
        thread.name or f"{group}_{index}"
        for group, threads in named.items()
        for index, thread in enumerate(threads)
    )


def thread_conflicts(
    chambers: tuple[Chamber, ...], tendons: tuple[Tendon, ...], arm: Arm
) -> Iterator[Mistake]:
    """Yield sides that a planar arm does not have, and names that two inputs share.

    Also spans where the arm has no node that bends, and more length than it has to give.
    """
    bends = 1 - 0.5 / (arm.nodes - 1)
    keys = {name: f"base.channels.{name}" for name in CHANNELS[3]}
    threads: list[Chamber | Tendon] = [*chambers, *tendons]
    every = zip(threads, thread_names(chambers, tendons), strict=True)
    for number, (thread, name) in enumerate(every):
        index = number - len(chambers)
        key = f"chamber.{number}" if index < 0 else f"tendon.{index}"
        if thread.span[0] >= bends:
            text = f"got {shown(thread.span)}; must begin below {bends:.6g}, half an edge before "
            yield Mistake(f"{key}.span", f"{text}the tip, where the arm bends. Try more arm.nodes")
        if arm.dimension == 2 and thread.angle_deg % 180:
            text = f"got {thread.angle_deg}, takes 0 or 180 (degrees); others need "
            yield Mistake(f"{key}.angle_deg", f"{text}arm.dimension = 3")
        yield from (each.under(key) for each in _content_conflicts(thread, arm.length))
        if name in keys:
            text = f"got {shown(name)}, as {keys[name]} is called; takes another"
            yield Mistake(f"{key}.name", text)
        keys[name] = key


def _content_conflicts(thread: Chamber | Tendon, length: float) -> Iterator[Mistake]:
    """Yield more length or volume than is to be taken from the part of arm that a thread runs."""
    most = (thread.span[1] - thread.span[0]) * length
    if isinstance(thread, Tendon):
        key, given, unit = "max_shortening", thread.max_shortening, "m"
    else:
        key, unit = "max_volume", "m3"
        given, most = thread.max_volume if thread.pair else None, most * (thread.area or math.inf)
    if given is not None and given >= most:
        whose = "what the tendon runs along" if unit == "m" else "what the other chamber holds"
        yield Mistake(key, f"got {given}, takes a number below {most:g} ({unit}), {whose}")
