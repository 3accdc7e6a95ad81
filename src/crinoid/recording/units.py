"""Units as files write them, turned into SI."""

import math
import re

_LENGTHS = {
    **dict.fromkeys(("m", "meter", "meters", "metre", "metres"), 1.0),
    **dict.fromkeys(("cm", "centimeter", "centimeters", "centimetre", "centimetres"), 1e-2),
    **dict.fromkeys(("mm", "millimeter", "millimeters", "millimetre", "millimetres"), 1e-3),
}
_ANGLES = {
    **dict.fromkeys(("deg", "degree", "degrees", "\N{DEGREE SIGN}"), math.radians(1.0)),
    **dict.fromkeys(("rad", "radian", "radians"), 1.0),
}
_SECONDS = ("s", "sec", "secs", "second", "seconds")
_TIMES = {
    **dict.fromkeys(_SECONDS, 1.0),
    **dict.fromkeys(("ns", "nanosecond", "nanoseconds"), 1e-9),
    **dict.fromkeys(("us", "microsecond", "microseconds"), 1e-6),
    **dict.fromkeys(("ms", "msec", "millisecond", "milliseconds"), 1e-3),
    **dict.fromkeys(("min", "minute", "minutes"), 60.0),
    **dict.fromkeys(("h", "hr", "hour", "hours"), 3600.0),
    **dict.fromkeys(("d", "day", "days"), 86400.0),
}
# m/s, m s-1, m s^-1, m.s**-1, metres per second
_RATE = re.compile(r"([a-z]+)(?:\s*(?:/|\bper\b)\s*([a-z]+)|[\s.*·]\s*([a-z]+)\s*[\^*]*\(?-1\)?)")


def velocity_factor(units: str) -> float | None:
    """Return what turns a velocity into m/s, or None for an unknown unit."""
    found = _RATE.fullmatch(units.strip().lower())
    if found is None or (found[2] or found[3]) not in _SECONDS:
        return None
    return _LENGTHS.get(found[1])


def length_factor(units: str) -> float | None:
    """Return what turns a length into m, or None for an unknown unit."""
    return _LENGTHS.get(units.strip().lower())


def angle_factor(units: str) -> float | None:
    """Return what turns an angle into rad, or None for an unknown unit."""
    return _ANGLES.get(units.strip().lower())


def is_unit(text: str) -> bool:
    """Whether a text names a unit that is known, with or without brackets."""
    bare = text.strip().strip("[]()")
    return any(
        factor(bare) is not None
        for factor in (velocity_factor, length_factor, time_factor, angle_factor)
    )


def time_factor(units: str) -> float | None:
    """Return what turns a time, also one ``since`` a date, into s, or None for an unknown unit."""
    unit, _, _ = units.strip().lower().partition(" since ")
    return _TIMES.get(unit.strip())
