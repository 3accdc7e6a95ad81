"""Controllers side by side: the errors of every run, and what it took."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import xarray as xr
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter, ScalarFormatter

from crinoid.report.run import load_as
from crinoid.report.style import GREY, INK, SERIES, WIDTH, head
from crinoid.report.units import DEGREES, Unit, largest, length_unit, si_unit

COMPARISON = "compare.nc"

_REQUIRED = {
    "rms_error": ("controller", "seed"),
    "max_error": ("controller", "seed"),
    "effort": ("controller", "seed", "input"),
    "tick_time": ("controller",),
}
_COLUMNS = 3
_WIDE = (8.0, 1e4)
"""Ratios of the largest to the smallest value between which an axis is logarithmic."""
_SPREAD = 0.22
"""Half-width over which the runs of a controller are spread, of the distance between two."""


def open_comparison(path: Path) -> xr.Dataset:
    """Read a comparison into memory."""
    return load_as(path, "a comparison", _REQUIRED)


def draw_comparison(data: xr.Dataset) -> Figure:
    """Draw errors and efforts: each run a point, each controller's mean a line with its number."""
    panels = _panels(data)
    rows = math.ceil(len(panels) / _COLUMNS)
    figure = Figure(figsize=(WIDTH, 0.5 + 2.5 * rows), layout="constrained")
    head(figure, str(data.attrs.get("title", "")), str(data.attrs.get("status", "ok")))
    words = "a point: a run; a line and its number: the mean of a controller; speeds are RMS values"
    figure.supxlabel(words, fontsize=8.5, color=GREY)
    grid = list(figure.subplots(rows, _COLUMNS, squeeze=False).flat)
    for axes, (words, values, unit) in zip(grid, panels, strict=False):
        _points(axes, [str(kind) for kind in data["controller"].values], values * unit.factor)
        axes.set_title(f"{words} ({unit.name})", loc="left")
    for axes in grid[len(panels) :]:
        axes.set_axis_off()
    return figure


def _panels(data: xr.Dataset) -> list[tuple[str, Float[np.ndarray, "controller seed"], Unit]]:
    """Return title, values (SI) and unit of each panel."""
    rms, most = data["rms_error"].values, data["max_error"].values
    found = [
        ("tip error, RMS", rms, length_unit(largest(rms))),
        ("tip error, maximum", most, length_unit(largest(most))),
    ]
    if "rms_angle_error" in data:
        found.append(("angle error, RMS", data["rms_angle_error"].values, DEGREES))
    for index, name in enumerate(data["input"].values):
        speed = data["effort"].values[..., index]
        unit = speed_unit(str(data["input_unit"].values[index]), largest(speed))
        found.append((f"speed of {name}", speed, unit))
    if "work" in data:
        work = data["work"].values
        found.append(("work of base and actuators", work, si_unit(largest(work), "J")))
    return found


def speed_unit(unit: str, most: float) -> Unit:
    """Return a unit in which speeds of up to ``most`` read well, of one that CF writes."""
    if unit == "rad s-1":
        return Unit(DEGREES.factor, "deg/s")
    if unit == "s-1":
        return Unit(100.0, "%/s")
    return si_unit(most, unit.replace(" s-1", "/s"))


def _points(axes: Axes, kinds: list[str], values: Float[np.ndarray, "controller seed"]) -> None:
    count = values.shape[1]
    shift = np.linspace(-_SPREAD, _SPREAD, count) if count > 1 else np.zeros(1)
    found = values[np.isfinite(values)]
    logarithmic = bool(found.size and found.min() > 0)
    if logarithmic:
        logarithmic = bool(_WIDE[0] < found.max() / found.min() < _WIDE[1])
    for place, row in enumerate(values):
        there = np.isfinite(row)
        if not there.any():
            axes.annotate("no run", (place, 0.5), xycoords=("data", "axes fraction"), ha="center")
            continue
        colour, mean = SERIES[place % len(SERIES)], float(row[there].mean())
        axes.scatter(place + shift[there], row[there], s=14, color=colour, alpha=0.6, linewidth=0)
        axes.hlines(mean, place - 0.34, place + 0.34, color=INK, linewidth=1.2, zorder=3)
        axes.annotate(
            f"{mean:.3g}",
            (place, max(mean, float(row[there].max()))),
            xytext=(0, 4),
            textcoords="offset points",
            ha="center",
            fontsize=8.0,
        )
    axes.set_xticks(range(len(kinds)), kinds, parse_math=False)
    axes.set_xlim(-0.6, len(kinds) - 0.4)
    axes.grid(visible=False, axis="x")
    axes.tick_params(axis="x", length=0)
    if logarithmic:
        axes.set_yscale("log")
        axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.yaxis.set_major_formatter(ScalarFormatter())
        axes.yaxis.set_minor_formatter(NullFormatter())
        axes.set_ylim(0.8 * found.min(), 1.5 * found.max())
    elif found.size:
        axes.set_ylim(min(0.0, 1.1 * float(found.min())), 1.18 * float(found.max()) or 1.0)
