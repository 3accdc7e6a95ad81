"""The target of the tip: a position or a path."""

from collections.abc import Iterator
from itertools import chain, pairwise
from typing import Annotated, Any, Literal

from pydantic import Field

from crinoid.scenario.document import RecordFile
from crinoid.scenario.errors import Mistake, got, missing, one_of, shown
from crinoid.scenario.model import Model, entry
from crinoid.scenario.quantity import (
    INTERVALS,
    LATEST,
    OPPOSITE,
    PER_AXIS,
    AsTuple,
    Components,
    Count,
    Degrees,
    Hertz,
    ListOf,
    Metres,
    Only,
    Quantity,
    Seconds,
    Times,
    Triple,
    direction_conflicts,
    length_conflicts,
    time_conflicts,
    unit_vector,
)

_OF_PATH = {
    "circle": ("radius", "period", "centre", "normal", "phase_deg", "start", "ramp_time"),
    "sine": ("amplitude", "frequency_hz", "centre", "phase_deg", "start", "ramp_time"),
    "line": ("to", "travel_time", "velocity", "start", "ramp_time"),
    "file": ("file", "time_column", "tip_columns", "angle_column", "direction_columns", "skip"),
}
"""Keys of each path."""
_NEEDED = ("radius", "period", "amplitude", "frequency_hz", "file")  # keys that their path requires
_PATHS = {
    key: [path for path, keys in _OF_PATH.items() if key in keys]
    for key in (*_NEEDED, *chain.from_iterable(_OF_PATH.values()))
}
"""Paths of each key."""

TipTarget = Annotated[
    Literal["initial"] | Components | ListOf[Components],
    Quantity(
        "m",
        '"initial", [x, z] or, with time, a list of [x, z]',
        '"initial", [x, y, z] or, with time, a list of [x, y, z]',
    ),
    PER_AXIS,
]
AngleTarget = Annotated[
    Literal["initial"] | float | ListOf[float],
    Quantity("degrees", '"initial", a number or, with time, a list of numbers'),
    Only(2, "Use direction instead."),
]
DirectionTarget = Annotated[
    Literal["initial"] | Triple | Annotated[tuple[Triple, ...], AsTuple, Field(min_length=1)],
    Quantity(expects='"initial", [x, y, z] or, with time, a list of [x, y, z]'),
    Only(3, "Use angle_deg instead."),
]

Columns = ListOf[str]
_OF_TIP = ("[x, z]", "[x, y, z]")
MaybePosition = Annotated[Components | None, Quantity("m", *_OF_TIP), PER_AXIS]
MaybeVelocity = Annotated[Components | None, Quantity("m/s", *_OF_TIP), PER_AXIS]


class Target(Model):
    """The target of the tip: a position, or a path.

    A path goes through points in time (`time`, with lists), is a `circle`, a `sine` or a `line`
    from where the tip is, or comes from a `file`.
    """

    tip: TipTarget = entry(
        "initial", "Position of the tip, or start of a path; initial: its position at t = 0."
    )
    angle_deg: AngleTarget = entry(
        "initial", "Direction of the tip; initial: its direction at t = 0."
    )
    direction: DirectionTarget = entry(
        "initial", "Direction of the tip, of any length; initial: its direction at t = 0."
    )
    time: Times | None = entry(
        None, "Times of a path, increasing; it is constant before and after."
    )
    path: Literal["circle", "sine", "line", "file"] | None = entry(
        None, "Path of the tip: a formula or a file."
    )
    frame: Literal["world", "base"] = entry(
        "world",
        "base: positions count from base.position, and the target moves and turns with the "
        "prescribed motion (base.motion), not with the servos.",
    )
    feed_forward: bool | None = entry(
        None,
        "Whether the channels follow the path directly, through the tip's response at rest, so "
        "that the controller corrects only the rest; true by default.",
    )
    tolerance: Metres | None = entry(
        None, "Tip error within which the tip is on target; tables give the share of time.", gt=0
    )
    judged_from: Seconds | None = entry(
        None,
        "Time from which errors count, in measures and in tuning; by default the end of the last "
        "ramp of a flow, a load or a prescribed motion, 0 without one.",
        ge=0,
    )
    centre: MaybePosition = entry(
        None, "Centre of a circle or a sine; by default it starts at tip."
    )
    radius: Metres | None = entry(None, "Radius of a circle.", gt=0)
    period: Seconds | None = entry(
        None, "Period of a circle, from x towards z; in space about normal. Negative: reversed."
    )
    normal: Annotated[
        Triple | None,
        Quantity(expects="[x, y, z]"),
        Only(3, "The circle of a planar arm is in its plane."),
    ] = entry(
        None, "Axis of a circle, by the right-hand rule; by default [0, -1, 0], from x towards z."
    )
    amplitude: MaybePosition = entry(None, "Amplitude of a sine, to either side.")
    frequency_hz: Hertz | None = entry(None, "Frequency of a sine.", gt=0)
    phase_deg: Degrees | None = entry(
        None,
        "Phase at the start of a circle or a sine, 0 by default: a circle on the side of x (or "
        "of y where normal is along x), a sine at its centre.",
    )
    to: MaybePosition = entry(None, "Where a line ends.")
    travel_time: Seconds | None = entry(
        None,
        "Time of a line to its end, from rest to rest with the least jerk.",
        ge=INTERVALS[0],
        le=INTERVALS[1],
    )
    velocity: MaybeVelocity = entry(
        None, "Velocity of a line without end, instead of to and travel_time."
    )
    start: Seconds | None = entry(
        None, "Start time of a circle, a sine or a line; 0 by default.", ge=0, le=LATEST
    )
    ramp_time: Seconds | None = entry(
        None,
        "Time to reach full speed, along half a cosine; 1 by default. Not of a line with an end.",
        ge=0,
    )
    file: RecordFile | None = entry(
        None,
        "CSV or netCDF file of a path; a relative path starts from the scenario file, with "
        "--set and in Python from the working directory.",
    )
    time_column: str | None = entry(None, 'Column of times; "time" by default.', min_length=1)
    tip_columns: Annotated[
        Columns | None,
        Quantity(
            expects="a list of names, for x and z", in_space="a list of names, for x, y and z"
        ),
        Count(plane=(2,), space=(3,)),
    ] = entry(None, "Columns of positions; by default the names of the axes.")
    angle_column: Annotated[str | None, Only(2, "Use direction_columns instead.")] = entry(
        None, "Column of angles, if there is one.", min_length=1
    )
    direction_columns: Annotated[
        Annotated[tuple[str, str, str], AsTuple] | None,
        Quantity(expects="a list of three names"),
        Only(3, "Use angle_column instead."),
    ] = entry(None, "Columns of directions, if there are any.")
    skip: Seconds | None = entry(
        None,
        "Time of the file at which the run starts; 0 by default. Dates count from the first.",
        ge=0,
    )

    @property
    def tip_path(self) -> tuple[tuple[float, ...], ...] | None:
        """The points of a path of the tip (m); None for one position."""
        return _points(self.tip) or None

    @property
    def angle_path_deg(self) -> tuple[float, ...] | None:
        """The angles of a path, in degrees; None for one angle."""
        return self.angle_deg if isinstance(self.angle_deg, tuple) else None

    @property
    def direction_path(self) -> tuple[tuple[float, ...], ...] | None:
        """The unit vectors of a path; None for one direction."""
        return tuple(map(unit_vector, _points(self.direction))) or None

    @property
    def steady_direction(self) -> tuple[float, ...] | None:
        """The unit vector of one direction; None for a path, or the direction at t = 0."""
        vector = _vector(self.direction)
        return unit_vector(vector) if vector else None

    @property
    def _lists(self) -> dict[str, tuple[Any, ...]]:
        """The points of a path in time by key: of the tip, of its angle or of its direction."""
        points = _points(self.direction) or None
        paths = {"tip": self.tip_path, "angle_deg": self.angle_path_deg, "direction": points}
        return {key: path for key, path in paths.items() if path is not None}

    @property
    def moves(self) -> bool:
        """Whether the target moves, other than with the submarine."""
        return self.path is not None or self.time is not None

    @property
    def feeds_forward(self) -> bool:
        """Whether the channels follow the path directly."""
        return self.moves and self.feed_forward is not False

    def _conflicts(self) -> Iterator[Mistake]:
        yield from self._direction_conflicts()
        for key, paths in _PATHS.items():
            value = getattr(self, key)
            if value is not None and self.path not in paths:
                yield Mistake(key, got(value, f"be left out without path = {one_of(paths)}"))
        if self.path is None:
            yield from self._time_conflicts()
        else:
            yield from self._path_conflicts(self.path)
        if self.feed_forward and not self.moves:
            text = got(True, "be left out without path or time", "The target does not move.")
            yield Mistake("feed_forward", text)

    def _path_conflicts(self, path: str) -> Iterator[Mistake]:
        """Yield mistakes of a path by a formula or from a file."""
        where = f"with path = {shown(path)}"
        for key in _OF_PATH[path]:
            if key in _NEEDED and getattr(self, key) is None:
                yield Mistake(key, missing(f"be given {where}"))
        if self.time is not None:
            yield self.mistake("time", f"be left out {where}")
        else:
            for key in self._lists:
                yield self.mistake(key, f"be no list {where}")
            yield from self._start_conflicts(path)
        if self.period == 0 and path == "circle":
            yield Mistake("period", got(0.0, "be a number that is not 0 (s)"))
        if self.normal is not None and path == "circle":
            yield from direction_conflicts("normal", self.normal)
        if path == "line":
            yield from self._line_conflicts()
        if path == "file":
            for key, other in (("angle_column", "angle_deg"), ("direction_columns", "direction")):
                value = getattr(self, key)
                if value is not None and getattr(self, other) != "initial":
                    yield Mistake(key, got(value, f"be left out with {other}"))

    def _start_conflicts(self, path: str) -> Iterator[Mistake]:
        """Yield a position at which a path that has its own would start."""
        if self.tip == "initial" or self.tip_path is not None:
            return
        if self.centre is not None:
            yield self.mistake("centre", "be left out with tip, where the path starts")
        if path == "file":
            yield self.mistake("tip", 'be left out with path = "file"')

    def _line_conflicts(self) -> Iterator[Mistake]:
        if self.to is None and self.velocity is None:
            yield Mistake("to", missing('be given with path = "line", or velocity'))
        elif self.to is not None and self.velocity is not None:
            yield self.mistake("to", "be left out with velocity")
        elif self.to is None and self.travel_time is not None:
            yield self.mistake("travel_time", "be left out with velocity", "Use ramp_time instead.")
        elif self.to is not None:
            if self.travel_time is None:
                yield Mistake("travel_time", missing("be a number (s) with to"))
            if self.ramp_time is not None:
                yield self.mistake("ramp_time", "be left out with to", "Use travel_time instead.")

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
                must = "differ from the opposite of the one before"
                text = got(after, must, "Add a direction between them.")
                yield Mistake(f"direction.{index}", text)

    def _time_conflicts(self) -> Iterator[Mistake]:
        """Yield mistakes of a path through points in time."""
        given = self._lists
        if self.time is None:
            if given:
                must = f"be a list (s) with a list in {' and '.join(given)}"
                yield Mistake("time", missing(must))
            return
        if not given:
            planar, spatial = (
                got(self.time, f"be left out without a list in tip or {key}")
                for key in ("angle_deg", "direction")
            )
            yield Mistake("time", planar, in_space=spatial)
        for key, path in given.items():
            yield from length_conflicts(key, path, self.time)
        yield from time_conflicts(self.time)
        if self.time and self.time[0] < 0:
            yield Mistake("time.0", got(self.time[0], "be a number of 0 or more (s)"))


_Aim = str | tuple[float, ...] | tuple[tuple[float, ...], ...]


def _points(aim: _Aim) -> tuple[tuple[float, ...], ...]:
    """Return the points of a path; none of a single vector or a word."""
    return tuple(item for item in aim if isinstance(item, tuple))


def _vector(aim: _Aim) -> tuple[float, ...]:
    """Return a single vector; nothing of a path or a word."""
    return tuple(item for item in aim if isinstance(item, float))
