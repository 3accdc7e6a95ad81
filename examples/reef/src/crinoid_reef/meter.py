"""A reader: the log of a current meter, with a time and a velocity in each line."""

import numpy as np
import xarray as xr

_FIRST = b"REEF METER"


def reads(file: str, head: bytes) -> bool:
    """Return whether a file is such a log, by its first bytes."""
    return head.startswith(_FIRST)


def read(file: str) -> xr.Dataset:
    """Read the time (s), and the velocity toward east, north and up (cm/s)."""
    time, *velocity = np.loadtxt(file, skiprows=1, unpack=True)
    series = {
        name: ("time", values, {"units": "cm/s"})
        for name, values in zip("uvw", velocity, strict=True)
    }
    return xr.Dataset(series, {"time": ("time", time, {"units": "s"})})
