"""Units of files: the factor from each to SI."""

import re
from functools import cache, partial

_COMMON = {
    **dict.fromkeys(
        (("m/s", "m/s"), ("m s-1", "m/s"), ("m", "m"), ("s", "s"), ("rad", "rad")), 1.0
    ),
    **dict.fromkeys((("1", "1"), ("-", "1"), ("m/m", "1")), 1.0),
}
"""Units of most files; the library for all others takes half a second to load."""
_BEARING = re.compile(
    r"(\N{DEGREE SIGN}|deg(ree)?s?)[ _]*(t|true|(cw |clockwise )?from (true )?north)?"
)

_PIXEL = re.compile(r"\b(px|pixels?|dots?)\b")
"""Units of a picture, to which the library gives the size of those of a screen."""


@cache
def factor(units: str, to: str) -> float | None:
    """Return the factor from a unit to one of SI, or None for an unknown or another kind of unit.

    Units are those of UDUNITS and CF, and usual words such as knots, in small or capital letters.
    """
    text = units.strip()
    if (text, to) in _COMMON:
        return _COMMON[text, to]
    from cf_xarray.units import units as registry

    if _PIXEL.search(text.lower()):
        return None
    text = "degree" if _BEARING.fullmatch(text.lower()) else text
    for form in (text, text.lower()):
        try:
            one = registry.Quantity(1.0, registry.parse_units(form))
            return float(one.to("dimensionless" if to == "1" else to).magnitude)
        except Exception:  # whatever the library makes of the text
            continue
    return None


def time_factor(units: str) -> float | None:
    """Return the factor from a unit of time, also ``since`` a date, to s, or None if unknown."""
    return factor(units.lower().partition(" since ")[0], "s")


velocity_factor = partial(factor, to="m/s")
"""Factor from a unit of velocity to m/s, or None for an unknown unit."""
length_factor = partial(factor, to="m")
"""Factor from a unit of length to m, or None for an unknown unit."""
angle_factor = partial(factor, to="rad")
"""Factor from a unit of angle to rad, or None for an unknown unit."""
no_unit = partial(factor, to="1")
"""Factor from a unit without dimension to 1, or None for another one."""
