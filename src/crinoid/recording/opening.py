"""Opening a file of columns or variables, so that a bad one is refused before it costs anything."""

import math
import os
import stat
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from difflib import get_close_matches
from pathlib import Path

import netCDF4
import numpy as np
import xarray as xr

from crinoid.recording.refusal import listed, refusal
from crinoid.recording.table import SUFFIXES, read_table
from crinoid.scenario.errors import ScenarioError, shown

MAX_VALUES = 20_000_000
"""More than that, splines included, takes gigabytes."""
_MAX_CHUNK = 2**30
"""Size of a piece of a variable that has to be read as a whole (bytes)."""


@contextmanager
def opened(file: str, time: str, vertical: str | None = None) -> Iterator[xr.Dataset]:
    """Open a netCDF file, of which nothing is read yet, or read a CSV file into the same.

    Parameters
    ----------
    file
        Its path.
    time, vertical
        Variables that hold the time and, of a profile, the level: a CSV file with a row for each
        time and level is laid out by them.
    """
    try:
        mode = os.stat(file).st_mode
        if not stat.S_ISDIR(mode) and stat.S_ISREG(mode):
            Path(file).open("rb").close()
    except FileNotFoundError:
        raise refusal("file", f"{file}: no such file") from None
    except PermissionError:
        raise refusal("file", f"{file}: may not be read") from None
    except (OSError, ValueError) as error:  # a name that no file can have
        raise refusal("file", f"{shown(file)} cannot be opened ({_reason(error)})") from None
    if not stat.S_ISREG(mode):
        what = "a folder" if stat.S_ISDIR(mode) else "no regular file"
        raise refusal("file", f"{short(file)} is {what}, takes a CSV or netCDF file")
    if Path(file).suffix.lower() in SUFFIXES:
        yield read_table(file, time, vertical)
        return
    _check_declared(file)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of attributes; what matters is looked at here
            # times are turned into seconds here: dates would only be in the way
            dataset = xr.open_dataset(file, engine="netcdf4", decode_times=False)
    except Exception as error:  # whatever a library makes of a damaged file
        raise _broken(file, error) from error
    with dataset:
        yield dataset


def values_of(variable: xr.DataArray) -> np.ndarray:
    """Read the values of a variable; only now a netCDF file does."""
    chunks = variable.encoding.get("chunksizes") or ()
    size = math.prod(chunks) * variable.dtype.itemsize
    if size > _MAX_CHUNK:
        text = f"{variable.name} is stored in pieces of {size / 2**30:.3g} GB, takes up to 1 GB"
        raise refusal("file", text)
    try:
        return np.asarray(variable.values)
    except Exception as error:  # whatever a library makes of a damaged file
        raise refusal("file", f"{variable.name} cannot be read ({_reason(error)})") from error


def numbers_of(variable: xr.DataArray, key: str, takes: str) -> np.ndarray:
    """Read a variable that is to hold numbers."""
    values = values_of(variable)
    if values.dtype.kind not in "iuf":
        odd = variable.attrs.get("odd")
        what = f"what is no number ({odd})" if odd else "what is no number"
        raise refusal(key, f"{variable.name} holds {what}, takes {takes}")
    return values


def check_count(count: int, file: str, what: str) -> None:
    """Refuse more values than a run can hold, before any is read."""
    if count > MAX_VALUES:
        raise refusal(
            "file",
            f"{short(file)} holds {count} values of {what}, takes up to {MAX_VALUES}; cut out the "
            "part that is needed",
        )


def find(dataset: xr.Dataset, name: str, key: str, file: str) -> str:
    """Return the variable of a name or a CF standard name."""
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
        raise refusal(key, f"got {shown(name)}, which several variables are; takes {listed(found)}")
    names = [str(variable) for variable in dataset.variables]
    near = get_close_matches(name, [*names, *standard.values()], n=1)
    hint = f"did you mean {near[0]}?" if near else f"it holds {listed(names) or 'none'}"
    kind = "column" if Path(file).suffix.lower() in SUFFIXES else "variable"
    raise refusal(key, f"got {shown(name)}, no such {kind} in {short(file)}; {hint}")


def short(file: str) -> str:
    """Return the name of a file without its folder."""
    return Path(file).name


def _check_declared(file: str) -> None:
    """Refuse coordinates that are too long: they are read as soon as a file is opened."""
    try:
        with netCDF4.Dataset(file) as stored:
            sizes = {
                name: variable.size
                for name, variable in stored.variables.items()
                if variable.dimensions == (name,)
            }
    except Exception as error:  # whatever a library makes of a damaged file
        raise _broken(file, error) from error
    for name, size in sizes.items():
        check_count(size, file, name)


def _broken(file: str, error: Exception) -> ScenarioError:
    return refusal("file", f"{short(file)} is broken or no netCDF file ({_reason(error)})")


def _reason(error: Exception) -> str:
    return " ".join(str(getattr(error, "strerror", None) or error).split())[:200]
