"""Texts of a netCDF file as characters.

netCDF4 crashes where a file with variables of strings is open more than once in a process
(Unidata/netcdf4-python, report 1444). Files with characters in their place are safe to open again.
"""

from typing import Any

import xarray as xr


def text_encoding(data: xr.Dataset) -> dict[str, dict[str, Any]]:
    """Return the encoding with which ``to_netcdf`` writes texts as UTF-8 characters."""
    texts = (name for name, each in data.variables.items() if each.dtype.kind in "OUT")
    return {str(name): {"dtype": "S1"} for name in texts}
