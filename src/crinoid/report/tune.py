"""The search of `crinoid tune`: cost and gains over its iterations."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter, ScalarFormatter

from crinoid.report.run import ReportError, load
from crinoid.report.style import GREY, INK, SERIES, WIDTH, head
from crinoid.tuning import TUNING as TUNING

_REQUIRED = {
    "cost": ("start", "iteration"),
    "gains": ("start", "iteration", "gain"),
    "given": ("gain",),
    "tuned": ("gain",),
}
_COLUMNS = 3


def open_tuning(path: Path) -> xr.Dataset:
    """Read a search for gains into memory.

    Raises
    ------
    ReportError
        If the file is broken, or not one that crinoid wrote.
    """
    dataset = load(path)
    for name, dims in _REQUIRED.items():
        if name not in dataset or dataset[name].dims != dims:
            text = f"not a tuning of crinoid, it has no {name} over {', '.join(dims)}"
            raise ReportError(f"{path}: {text}")
    return dataset


def draw_tuning(data: xr.Dataset) -> Figure:
    """Draw the cost of each start over the iterations, and below it each gain."""
    names = [str(name) for name in data["gain"].values]
    rows = math.ceil(len(names) / _COLUMNS)
    figure = Figure(figsize=(WIDTH, 3.2 + 1.7 * rows), layout="constrained")
    head(figure, str(data.attrs.get("title", "")), str(data.attrs.get("status", "ok")))
    upper, lower = figure.subfigures(2, 1, height_ratios=[2.7, 1.7 * rows])
    iteration = data["iteration"].values
    axes = upper.subplots()
    # the square root of a cost is a distance
    for start, cost in enumerate(data["cost"].values):
        colour, root = SERIES[start % len(SERIES)], 1e3 * np.sqrt(cost)
        tried = np.flatnonzero(np.isfinite(root))
        axes.plot(iteration, root, ".", color=colour, alpha=0.35)
        least = np.minimum.accumulate(root[tried])
        axes.plot(iteration[tried], least, "-", color=colour, label=f"start {start + 1}")
    axes.set_yscale("log")
    axes.set_ylabel("root of mean cost (mm)")
    axes.set_xlabel("trial; points: each, lines: the least so far")
    if np.isfinite(data["cost"].values).any():
        axes.set_ylim(top=3.0 * 1e3 * np.sqrt(np.nanmax(data["cost"].values)))
    axes.legend(ncols=4, loc="upper right")
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0), numticks=9))
    axes.yaxis.set_major_formatter(ScalarFormatter())
    axes.yaxis.set_minor_formatter(NullFormatter())
    grid = list(lower.subplots(rows, _COLUMNS, squeeze=False, sharex=True).flat)
    for index, (axes, name) in enumerate(zip(grid, names, strict=False)):
        for start, gains in enumerate(np.abs(data["gains"].values[..., index])):
            axes.plot(iteration, gains, ".", color=SERIES[start % len(SERIES)], alpha=0.5)
        axes.axhline(abs(float(data["given"][index])), color=GREY, linestyle=":")
        axes.axhline(abs(float(data["tuned"][index])), color=INK, linestyle="--", linewidth=1.0)
        axes.set_yscale("log")
        axes.set_title(name, loc="left")
    for axes in grid[len(names) :]:
        axes.set_axis_off()
    lower.supxlabel("dotted: as given; dashed: as tuned", fontsize=8.5, color=GREY)
    return figure
