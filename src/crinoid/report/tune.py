"""The search of `crinoid tune`: cost, margin and what is tuned over its iterations."""

import math
from pathlib import Path

import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter, ScalarFormatter

from crinoid.report.run import load_as
from crinoid.report.style import GREY, INK, SERIES, WIDTH, head
from crinoid.tuning import TUNING as TUNING

_REQUIRED = {
    "cost": ("start", "iteration"),
    "modulus": ("start", "iteration"),
    "tried": ("start", "iteration", "key"),
    "given": ("key",),
    "tuned": ("key",),
}
_COLUMNS = 3


def open_tuning(path: Path) -> xr.Dataset:
    """Read a search into memory."""
    return load_as(path, "a tuning", _REQUIRED)


def draw_tuning(data: xr.Dataset) -> Figure:
    """Draw cost and margin of each start over the iterations, and below them what was tuned."""
    names = [str(name) for name in data["key"].values]
    rows, asked = math.ceil(len(names) / _COLUMNS), float(data.attrs.get("margin", 0.0))
    tops = [2.7, 1.6] if asked else [2.7]
    figure = Figure(figsize=(WIDTH, 0.5 + sum(tops) + 1.7 * rows), layout="constrained")
    head(figure, str(data.attrs.get("title", "")), str(data.attrs.get("status", "ok")))
    upper, lower = figure.subfigures(2, 1, height_ratios=[sum(tops), 1.7 * rows])
    iteration, modulus = data["iteration"].values, data["modulus"].values
    costs, *margins = upper.subplots(len(tops), 1, squeeze=False, sharex=True, height_ratios=tops)
    root = 1e3 * np.sqrt(data["cost"].values)  # a distance
    kept = (modulus >= asked) | (asked == 0)
    for start, each in enumerate(root):
        colour = SERIES[start % len(SERIES)]
        costs[0].plot(iteration, each, "-", color=colour, alpha=0.3)
        costs[0].plot(iteration, each, "o", color=colour, mfc="none", ms=4)
        inside = np.where(kept[start], each, np.nan)
        costs[0].plot(iteration, inside, "o", color=colour, ms=4, label=f"start {start + 1}")
        for axes in margins:
            axes[0].plot(iteration, modulus[start], "o-", color=colour, ms=3, lw=0.7, alpha=0.7)
    words = "trial; filled: the margin is kept" if asked else "trial"
    axes = costs[0]
    axes.set_yscale("log")
    axes.set_ylabel("root of mean cost (mm)")
    (margins or [costs])[-1][0].set_xlabel(words)
    if np.isfinite(root).any():
        axes.set_ylim(top=3.0 * np.nanmax(root))
    axes.legend(ncols=4, loc="upper right")
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0), numticks=9))
    axes.yaxis.set_major_formatter(ScalarFormatter())
    axes.yaxis.set_minor_formatter(NullFormatter())
    for (axes,) in margins:
        axes.set_ylim(0.0, 1.0)
        axes.axhline(asked, color=INK, linestyle="--", linewidth=1.0)
        axes.set_ylabel("modulus margin")
    grid = list(lower.subplots(rows, _COLUMNS, squeeze=False, sharex=True).flat)
    for index, (axes, name) in enumerate(zip(grid, names, strict=False)):
        for start, tried in enumerate(np.abs(data["tried"].values[..., index])):
            axes.plot(iteration, tried, ".", color=SERIES[start % len(SERIES)], alpha=0.5)
        axes.axhline(abs(float(data["given"][index])), color=GREY, linestyle=":")
        axes.axhline(abs(float(data["tuned"][index])), color=INK, linestyle="--", linewidth=1.0)
        axes.set_yscale("log")
        axes.set_title(name, loc="left")
    for axes in grid[len(names) :]:
        axes.set_axis_off()
    lower.supxlabel("dotted: as given; dashed: as tuned", fontsize=8.5, color=GREY)
    return figure
