"""Opening of CSV and netCDF files, and their times, levels and numbers in SI units."""

from __future__ import annotations

import math
import os
import stat
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from difflib import get_close_matches
from pathlib import Path

import netCDF4
import numpy as np
import xarray as xr
from jaxtyping import Float

from crinoid.recording.table import (
    SUFFIXES,
    length_factor,
    listed,
    read_table,
    reason_of,
    time_factor,
)
from crinoid.scenario.errors import ScenarioError, counted, got, missing, refusal, shown
from crinoid.scenario.quantity import INTERVALS

MAX_VALUES = 20_000_000
"""Most values of a record; more, splines included, need gigabytes."""
_MAX_CHUNK = 2**30
"""Largest chunk of a variable that must be read as a whole (bytes)."""
_FARTHEST = 1e5
"""Greatest distance of a level from the surface (m)."""
_THINNEST = 1e-6
"""Least distance between two levels (m)."""


@contextmanager
def opened(file: str, time: str, vertical: str | None = None) -> Iterator[xr.Dataset]:
    """Open a netCDF file without reading its variables, or read a CSV file as if it were one.

    The variables of time and, in a profile, of the level (``vertical``) give the layout of a CSV
    file with a row for each time and level.
    """
    try:
        mode = os.stat(file).st_mode
        if stat.S_ISREG(mode):
            Path(file).open("rb").close()
    except FileNotFoundError:
        raise refusal("file", f"{file}: no such file") from None
    except PermissionError:
        raise refusal("file", f"{file}: may not be read") from None
    except (OSError, ValueError) as error:  # a name that no file can have
        raise refusal("file", f"{shown(file)} cannot be opened ({reason_of(error)})") from None
    if not stat.S_ISREG(mode):
        kind = "a folder" if stat.S_ISDIR(mode) else "no regular file"
        raise refusal("file", f"{short(file)} is {kind}", "be a CSV or netCDF file")
    if Path(file).suffix.lower() in SUFFIXES:
        yield read_table(file, time, vertical)
        return
    try:
        with netCDF4.Dataset(file) as stored:
            for name, variable in stored.variables.items():
                if variable.dimensions == (name,):  # which xarray reads when it opens a file
                    check_count(variable.size, file, name)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of attributes; those in use are checked here
            # times become seconds here: dates would only be in the way
            dataset = xr.open_dataset(file, engine="netcdf4", decode_times=False)
    except ScenarioError:
        raise
    except Exception as error:  # libraries raise anything on a damaged file
        text = f"{short(file)} is broken or no netCDF file ({reason_of(error)})"
        raise refusal("file", text) from error
    with dataset:
        yield dataset


def values_of(variable: xr.DataArray) -> np.ndarray:
    """Return the values of a variable; only this reads them from a netCDF file."""
    chunks = variable.encoding.get("chunksizes") or ()
    size = math.prod(chunks) * variable.dtype.itemsize
    if size > _MAX_CHUNK:
        text = f"{variable.name} is stored in chunks of {size / 2**30:.3g} GB"
        raise refusal("file", text, "be stored in chunks of at most 1 GB")
    try:
        return np.asarray(variable.values)
    except Exception as error:  # libraries raise anything on a damaged file
        text = f"{variable.name} cannot be read ({reason_of(error)})"
        raise refusal("file", text) from error


def numbers_of(variable: xr.DataArray, key: str, must: str) -> np.ndarray:
    """Return the values of a variable that must be numbers."""
    values = values_of(variable)
    if values.dtype.kind not in "iuf":
        odd = variable.attrs.get("odd", "no numbers")
        raise refusal(key, f"{variable.name} contains {odd}", f"contain {must}")
    return values


def labels_of(variable: xr.DataArray) -> list[str]:
    """Return the values of a variable as texts, whole numbers without a point."""
    values = values_of(variable).tolist()
    return [f"{each:g}" if isinstance(each, float) else str(each).strip() for each in values]


def _finite_numbers(variable: xr.DataArray, key: str, must: str) -> np.ndarray:
    values = numbers_of(variable, key, must)
    if not np.isfinite(values).all():
        raise refusal(key, f"{variable.name} has a missing or infinite entry", f"contain {must}")
    return values


def check_count(count: int, file: str, owner: str) -> None:
    """Refuse more values than a run can use, before any is read."""
    if count > MAX_VALUES:
        text = f"{short(file)} contains {count} values of {owner}"
        raise refusal("file", text, f"contain at most {MAX_VALUES}", "Cut out a shorter part.")


def find(dataset: xr.Dataset, name: str, key: str, file: str) -> str:
    """Return the variable with a name or a CF standard name."""
    if name in dataset.variables:
        return name
    standard = {
        str(variable): str(dataset[variable].attrs["standard_name"])
        for variable in dataset.variables
        if "standard_name" in dataset[variable].attrs
    }
    found = [variable for variable, text in standard.items() if text == name]
    if len(found) == 1:
        return found[0]
    if found:
        must = f"name one variable. Several have this standard name: {listed(found)}"
        raise refusal(key, got(name, must))
    names = [str(variable) for variable in dataset.variables]
    near = get_close_matches(name, [*names, *standard.values()], n=1)
    hint = f"did you mean {near[0]}?" if near else f"it contains {listed(names) or 'none'}"
    kind = "column" if Path(file).suffix.lower() in SUFFIXES else "variable"
    raise refusal(key, f"got {shown(name)}, no such {kind} in {short(file)}; {hint}")


def short(file: str) -> str:
    """Return the name of a file without its folder."""
    return Path(file).name


def only_dimension(variable: xr.DataArray, key: str) -> str:
    """Return the dimension of a variable that must have one."""
    if variable.ndim != 1:
        dims = ", ".join(map(str, variable.dims)) or "none"
        raise refusal(key, f"{variable.name} has dimensions {dims}", "have one dimension")
    return str(variable.dims[0])


def seconds(
    variable: xr.DataArray, remarks: list[str], *, key: str = "time"
) -> Float[np.ndarray, " time"]:
    """Return the times of a record (s) since its first sample."""
    name = variable.name
    if variable.size < 2:
        text = f"{name} contains {counted(variable.size, 'instant')}"
        raise refusal(key, text, "contain at least 2")
    values = _finite_numbers(variable, key, "increasing numbers or ISO dates")
    factor = factor_to(variable, time_factor, key, "seconds", remarks)
    # whole numbers stay whole up to here: nanoseconds since 1970 have more digits than floats
    with np.errstate(over="ignore"):
        time = (values - values[0]).astype(float) * factor
    # compared before the subtraction, in which unsigned ones would wrap round
    late = np.flatnonzero(~(values[1:] > values[:-1]))
    if late.size:
        after = int(late[0]) + 1
        word = "repeats" if values[after] == values[after - 1] else "goes back"
        raise refusal(key, f"{name} {word} at entry {after}", "increase")
    with np.errstate(invalid="ignore"):
        steps = np.diff(time)
    low, high = INTERVALS
    if not (steps.min() >= low and steps.max() <= high):
        text = f"{name} has steps of {steps.min():.3g} to {steps.max():.3g} s"
        raise refusal(key, text, f"have steps of {low:g} to {high:g} s")
    return time


def heights(
    variable: xr.DataArray, sign: float, origin: float | None, bed: float | None, remarks: list[str]
) -> Float[np.ndarray, " level"]:
    """Return the heights z of levels (m), which count upward from the bed or from ``origin``.

    A depth counts downward from the surface (CF: ``positive = "down"``), and so do levels whose
    name has a minus sign.
    """
    name = variable.name
    values = _finite_numbers(variable, "vertical", "heights or depths (m)")
    if np.unique(values).size < values.size:
        raise refusal("vertical", f"{name} contains a level twice", "have different levels")
    positive = str(variable.attrs.get("positive", ""))
    standard = str(variable.attrs.get("standard_name", ""))
    down = positive == "down" or (standard == "depth" and not positive)
    if origin is None:
        origin = 0.0 if down else bed
    if origin is None:
        must = f"be the height z from which {name} counts (m)"
        raise refusal("origin", missing(must, "Or set water.depth to count from the bed."))
    factor = factor_to(variable, length_factor, "vertical", "m", remarks)
    z = origin + (-1.0 if down else 1.0) * sign * factor * values.astype(float)
    if np.abs(z).max(initial=0.0) > _FARTHEST:
        text = f"{name} reaches {np.abs(z).max():.6g} m"
        raise refusal("vertical", text, f"reach at most {_FARTHEST:g} m")
    if np.diff(np.sort(z)).min(initial=np.inf) < _THINNEST:
        text = f"{name} has levels less than {_THINNEST:g} m apart"
        raise refusal("vertical", text, "have different levels")
    return z


def factor_to(
    variable: xr.DataArray,
    factor_of: Callable[[str], float | None],
    key: str,
    unit: str,
    remarks: list[str],
) -> float:
    """Return the factor from a variable to SI units; a missing unit becomes a remark."""
    units = variable.attrs.get("units")
    if units is None or not str(units).strip():
        remarks.append(f"{variable.name} names no unit and is assumed to be in {unit}")
        units = unit
    factor = factor_of(str(units).strip())
    if factor is None:
        text = f"{variable.name} is in {shown(str(units))}"
        raise refusal(key, text, f"be in a unit such as {unit}")
    return factor
