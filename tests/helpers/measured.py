"""Scenarios in a measured current, and records of known functions to play."""

import numpy as np
import xarray as xr

from crinoid.assembly.prepared import Prepared
from crinoid.scenario import Scenario

M_PER_S = {"units": "m s-1"}
BASES = {2: (0.0, -10.0), 3: (0.0, 0.4, -10.0)}
"""Where the arm is mounted, by its axes: in space 0.4 m to port."""


def measured(file, axes=2, *, duration=10.0, base=None, depth=20.0, **keys):
    """Return the scenario of an arm of 0.5 m in the current of a file."""
    return Scenario(
        arm={"length": 0.5, "dimension": axes},
        base={"position": BASES[axes] if base is None else base},
        water={"depth": depth},
        flow=[{"kind": "measured", "file": str(file), **keys}],
        simulation={"duration": duration},
    )


def recorded(case):
    (recording,) = Prepared(case).recordings.values()
    return recording


def write(path, time, *, time_units="s", units="m s-1", attributes=None, **series):
    """Write series over time to a netCDF file."""
    attributes = {"units": units} | (attributes or {})
    xr.Dataset(
        {name: ("time", values, attributes) for name, values in series.items()},
        {"time": ("time", time, {"units": time_units})},
    ).to_netcdf(path)


def wave(time, level=0.0):
    """A current (m/s) that is smooth in time and height; east or x."""
    return 0.4 + 0.1 * np.sin(2 * np.pi * time / 7.0 + 0.3 * level)


def swell(time, level=0.0):
    """Another one; up."""
    return 0.05 * np.cos(2 * np.pi * time / 5.0) + 0.02 * level


def enu(time, level=0.0):
    """East, north and up (m/s)."""
    return wave(time, level), 0.5 * wave(time + 1.7, level), swell(time, level)


def point(path, *, interval=0.1, length=40.0):
    """Write a record at one point, as of a velocimeter."""
    time = np.arange(round(length / interval) + 1) * interval
    named = {"standard_name": "sea_water_x"}
    values = dict(zip("uvw", enu(time), strict=True))
    xr.Dataset(
        {n: ("time", v, M_PER_S | (named if n == "u" else {})) for n, v in values.items()},
        {"time": ("time", time, {"units": "s"})},
    ).to_netcdf(path)
    return time


def profile(path, *, thickness=0.5, levels=20, interval=0.5, change=None):
    """Write a profile with a labelled dimension, upward from an instrument, as DOLfYN does."""
    time = np.arange(round(40.0 / interval) + 1) * interval
    height = 0.5 + thickness * np.arange(levels)
    east, north, up = enu(time, height[:, None])
    velocity = np.stack([east, north, up, 1.01 * up])
    if change is not None:
        change(velocity)
    xr.Dataset(
        {"vel": (("dir", "range", "time"), velocity, M_PER_S)},
        {
            "dir": ["E", "N", "U1", "U2"],
            "range": ("range", height, {"units": "m"}),
            "time": ("time", 1.6e9 + time, {"units": "seconds since 1970-01-01"}),
        },
    ).to_netcdf(path)
    return height
