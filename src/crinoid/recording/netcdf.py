"""Reading of netCDF files."""

from __future__ import annotations

import warnings

import netCDF4
import xarray as xr

from crinoid.recording.numbers import check_count
from crinoid.recording.texts import listed, reason_of, short
from crinoid.scenario.errors import ScenarioError, refusal


def reads(file: str, head: bytes) -> bool:
    """Return whether this reader takes a file: any that no other one knows."""
    return True


def read(file: str) -> xr.Dataset:
    """Open a netCDF file; only its coordinates are read."""
    try:
        with netCDF4.Dataset(file) as stored:
            for name, variable in stored.variables.items():
                if variable.dimensions == (name,):  # which xarray reads when it opens a file
                    check_count(variable.size, file, name)
            if not stored.variables and stored.groups:
                text = f"{short(file)} has all variables in groups: {listed(list(stored.groups))}"
                hint = "Write one with xarray.open_dataset(file, group=...).to_netcdf(other)."
                raise refusal("file", text, "have its variables at the top", hint)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of attributes; those in use are checked later
            # times become seconds later: dates would only be in the way
            return xr.open_dataset(file, engine="netcdf4", decode_times=False)
    except ScenarioError:
        raise
    except Exception as error:  # libraries raise anything on a damaged file
        text = f"{short(file)} is broken or no netCDF file ({reason_of(error)})"
        raise refusal("file", text) from error
