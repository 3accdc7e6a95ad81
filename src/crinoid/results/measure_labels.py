"""Words and units of measures, for tables, figures and pages."""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import xarray as xr

from crinoid.results.metrics import MEASURES, own_words
from crinoid.results.units import DEGREES, Unit, largest, length_unit, power_of_ten, si_unit
from crinoid.scenario.kinds import unit_at
from crinoid.scenario.scenario import scenario_schema

_PREFIXED = ("s", "N", "N m", "J")
_MAIN = (
    *("rms_error", "p95_error", "max_error", "within_tolerance", "steady_error"),
    *("rms_error_uncontrolled", "rms_angle_error", "max_angle_error"),
    *("rise_time", "overshoot", "settling_time", "work"),
    *("max_base_force", "max_base_moment", "max_strain", "life", "min_gap", "vehicle_excursion"),
)


def plain_number(value: float) -> str:
    """Return a number with four digits, plainly, or with a power of ten."""
    rounded = float(f"{value:.4g}")
    if rounded == 0 or 1e-4 <= abs(rounded) < 1e7:
        return np.format_float_positional(rounded, trim="-")
    digits, power = f"{rounded:.3e}".split("e")
    raised = power_of_ten(int(power))
    factor = f"{float(digits):g}"
    return raised if factor == "1" else f"{factor} \N{MULTIPLICATION SIGN} {raised}"


def plain_unit(unit: str) -> str:
    """Return a unit as tables show it: ``m/s`` for ``m s-1``, nothing for ``1``."""
    over = [part for part in unit.split() if part != "1" and not part.endswith("-1")]
    under = [part.removesuffix("-1") for part in unit.split() if part.endswith("-1")]
    return "/".join([" ".join(over) or "1" * bool(under), *under])


def label_of(name: str) -> str:
    """Return the words of a measure, from its name in files."""
    return MEASURES[name].words if name in MEASURES else own_words(name)


def main_measures(names: Iterable[str]) -> list[str]:
    """Return the measures of a table in a terminal: the main ones, and those of packages."""
    known = list(names)
    own = [name for name in known if name not in MEASURES]
    return [*(name for name in _MAIN if name in known), *own]


def key_label(key: str) -> str:
    """Return words for a key of a scenario, with its unit, as at an axis."""
    words = key.removeprefix("control.").replace(".", " ").replace("_", " ")
    unit = plain_unit(unit_at(scenario_schema(), key))
    return f"{words} ({unit})" if unit else words


def unit_of(about: Mapping[str, Any], magnitude: float) -> Unit:
    """Return a readable unit of a measure, from its attributes, for values in SI of a size."""
    unit = str(about.get("units", "1"))
    if unit == "m":
        return length_unit(magnitude)
    if unit == "rad":
        return DEGREES
    if unit == "1" and str(about.get("long_name")).startswith("share"):
        return Unit(100.0, "%")
    return si_unit(magnitude, unit) if unit in _PREFIXED else Unit(1.0, plain_unit(unit))


def unit_for(values: xr.DataArray) -> Unit:
    """Return a readable unit of the values of a measure in a dataset."""
    return unit_of(values.attrs, largest(np.asarray(values.values, float)))


def head_of(name: str, unit: Unit) -> str:
    """Return the label of a measure and its unit, as at an axis."""
    return f"{label_of(name)} ({unit.name})" if unit.name else label_of(name)
