"""Units of files: the factor from each to SI."""

import re
from functools import cache, partial

from crinoid.recording.texts import MINUS

_COMMON = {"m/s": ("m/s", "m s-1"), "1": ("1", "-")}
"""Units of most files; the library for all others takes half a second to load."""
_BEARING = re.compile(
    r"(\N{DEGREE SIGN}|deg(ree)?s?)[ _]*(t|true|(cw |clockwise )?from (true )?north)?"
)
_PIXEL = re.compile(r"\b(px|pixels?|dots?)\b")
"""Units of a picture, to which the library gives the size of those of a screen."""


@cache
def factor(units: str, to: str) -> float | None:
    """Return the factor from a unit to one of SI, or None for an unknown or another kind of unit.

    Units are those of UDUNITS and CF, also ``since`` a date, and usual words such as knots, in
    small or capital letters.
    """
    units = units.replace(MINUS, "-").strip()
    text = re.split(r"\ssince\s", units, maxsplit=1, flags=re.IGNORECASE)[0]
    if text in _COMMON.get(to, (to,)):
        return 1.0
    from cf_xarray.units import units as registry

    if _PIXEL.search(text.lower()):
        return None
    text = "degree" if _BEARING.fullmatch(text.lower()) else text
    for form in (text, text.lower()):
        try:
            one = registry.Quantity(1.0, registry.parse_units(form))
            return float(one.to("dimensionless" if to == "1" else to).magnitude)
        except Exception:  # anything that the library makes of the text
            continue
    return None


time_factor, velocity_factor, length_factor, angle_factor, no_unit = (
    partial(factor, to=each) for each in ("s", "m/s", "m", "rad", "1")
)
"""Factors from a unit to s, m/s, m, rad and 1, or None for an unknown unit."""
