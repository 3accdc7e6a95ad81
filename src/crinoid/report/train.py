"""How the training of a policy went: cost and error in episodes that are held out."""

from pathlib import Path

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from crinoid.report.run import load_as
from crinoid.report.style import GREY, INK, SERIES, WIDTH, head

_REQUIRED = {"cost": ("look",), "error": ("look",)}


def open_training(path: Path) -> xr.Dataset:
    """Read how a training went into memory."""
    return load_as(path, "a training", _REQUIRED)


def draw_training(data: xr.Dataset) -> Figure:
    """Draw cost and error over the updates; the policy that was kept is marked."""
    figure = Figure(figsize=(WIDTH, 4.6), layout="constrained")
    head(figure, str(data.attrs.get("title", "")), str(data.attrs.get("status", "ok")))
    upper, lower = figure.subplots(2, 1, sharex=True)
    update, cost, error = data["update"].values, data["cost"].values, data["error"].values
    for axes, values, colour in ((upper, cost, SERIES[0]), (lower, 1e3 * error, SERIES[1])):
        axes.semilogy(update, values, "-", color=colour)
        if np.isfinite(cost).any():
            kept = int(np.nanargmin(cost))
            axes.plot(update[kept], values[kept], "o", color=INK, ms=5, label="kept")
        if np.isfinite(values).any():
            axes.axhline(values[0], color=GREY, linestyle=":", label="imitation")
        axes.grid(which="minor", axis="y")
        for ticks in (axes.yaxis.set_major_formatter, axes.yaxis.set_minor_formatter):
            ticks("{x:g}")
        axes.legend(loc="upper right")
    upper.set_ylabel("cost over that\nof the imitation")
    lower.set_ylabel("RMS error of\nthe tip (mm)")
    lower.set_xlabel("update")
    return figure
