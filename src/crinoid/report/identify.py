"""The search of `crinoid identify`: the record, the motion before and after, and what is left."""

from pathlib import Path

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from crinoid.identification import IDENTIFICATION as IDENTIFICATION
from crinoid.report.run import load_as
from crinoid.report.style import BLUE, GREY, INK, VERMILLION, WIDTH, head, key

_REQUIRED = {
    "given": ("parameter",),
    "found": ("parameter",),
    "standard_error": ("parameter",),
    "measured": ("time", "quantity"),
    "computed": ("time", "quantity"),
    "computed_before": ("time", "quantity"),
    "set_aside": ("time",),
}


def open_identification(path: Path) -> xr.Dataset:
    """Read what was found into memory."""
    return load_as(path, "an identification", _REQUIRED)


def draw_identification(data: xr.Dataset) -> Figure:
    """Draw each coordinate as it was measured and computed, and below it what is left."""
    names = [str(name) for name in data["quantity"].values]
    figure = Figure(figsize=(WIDTH, 0.9 + 2.7 * len(names)), layout="constrained")
    head(figure, str(data.attrs.get("title", "")), str(data.attrs.get("status", "ok")))
    panels = figure.subplots(2 * len(names), 1, sharex=True, height_ratios=[2.0, 1.0] * len(names))
    time, aside = data["time"].values, data["set_aside"].values.astype(bool)
    for index, name in enumerate(names):
        factor, unit = _UNITS.get(name, (1.0, ""))
        measured, after, before = (
            factor * data[which].values[:, index]
            for which in ("measured", "computed", "computed_before")
        )
        upper, lower = panels[2 * index], panels[2 * index + 1]
        good = np.where(aside, np.nan, measured)
        upper.plot(time, good, ".", color=GREY, markersize=2.0, label="measured")
        upper.plot(time, before, "--", color=VERMILLION, linewidth=1.0, label="as given")
        upper.plot(time, after, "-", color=BLUE, label="as found")
        low, high = np.nanmin(good), np.nanmax(good)
        room = 0.25 * max(high - low, 1e-12)
        upper.set_ylim(low - room, high + room)
        if aside.any():  # far ones at the edge, so that they hide nothing of the motion
            lost = np.clip(measured[aside], low - 0.8 * room, high + 0.8 * room)
            upper.plot(time[aside], lost, "x", color=INK, markersize=4.0, label="set aside")
        upper.set_ylabel(f"{name}{unit}")
        left = good - after
        if name == "angle":
            left = (left + 180.0) % 360.0 - 180.0
        lower.plot(time, left, ".", color=INK, markersize=1.5)
        lower.axhline(0.0, color=GREY, linewidth=0.8)
        lower.set_ylabel("left")
        if index == 0:
            key(upper, columns=4)
    panels[-1].set_xlabel("time (s)")
    return figure


_UNITS = {
    **dict.fromkeys(("x", "y", "z"), (1e3, " (mm)")),
    "angle": (180.0 / np.pi, " (deg)"),
}
