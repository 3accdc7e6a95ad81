"""The file of a result: its attributes, its data in pieces, and the arrays of its last state."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import xarray as xr

from crinoid.foundation.text_variables import text_encoding
from crinoid.foundation.version import __version__
from crinoid.results.chunks import piece_length, pieces

CHECKPOINT = "checkpoint"
"""Group of the file with the last state."""


def named_leaves(tree: Any) -> dict[str, np.ndarray]:
    """Return the arrays of a tree by their path in it, such as ``state.motion.position``."""
    from jax.tree_util import keystr, tree_leaves_with_path

    return {
        keystr(path, simple=True, separator="."): np.asarray(leaf)
        for path, leaf in tree_leaves_with_path(tree)
    }


def attributes(path: Path) -> dict[str, Any]:
    """Return the attributes of a file that crinoid wrote; none of any other, or of no file."""
    try:
        with netCDF4.Dataset(path) as file:
            found = {name: file.getncattr(name) for name in file.ncattrs()}
    except (OSError, RuntimeError, ValueError):
        return {}
    return found if "crinoid_version" in found else {}


def write_result(whole: xr.Dataset, checkpoint: Mapping[str, np.ndarray], path: Path) -> None:
    """Write a file in pieces: a run that lies in a file may be larger than the memory."""
    over_time = [str(name) for name, data in whole.variables.items() if "time" in data.dims]
    length = min(piece_length(whole), whole.sizes["time"])
    encoding = {
        name: {
            "chunksizes": (length, *whole[name].shape[1:]),
            "zlib": whole[name].ndim > 1,
            "complevel": 1,
        }
        for name in over_time
    }
    first = whole.isel(time=slice(0, length)).load()
    encoding |= text_encoding(first)
    first.to_netcdf(path, engine="netcdf4", encoding=encoding, unlimited_dims=["time"])
    if whole.sizes["time"] > length:
        with netCDF4.Dataset(path, "a") as file:
            for name in over_time:  # else it keeps most of the written data in memory
                file[name].set_var_chunk_cache(0, 1, 0.0)
            for start, piece in enumerate(pieces(whole, over_time)):
                for name in over_time if start else ():
                    at = start * length
                    file[name][at : at + piece.sizes["time"]] = piece[name].values
    leaves = xr.Dataset(
        {
            name: ([f"d{number:03d}_{axis}" for axis in range(leaf.ndim)], leaf)
            for number, (name, leaf) in enumerate(checkpoint.items())
        },
        attrs={"crinoid_version": __version__},
    )
    leaves.to_netcdf(path, engine="netcdf4", mode="a", group=CHECKPOINT)
