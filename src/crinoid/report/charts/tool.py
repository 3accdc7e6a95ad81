"""The tool at the tip: a ball of its volume about its centre of mass."""

from __future__ import annotations

import math

import numpy as np
import xarray as xr
from jaxtyping import Bool

from crinoid.report.charts.pose import read_scenario

_DENSE = 7850.0  # kg/m3, steel: what a tool is drawn of that displaces no water


def held(data: xr.Dataset) -> Bool[np.ndarray, " time"]:
    """Whether the tip carries a tool, at each record."""
    if "tool_held" not in data:
        return np.zeros(data.sizes["time"], bool)
    return np.asarray(data["tool_held"].values > 0)


def ball(data: xr.Dataset) -> tuple[float, float]:
    """Return the radius of the ball, and how far its centre is beyond the tip (m)."""
    tool = read_scenario(data)["tool"]
    volume = tool.get("volume") or tool["mass"] / _DENSE
    return (3.0 * volume / (4.0 * math.pi)) ** (1 / 3), float(tool.get("offset", 0.0))
