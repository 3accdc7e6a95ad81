"""The target: where the tip is wanted."""

from collections.abc import Iterator
from itertools import pairwise
from typing import Annotated, Literal

from pydantic import Field

from crinoid.scenario.dimension import Count, Only
from crinoid.scenario.errors import Mistake, shown
from crinoid.scenario.files import File
from crinoid.scenario.model import Model
from crinoid.scenario.path import key_conflicts
from crinoid.scenario.quantity import (
    INTERVALS,
    LATEST,
    OPPOSITE,
    PER_AXIS,
    AsTuple,
    Components,
    Degrees,
    Hertz,
    Metres,
    Quantity,
    Seconds,
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

Columns = Annotated[tuple[str, ...], AsTuple]
_OF_TIP = ("[x, z]", "[x, y, z]")
MaybePosition = Annotated[Components | None, Quantity("m", *_OF_TIP), PER_AXIS]
MaybeVelocity = Annotated[Components | None, Quantity("m/s", *_OF_TIP), PER_AXIS]


class Target(Model):
    """Where the tip is wanted: a position, or a path.

    A path goes through points in time (`time`, with lists), is a `circle`, a `sine` or a `line`
    from where the tip is, or comes from a `file`.
    """

    tip: TipTarget = Field(
        default="initial",
        description="Position of the tip, or where a path begins; initial: where it is at t = 0.",
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
    path: Literal["circle", "sine", "line", "file"] | None = Field(
        default=None, description="How the tip is to move, by a formula or as in a file."
    )
    frame: Literal["world", "base"] = Field(
        default="world",
        description="base: positions count from base.position, and the target moves and turns "
        "with the prescribed motion of the submarine (base.motion), not with the servos.",
    )
    feed_forward: bool | None = Field(
        default=None,
        description="Whether the channels follow the path at once, through the tip's response at "
        "rest, and the controller corrects what is left; if left out, they do.",
    )
    centre: MaybePosition = Field(
        default=None,
        description="Centre of a circle or a sine; if left out, it begins at tip.",
    )
    radius: Metres | None = Field(default=None, gt=0, description="Radius of a circle.")
    period: Seconds | None = Field(
        default=None,
        description="Period of a circle, from x towards z; in space about normal. Negative: the "
        "other way round.",
    )
    normal: Annotated[
        Triple | None,
        Quantity(takes="[x, y, z]"),
        Only(3, "but a planar arm has its circle in its plane"),
    ] = Field(
        default=None,
        description="Axis that a circle turns about, by the right-hand rule; [0, -1, 0] if left "
        "out: from x towards z.",
    )
    amplitude: MaybePosition = Field(
        default=None, description="Amplitude of a sine, to either side."
    )
    frequency_hz: Hertz | None = Field(default=None, gt=0, description="Frequency of a sine.")
    phase_deg: Degrees | None = Field(
        default=None,
        description="Where a circle or a sine begins; 0 if left out: a circle on the side of x (or "
        "of y where normal is along x), a sine in its middle.",
    )
    to: MaybePosition = Field(default=None, description="Where a line ends.")
    travel_time: Seconds | None = Field(
        default=None,
        ge=INTERVALS[0],
        le=INTERVALS[1],
        description="How long a line takes to its end, from rest to rest with the least jerk.",
    )
    velocity: MaybeVelocity = Field(
        default=None, description="Velocity of a line without end, instead of to and travel_time."
    )
    start: Seconds | None = Field(
        default=None,
        ge=0,
        le=LATEST,
        description="When a circle, a sine or a line sets in; 0 if left out.",
    )
    ramp_time: Seconds | None = Field(
        default=None,
        ge=0,
        description="How long they take to come up to speed, along half a cosine; 1 if left out. "
        "Not of a line with an end.",
    )
    file: File | None = Field(
        default=None,
        description="CSV or netCDF file of a path. A relative path starts from the scenario file "
        "that names it, with --set and in Python from the working directory.",
    )
    time_column: str | None = Field(
        default=None, min_length=1, description='Its column of times; "time" if left out.'
    )
    tip_columns: Annotated[
        Columns | None,
        Quantity(takes="a list of names, for x and z", in_space="a list of names, for x, y and z"),
        Count(plane=(2,), space=(3,)),
    ] = Field(default=None, description="Its columns of positions; named as the axes if left out.")
    angle_column: Annotated[str | None, Only(2, "but a spatial arm takes direction_columns")] = (
        Field(default=None, min_length=1, description="Its column of angles, if they are wanted.")
    )
    direction_columns: Annotated[
        Annotated[tuple[str, str, str], AsTuple] | None,
        Quantity(takes="a list of three names"),
        Only(3, "but a planar arm takes angle_column"),
    ] = Field(default=None, description="Its columns of directions, if they are wanted.")
    skip: Seconds | None = Field(
        default=None,
        ge=0,
        description="Time of the file when the run begins; 0 if left out. Dates count from the "
        "first one.",
    )

    @property
    def tip_path(self) -> tuple[tuple[float, ...], ...] | None:
        """The points of a path of the tip, in m; None if the tip is to stay where it is."""
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

    @property
    def moves(self) -> bool:
        """Whether the target moves, other than with the submarine."""
        return self.path is not None or self.time is not None

    @property
    def feeds_forward(self) -> bool:
        """Whether the channels follow the path at once."""
        return self.moves and self.feed_forward is not False

    def _conflicts(self) -> Iterator[Mistake]:
        yield from self._direction_conflicts()
        yield from key_conflicts(self)
        if self.path is None:
            yield from self._path_conflicts()
        if self.feed_forward and not self.moves:
            yield Mistake("feed_forward", "got true, goes with a target that moves: path or time")

    def _direction_conflicts(self) -> Iterator[Mistake]:
        vector, points = _vector(self.direction), _points(self.direction)
        if vector:
            yield from direction_conflicts("direction", vector)
        for index, point in enumerate(points):
            yield from direction_conflicts(f"direction.{index}", point)
        for index, (before, after) in enumerate(pairwise(points), start=1):
            if not (any(before) and any(after)):
                continue
            ways = zip(unit_vector(before), unit_vector(after), strict=True)
            if sum(a * b for a, b in ways) < OPPOSITE:
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
