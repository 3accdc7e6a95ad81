"""Chambers and tendons: soft actuators along the arm."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated

from pydantic import Field

from crinoid.scenario.dimension import Only
from crinoid.scenario.errors import Mistake, shown
from crinoid.scenario.model import Model
from crinoid.scenario.quantity import (
    NAME,
    AsTuple,
    Degrees,
    Newtons,
    Pair,
    Quantity,
    Seconds,
    SquareMetres,
    Times,
    length_conflicts,
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
    """Shares of the largest pressure or tension over time, joined by straight lines."""

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

    name: Annotated[str | None, NAME] = Field(
        default=None,
        pattern="^[a-z][a-z0-9_]*$",
        description="Name of its input; chamber_0, tendon_0 and so on if left out.",
    )
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
        low, high = self.span
        if not 0 <= low < high <= 1:
            yield Mistake("span", f"got {shown(self.span)}, takes [a, b] with 0 <= a < b <= 1")
        offsets = self.offset if isinstance(self.offset, tuple) else (self.offset or 0.0,)
        if min(offsets) < 0:
            text = f"got {shown(self.offset)}, takes 0 or more (m); angle_deg tells the side"
            yield Mistake("offset", text)
        if self.schedule is not None and not self.pair:
            for index, share in enumerate(self.schedule.share):
                if share < 0:
                    text = f"got {share}, takes a number from 0 to 1; pair = true takes one below 0"
                    yield Mistake(f"schedule.share.{index}", text)


class Chamber(Thread):
    """A chamber whose fluid pushes along the arm: hydraulic or pneumatic."""

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

    max_tension: Newtons = Field(gt=0, description="Largest tension.")
    max_rate: Annotated[float, Quantity("N/s")] | None = Field(
        default=None, gt=0, description="Greatest rate of the tension."
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
    chambers: tuple[Chamber, ...], tendons: tuple[Tendon, ...], dimension: int
) -> Iterator[Mistake]:
    """Yield sides that a planar arm does not have, and names that two inputs share."""
    keys = {name: f"base.channels.{name}" for name in CHANNELS[3]}
    every = zip([*chambers, *tendons], thread_names(chambers, tendons), strict=True)
    for number, (thread, name) in enumerate(every):
        index = number - len(chambers)
        key = f"chamber.{number}" if index < 0 else f"tendon.{index}"
        if dimension == 2 and thread.angle_deg % 180:
            text = f"got {thread.angle_deg}, takes 0 or 180 (degrees); others need "
            yield Mistake(f"{key}.angle_deg", f"{text}arm.dimension = 3")
        if name in keys:
            text = f"got {shown(name)}, as {keys[name]} is called; takes another"
            yield Mistake(f"{key}.name", text)
        keys[name] = key
