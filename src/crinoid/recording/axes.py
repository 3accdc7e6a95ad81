"""Axes of a file: its variables by name, times in seconds, and levels as heights."""

import re
from difflib import get_close_matches
from pathlib import Path

import cf_xarray  # noqa: F401  # the accessor `cf` of datasets
import numpy as np
import pandas as pd
import xarray as xr
from jaxtyping import Float

from crinoid.recording.numbers import check_count, factor_to, finite_numbers, labels_of, numbers_of
from crinoid.recording.texts import listed, reason_of, short
from crinoid.recording.units import length_factor, time_factor
from crinoid.scenario.errors import counted, got, missing, refusal, shown
from crinoid.scenario.quantity import INTERVALS

_FARTHEST = 1e5  # greatest distance of a level from the surface (m)
_THINNEST = 1e-6  # least distance between two levels (m)
_DEPTH = re.compile(r"dep(h|th|tht|thu|thv|thw)?([^a-z].*)?|.*depth.*", re.I)
"""Names of a variable that counts downward from the surface."""
_ABOVE_BED = re.compile(r"height|hab|mab|above|range", re.I)  # names of a height above the bed
_FROM_SURFACE = re.compile(
    r"altitude|elevation|height_above_(mean_sea_level|geoid|geopotential_datum)", re.I
)
"""Names and standard names of a height above the surface at rest."""
_HEIGHT = "height of levels by crinoid"
_TERMS = {"depth": "sea_floor_depth_below_geoid", "eta": "sea_surface_height_above_geoid"}
"""Standard names of terms of a formula, which the library needs and few files have."""
_DATES = {"days": ((6e5, 9e5), (3e4, 6e4)), "ms": ((1e11, 1e14),), "us": ((1e14, 1e17),)}
_DATES["ns"] = ((1e17, np.inf),)
"""Numbers without a unit that look like days of MATLAB or of a spreadsheet, or like parts of
seconds since 1970."""
_CALENDAR = re.compile(r"(19|20)\d\d(0[1-9]|1[0-2])([0-2]\d|3[01])(\d{4}){0,2}")
"""Digits of a year, a month and a day, perhaps of hour and minute too, such as 20240301."""
_COARSE = 0.1  # largest rounding error of times, over their usual step


def find(dataset: xr.Dataset, name: str, key: str, file: str) -> str:
    """Return the variable with a name or a CF standard name."""
    if name in dataset.variables:
        return name
    standard = dataset.cf.standard_names
    found = standard.get(name, [])
    if len(found) == 1:
        return str(found[0])
    if found:
        must = f"name one variable. Several have this standard name: {listed(found)}"
        raise refusal(key, got(name, must))
    names = [str(variable) for variable in dataset.variables]
    alike = [each for each in names if each.lower() == name.lower()]
    if key in ("time", "time_column") and len(alike) == 1:
        return alike[0]
    near = get_close_matches(name, [*names, *standard], n=1)
    hint = f"did you mean {near[0]}?" if near else f"it contains {listed(names) or 'none'}"
    kind = "variable" if Path(file).suffix.lower().startswith(".nc") else "column"
    raise refusal(key, f"got {shown(name)}, no such {kind} in {short(file)}; {hint}")


def only_dimension(variable: xr.DataArray, key: str) -> str:
    """Return the dimension of a variable that must have one."""
    if variable.ndim != 1:
        dims = ", ".join(map(str, variable.dims)) or "none"
        raise refusal(key, f"{variable.name} has dimensions {dims}", "have one dimension")
    return str(variable.dims[0])


def as_numbers(clock: xr.DataArray, key: str = "time") -> xr.DataArray:
    """Return times as numbers, where they are dates of a reader, or texts in a netCDF file."""
    if clock.dtype.kind not in "OSUM" or "odd" in clock.attrs:
        return clock
    dates = clock.values if clock.dtype.kind == "M" else labels_of(clock)
    instants = pd.to_datetime(dates, format="ISO8601", errors="coerce", utc=True)
    if instants.isna().any():
        raise refusal(key, f"{clock.name} has an entry without a date", "contain a date in each")
    numbers = clock.copy(data=instants.as_unit("us").asi8)
    numbers.attrs = {"units": "microseconds since 1970-01-01"}
    return numbers


def seconds(
    variable: xr.DataArray, remarks: list[str], *, key: str = "time"
) -> Float[np.ndarray, " time"]:
    """Return the times of a record (s) since its first sample."""
    name = variable.name
    if variable.size < 2:
        text = f"{name} contains {counted(variable.size, 'instant')}"
        raise refusal(key, text, "contain at least 2")
    variable = as_numbers(variable, key)
    values = finite_numbers(variable, key, "increasing numbers or ISO dates")
    if not variable.attrs.get("units"):
        _refuse_dates(values, str(name), key)
    factor = factor_to(variable, time_factor, key, "seconds", remarks)
    # whole numbers stay whole up to here: nanoseconds since 1970 have more digits than floats
    with np.errstate(over="ignore", invalid="ignore"):
        time = (values - values[0]).astype(float) * factor
        steps = np.diff(time)
    check_order(values, time, str(name), key)
    usual, error = np.median(steps), 0.0
    if values.dtype == np.float32:
        error = float(np.spacing(np.abs(values).max())) * factor / 2
    if error > _COARSE * usual:
        text = f"{name} is in single precision, right to {error:.3g} s in steps of {usual:.3g} s"
        raise refusal(key, text, "be in double precision")
    low, high = INTERVALS
    if not (steps.min() >= low and steps.max() <= high):
        text = f"{name} has steps of {steps.min():.3g} to {steps.max():.3g} s"
        raise refusal(key, text, f"have steps of {low:g} to {high:g} s")
    return time


def check_order(values: np.ndarray, time: Float[np.ndarray, " time"], name: str, key: str) -> None:
    """Refuse times that repeat or go back; ``time`` has them in seconds since the first."""
    # compared before the subtraction, in which unsigned ones would wrap round
    late = np.flatnonzero(~(values[1:] > values[:-1]))
    if late.size:
        after = int(late[0]) + 1
        word = "repeats" if values[after] == values[after - 1] else "goes back"
        levels = word == "repeats" and key == "time"
        hint = "Name the levels in vertical if rows are at several." if levels else ""
        when = f", {time[after - 1]:.6g} s after the first"
        raise refusal(key, f"{name} {word} at entry {after}{when}", "increase", hint)


def _refuse_dates(values: np.ndarray, name: str, key: str) -> None:
    """Refuse times without a unit that look like dates."""
    text = f"{name} names no unit and begins at {values[0]:.12g}, as of a date"
    if all(_CALENDAR.fullmatch(f"{value:.0f}") for value in values[[0, -1]]):
        raise refusal(key, text, "contain ISO dates such as 2024-03-01T06:00")
    for unit, ranges in _DATES.items():
        alike = any(low < values[0] < high for low, high in ranges)
        if alike and (unit != "days" or (np.diff(values) < 1).any()):
            hint = f"Call it {name} ({unit}), or write dates."
            raise refusal(key, f"{text} in {unit}", "name its unit", hint)


def counts_down(level: xr.DataArray) -> bool | None:
    """Return whether levels are depths: by ``positive``, by standard name, or by their name.

    None where none of them says it.
    """
    positive = str(level.attrs.get("positive", "")).strip().lower()
    if positive in ("up", "down"):
        return positive == "down"
    for name in (str(level.attrs.get("standard_name", "")), str(level.name)):
        if _DEPTH.fullmatch(name):
            return True
        if _ABOVE_BED.search(name) or _FROM_SURFACE.search(name):
            return False
    return None


def heights(
    level: xr.DataArray, sign: float, origin: float | None, bed: float | None, remarks: list[str]
) -> Float[np.ndarray, "*time level"]:
    """Return the heights z of levels (m), of each time where they vary.

    A depth counts downward from the surface, an elevation upward from it, another height from the
    bed; each counts from ``origin`` where it is given. A minus sign in its name turns it round.
    """
    name, standard = str(level.name), str(level.attrs.get("standard_name", ""))
    must = "heights or depths (m)"
    if level.ndim == 1:
        values = finite_numbers(level, "vertical", must).astype(float)
    else:  # a level that is missing at times has its mean
        moving = level.copy(data=numbers_of(level, "vertical", must).astype(float))
        moving = moving.where(np.isfinite(moving))
        values = finite_numbers(moving.fillna(moving.mean(str(level.dims[0]))), "vertical", must)
    down = counts_down(level)
    if down and "positive" not in level.attrs and values.size > 1 and values.max() <= 0:
        remarks.append(f"{name} is negative and is taken as a height above the surface")
        down = False
    if origin is None:
        above = any(map(_FROM_SURFACE.fullmatch, (name, standard)))
        above = above or (sign > 0 and values.min(initial=0.0) < 0)
        origin = 0.0 if down or above else bed
        up = level.attrs.get("positive") or standard or sign < 0
        if not (down or above or up or _ABOVE_BED.search(name)):
            remarks.append(f"{name} is taken as a height above the bed: see origin and vertical")
    if origin is None:
        must = f"be the height z from which {name} counts (m)"
        raise refusal("origin", missing(must, "Or set water.depth to count from the bed."))
    factor = factor_to(level, length_factor, "vertical", "m", remarks)
    z = origin + (-1.0 if down else 1.0) * sign * factor * values
    if np.abs(z).max(initial=0.0) > _FARTHEST:
        text = f"{name} reaches {np.abs(z).max():.6g} m"
        raise refusal("vertical", text, f"reach at most {_FARTHEST:g} m")
    if np.diff(np.sort(z, axis=-1), axis=-1).min(initial=np.inf) < _THINNEST:
        text = f"{name} contains a level twice"
        raise refusal("vertical", text, f"have levels at least {_THINNEST:g} m apart")
    return z


def in_water(z: Float[np.ndarray, " level"], bed: float | None, remarks: list[str]) -> np.ndarray:
    """Return which levels are neither above the surface nor below the bed; the others are said."""
    places = {"above the surface": z > _THINNEST}
    if bed is not None:
        places["below the bed"] = z < bed - _THINNEST
    for where, out in places.items():
        if out.all():
            hint = "Set origin, or a minus sign in front of the name of the levels."
            text = f"all levels, z = {z.min():.4g} to {z.max():.4g} m, are {where}"
            raise refusal("vertical", text, "lie in the water", hint)
        if out.any():
            apart = ", ".join(f"{height:.6g}" for height in np.sort(z[out]))
            remarks.append(f"levels at z = {apart} m are {where} and left out")
    return ~np.any(list(places.values()), axis=0)


def sigma_levels(dataset: xr.Dataset, name: str) -> xr.DataArray:
    """Return the heights (m) of levels that follow surface and bed, by their formula terms (CF)."""
    dataset, formula = dataset.copy(), str(dataset[name].attrs["formula_terms"])
    terms = formula.replace(":", " ").split()
    for term, variable in zip(terms[::2], terms[1::2], strict=False):
        if term in _TERMS and variable in dataset.variables:
            dataset[variable].attrs.setdefault("standard_name", _TERMS[term])
    try:
        dataset.cf.decode_vertical_coords(outnames={name: _HEIGHT})
    except Exception as error:  # a term that is absent, or a formula that the library lacks
        text = f"{name} follows the bed by {formula!r} ({reason_of(error)})"
        raise refusal("vertical", text, "have all of these variables in the file") from error
    found = dataset[_HEIGHT].rename(name)
    found.attrs = {"units": "m", "positive": "up", "standard_name": "altitude"}
    return found


_ROW = "row of a profile"


def as_profile(dataset: xr.Dataset, time: str, level: str, file: str) -> xr.Dataset:
    """Return rows with a time and a level each as arrays over both."""
    row = dataset[time].dims
    if time == level or dataset[level].dims != row or len(row) != 1:
        return dataset
    for key, name in (("time", time), ("vertical", level)):
        finite_numbers(as_numbers(dataset[name], key), key, "a number in each row")
    flat = dataset.reset_index([name for name in dataset.indexes if name == row[0]])
    rows = flat.rename_dims({row[0]: _ROW}).set_index({_ROW: (time, level)})
    index = rows.indexes[_ROW]
    count = index.levshape[0] * index.levshape[1]
    check_count(count, file, f"{index.levshape[0]} times at {index.levshape[1]} levels")
    twice = np.flatnonzero(index.duplicated())
    if twice.size:
        text = f"row {twice[0] + 1} has the {time} and the {level} of an earlier one"
        raise refusal("time", text, "have one row for each time and level")
    profile = rows.unstack(_ROW)
    for name in (time, level):
        profile[name].attrs = dataset[name].attrs
    return profile
