"""The door of all files: each becomes a dataset with the names, units and attributes of the file.

A reader has ``reads(file, head)``, whether a file is of its format by its name and first bytes,
and ``read(file)``, which returns the dataset. Other packages name theirs under the entry points
``crinoid.readers``; they come first.
"""

import re
import warnings
from pathlib import Path
from typing import Any

import netCDF4
import xarray as xr

from crinoid.recording import binaries, logs, table
from crinoid.recording.numbers import check_count
from crinoid.recording.texts import listed, reason_of
from crinoid.scenario.errors import ScenarioError, refusal, shown
from crinoid.scenario.kinds import installed, package_of

_HEAD = 1 << 16
_NETCDF, _MAGIC = (".nc", ".nc4", ".cdf"), re.compile(rb"CDF|\x89HDF")
_KNOWN = f"be a CSV or netCDF file ({', '.join((*table.SUFFIXES[:5], '.nc'))}), or a log of ROS"


def read_dataset(file: str) -> xr.Dataset:
    """Return the variables of a file, by the first reader of its format.

    Variables of a netCDF file are read where they are used: use the dataset in a ``with`` block.

    Raises
    ------
    ScenarioError
        If the file cannot be opened or read, in one line.
    """
    path = Path(file)
    try:
        head, bag = b"", logs.is_bag(path)
        readable = bag or path.is_file() or not path.exists()  # a pipe would never end
        if readable and not bag:
            with path.open("rb") as stream:
                head = stream.read(_HEAD)
    except FileNotFoundError:
        raise refusal("file", f"{file}: no such file") from None
    except (OSError, ValueError) as error:  # may not be read, or a name that no file can have
        raise refusal("file", f"{shown(file)} cannot be opened ({reason_of(error)})") from None
    if not readable:
        kind = "a folder" if path.is_dir() else "no regular file"
        raise refusal("file", f"{path.name} is {kind}", _KNOWN)
    read, owner = _chosen(file, head)
    if read is _read_netcdf and path.suffix.lower() not in _NETCDF and not _MAGIC.match(head):
        raise refusal("file", f"{path.name} is of no format that is read", _KNOWN)
    try:
        dataset = read(file)
    except ScenarioError:
        raise
    except Exception as error:  # libraries raise anything on a damaged file
        text = f"{owner} cannot read {path.name}" if owner else f"{path.name} is broken"
        raise refusal("file", f"{text} ({reason_of(error)})") from error
    if not isinstance(dataset, xr.Dataset):
        text = f"{owner} returns {type(dataset).__name__}"
        raise refusal("file", text, "return an xarray.Dataset")
    return dataset


def _chosen(file: str, head: bytes) -> tuple[Any, str]:
    """Return the function that reads a file, and its name if another package has it."""
    for name, entry in installed("readers").items():
        owner = f"the reader {name} of the installed package {package_of(entry)}"
        try:
            reader = entry.load()
            if reader.reads(file, head):
                return reader.read, owner
        except Exception as error:  # any fault of the package
            raise refusal("file", f"{owner} fails: {reason_of(error)}") from error
    own = (each.read for each in (binaries, logs, table) if each.reads(file, head))
    return next(own, _read_netcdf), ""


def _read_netcdf(file: str) -> xr.Dataset:
    """Open a netCDF file; only its coordinates are read."""
    with netCDF4.Dataset(file) as stored:
        for name, variable in stored.variables.items():
            if variable.dimensions == (name,):  # which xarray reads when it opens a file
                check_count(variable.size, file, name)
        if not stored.variables and stored.groups:
            text = f"{Path(file).name} has all variables in groups: {listed(list(stored.groups))}"
            hint = "Write one with xarray.open_dataset(file, group=...).to_netcdf(other)."
            raise refusal("file", text, "have its variables at the top", hint)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of attributes; those in use are checked later
        # times become seconds later: dates would only be in the way
        return xr.open_dataset(file, engine="netcdf4", decode_times=False)
