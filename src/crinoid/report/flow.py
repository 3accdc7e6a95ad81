"""A sampled current as the figures see it: the file that `crinoid flow` wrote, checked."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import xarray as xr
from jaxtyping import Float

from crinoid.report.run import load_as

FLOW = "flow.nc"

_REQUIRED = {
    "flow_velocity": ("time", "place", "axis"),
    "flow_spectrum": ("frequency", "place", "axis"),
    "profile_mean": ("height", "axis"),
    "profile_standard_deviation": ("height", "axis"),
}


def open_flow(path: Path) -> xr.Dataset:
    """Read a sampled current into memory."""
    return load_as(path, "a current", _REQUIRED)


def title(flow: xr.Dataset) -> str:
    """Return what stands above a figure."""
    return str(flow.attrs.get("title", "")).strip() or "current"


def axes_of(flow: xr.Dataset) -> list[str]:
    """Return the axes that the current has a component along."""
    return [str(axis) for axis in flow["axis"].values]


def late(flow: xr.Dataset) -> Float[np.ndarray, "time place axis"]:
    """Return the velocity (m/s) from when the last ramp is over."""
    after = flow["time"].values >= float(flow.attrs.get("settled", 0.0)) - 1e-9
    return np.asarray(flow["flow_velocity"].values[after], float)


def differ(flow: xr.Dataset) -> bool:
    """Whether the current at the tip is another than that at the root."""
    velocity = flow["flow_velocity"].values
    return not np.allclose(velocity[:, 0], velocity[:, 1], atol=1e-6 * np.abs(velocity).max())
