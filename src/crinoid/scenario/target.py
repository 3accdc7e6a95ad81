"""The target: where the tip is wanted."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise
from typing import Annotated, Literal

from pydantic import Field

from crinoid.scenario.dimension import Only
from crinoid.scenario.errors import Mistake, shown
from crinoid.scenario.model import Model
from crinoid.scenario.quantity import (
    PER_AXIS,
    AsTuple,
    Components,
    Quantity,
    Times,
    Triple,
    direction_conflicts,
    length_conflicts,
    time_conflicts,
    unit_vector,
)

__all__ = ["Target"]

TipTarget = Annotated[
    Literal["initial"] | Components | Annotated[tuple[Components, ...], AsTuple],
    Quantity(
        "m",
        '"initial", [x, z] or, with time, a list of [x, z]',
        '"initial", [x, y, z] or, with time, a list of [x, y, z]',
    ),
    PER_AXIS,
]
AngleTarget = Annotated[
    Literal["initial"] | float | Annotated[tuple[float, ...], AsTuple],
    Quantity("degrees", '"initial", a number or, with time, a list of numbers'),
    Only(2, "but a spatial arm takes direction: arm.dimension = 3"),
]
DirectionTarget = Annotated[
    Literal["initial"] | Triple | Annotated[tuple[Triple, ...], AsTuple, Field(min_length=1)],
    Quantity(takes='"initial", [x, y, z] or, with time, a list of [x, y, z]'),
    Only(3, "but a planar arm takes angle_deg"),
]

_OPPOSITE = -1 + 1e-9
"""Cosine of an angle between directions from which on no way between them is the shorter one."""


class Target(Model):
    """Where the tip is wanted: a place, or a path through points in time."""

    tip: TipTarget = Field(
        default="initial", description="Place of the tip; initial: where it is at t = 0."
    )
    angle_deg: AngleTarget = Field(
        default="initial", description="Direction of the tip; initial: as it is at t = 0."
    )
    direction: DirectionTarget = Field(
        default="initial",
        description="Direction of the tip, its length is ignored; initial: as it is at t = 0.",
    )
    time: Times | None = Field(
        default=None, description="Times of a path, increasing; its ends are held before and after."
    )

    @property
    def tip_path(self) -> tuple[tuple[float, ...], ...] | None:
        """The points of a path of the tip, in m; None if the tip is to stay in one place."""
        return _points(self.tip) or None

    @property
    def angle_path_deg(self) -> tuple[float, ...] | None:
        """The angles of a path, in degrees; None if there is one angle to keep."""
        return self.angle_deg if isinstance(self.angle_deg, tuple) else None

    @property
    def direction_path(self) -> tuple[tuple[float, ...], ...] | None:
        """The directions of a path, of length one; None if there is one direction to keep."""
        return tuple(map(unit_vector, _points(self.direction))) or None

    @property
    def steady_direction(self) -> tuple[float, ...] | None:
        """The one direction to keep, of length one; None if there is a path, or as at t = 0."""
        vector = _vector(self.direction)
        return unit_vector(vector) if vector else None

    def _conflicts(self) -> Iterator[Mistake]:
        yield from self._direction_conflicts()
        yield from self._path_conflicts()

    def _direction_conflicts(self) -> Iterator[Mistake]:
        vector, points = _vector(self.direction), _points(self.direction)
        if vector:
            yield from direction_conflicts("direction", vector)
        for index, point in enumerate(points):
            yield from direction_conflicts(f"direction.{index}", point)
        for index, (before, after) in enumerate(pairwise(points), start=1):
            product = sum(a * b for a, b in zip(before, after, strict=True))
            if product < _OPPOSITE * math.hypot(*before) * math.hypot(*after):
                text = f"got {shown(after)}, the opposite of the one before; takes one more between"
                yield Mistake(f"direction.{index}", text)

    def _path_conflicts(self) -> Iterator[Mistake]:
        paths = {
            "tip": self.tip_path,
            "angle_deg": self.angle_path_deg,
            "direction": _points(self.direction) or None,
        }
        given = {key: path for key, path in paths.items() if path is not None}
        if self.time is None:
            if given:
                yield Mistake("time", f"missing, a path ({' and '.join(given)}) takes it (s)")
            return
        if not given:
            text = "goes with a path; takes tip or {} as a list as long"
            planar, spatial = map(text.format, ("angle_deg", "direction"))
            yield Mistake("time", planar, in_space=spatial)
        for key, path in given.items():
            yield from length_conflicts(key, path, self.time)
        yield from time_conflicts(self.time)
        if self.time and self.time[0] < 0:
            yield Mistake("time.0", f"got {self.time[0]}, takes a number of 0 or more (s)")


_Wanted = str | tuple[float, ...] | tuple[tuple[float, ...], ...]


def _points(wanted: _Wanted) -> tuple[tuple[float, ...], ...]:
    """Return the points of a path; none where one vector is given, or a word."""
    return tuple(item for item in wanted if isinstance(item, tuple))


def _vector(wanted: _Wanted) -> tuple[float, ...]:
    """Return the one vector that is given; nothing where a path is, or a word."""
    return tuple(item for item in wanted if isinstance(item, float))
