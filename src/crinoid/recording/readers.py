"""The door of all files: each becomes a dataset with the names, units and attributes of the file.

A reader has ``reads(file, head)``, whether a file is of its format by its name and first bytes,
and ``read(file)``, which returns the dataset. Other packages name theirs under the entry points
``crinoid.readers``; they come first.
"""

from __future__ import annotations

import os
import stat
from pathlib import Path
from typing import Protocol, runtime_checkable

import xarray as xr

from crinoid.recording import binaries, instruments, netcdf, table
from crinoid.recording.texts import reason_of, short
from crinoid.scenario.errors import ScenarioError, refusal, shown
from crinoid.scenario.kinds import installed, package_of

_HEAD = 1 << 16


@runtime_checkable
class Reader(Protocol):
    """Reader of one format."""

    def reads(self, file: str, head: bytes) -> bool:
        """Return whether a file is of this format."""
        ...

    def read(self, file: str) -> xr.Dataset:
        """Return the variables of a file, not yet in SI units."""
        ...


def _chosen(file: str, head: bytes) -> tuple[Reader, str]:
    """Return the first reader of a file, and its name if it comes from another package."""
    for name, entry in installed("readers").items():
        owner = f"the reader {name} of the installed package {package_of(entry)}"
        try:
            reader: Reader = entry.load()
            if reader.reads(file, head):
                return reader, owner
        except Exception as error:  # any fault of the package
            raise refusal("file", f"{owner} fails: {reason_of(error)}") from error
    own = (instruments, binaries, table, netcdf)
    return next(each for each in own if each.reads(file, head)), ""


def read_dataset(file: str) -> xr.Dataset:
    """Return the variables of a file, by the first reader of its format.

    Variables of a netCDF file are read where they are used: use the dataset in a ``with`` block.

    Raises
    ------
    ScenarioError
        If the file cannot be opened or read, in one line.
    """
    try:
        mode = os.stat(file).st_mode
        head = b""
        if stat.S_ISREG(mode):
            with Path(file).open("rb") as stream:
                head = stream.read(_HEAD)
    except FileNotFoundError:
        raise refusal("file", f"{file}: no such file") from None
    except PermissionError:
        raise refusal("file", f"{file}: may not be read") from None
    except (OSError, ValueError) as error:  # a name that no file can have
        raise refusal("file", f"{shown(file)} cannot be opened ({reason_of(error)})") from None
    if not stat.S_ISREG(mode):
        kind = "a folder" if stat.S_ISDIR(mode) else "no regular file"
        raise refusal("file", f"{short(file)} is {kind}", "be a CSV or netCDF file")
    reader, owner = _chosen(file, head)
    try:
        dataset = reader.read(file)
    except ScenarioError:
        raise
    except Exception as error:  # libraries raise anything on a damaged file
        damaged = f"{short(file)} is broken or of an unknown format"
        text = f"{owner} cannot read {short(file)}" if owner else damaged
        raise refusal("file", f"{text} ({reason_of(error)})") from error
    if not isinstance(dataset, xr.Dataset):
        text = f"{owner} returns {type(dataset).__name__}"
        raise refusal("file", text, "return an xarray.Dataset")
    return dataset
