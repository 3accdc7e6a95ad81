"""Which keys of a target go with which path."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from crinoid.scenario.errors import Mistake, one_of, shown
from crinoid.scenario.quantity import direction_conflicts

if TYPE_CHECKING:
    from crinoid.scenario.target import Target

_NEEDS: dict[str, tuple[str, ...]] = {
    "circle": ("radius", "period"),
    "sine": ("amplitude", "frequency_hz"),
    "line": (),
    "file": ("file",),
}
"""Keys that a path cannot do without."""
_MAY: dict[str, tuple[str, ...]] = {
    "circle": ("centre", "normal", "phase_deg", "start", "ramp_time"),
    "sine": ("centre", "phase_deg", "start", "ramp_time"),
    "line": ("to", "travel_time", "velocity", "start", "ramp_time"),
    "file": ("time_column", "tip_columns", "angle_column", "direction_columns", "skip"),
}
"""Keys that it may do with."""
_TAKES = {path: (*_NEEDS[path], *_MAY[path]) for path in _NEEDS}


def key_conflicts(target: Target) -> Iterator[Mistake]:
    """Yield keys of a target that do not go with its path, and those that it lacks."""
    path = target.path
    for key in dict.fromkeys(key for keys in _TAKES.values() for key in keys):
        kinds = [kind for kind, keys in _TAKES.items() if key in keys]
        if getattr(target, key) is not None and path not in kinds:
            yield Mistake(key, f"goes with path = {one_of(kinds)}")
    if path is None:
        return
    for key in _NEEDS[path]:
        if getattr(target, key) is None:
            yield Mistake(key, f"missing, path = {shown(path)} takes it")
    yield from _point_conflicts(target, path)
    match path:
        case "circle":
            if target.period == 0:
                yield Mistake("period", "got 0.0, takes a number that is not 0 (s)")
            if target.normal is not None:
                yield from direction_conflicts("normal", target.normal)
        case "line":
            yield from _line_conflicts(target)
        case "file":
            yield from _column_conflicts(target)


def _point_conflicts(target: Target, path: str) -> Iterator[Mistake]:
    """Yield points in time, and positions that the path has for itself."""
    if target.time is not None:
        yield Mistake("time", f"goes with lists of points, not with path = {shown(path)}")
        return
    listed = {
        "tip": target.tip_path,
        "angle_deg": target.angle_path_deg,
        "direction": target.direction_path,
    }
    for key, points in listed.items():
        if points is not None:
            yield Mistake(key, f"takes no list with path = {shown(path)}, which has its own points")
    if target.tip == "initial" or target.tip_path is not None:
        return
    if target.centre is not None:
        yield Mistake("centre", "does not go with tip, where the path begins; takes one of them")
    if path == "file":
        yield Mistake("tip", 'does not go with path = "file", which has its own points')


def _line_conflicts(target: Target) -> Iterator[Mistake]:
    if (target.to is None) == (target.velocity is None):
        got = "missing" if target.to is None else "got both"
        yield Mistake("to", f'{got}, path = "line" takes either to or velocity')
        return
    if target.to is not None:
        if target.travel_time is None:
            yield Mistake("travel_time", "missing, a line with an end takes it (s)")
        if target.ramp_time is not None:
            yield Mistake("ramp_time", "goes with velocity; with to there is travel_time")
    elif target.travel_time is not None:
        yield Mistake("travel_time", "goes with to; with velocity there is ramp_time")


def _column_conflicts(target: Target) -> Iterator[Mistake]:
    pairs = {
        "angle_column": ("angle_deg", target.angle_deg),
        "direction_columns": ("direction", target.direction),
    }
    for key, (other, value) in pairs.items():
        if getattr(target, key) is not None and value != "initial":
            yield Mistake(key, f"does not go with {other}; takes one of them")
