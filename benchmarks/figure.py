"""Figures of benchmarks: work against precision, and bars of what was measured."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from crinoid.results.units import Unit, si_unit
from crinoid.view.figures import style

Row = dict[str, Any]

_WIDE = 30.0
"""Ratio of the largest to the smallest value from which on an axis is logarithmic."""
_BAR, _PANEL, _HEAD = 0.19, 0.62, 0.35
"""Heights of a bar, of the rest of its panel, and of the head (inches)."""


def draw_benchmark(title: str, rows: Sequence[Row]) -> Figure:
    """Draw the rows of a benchmark, as they are in its file.

    Rows with an error are curves of time over error, one panel for each name; other rows are bars
    from zero to the median, with a line from the least to the most, one panel for each quantity.
    """
    curves = [row for row in rows if "error" in row["at"]]
    if curves:
        figure = Figure(figsize=(style.width(), 3.2), layout="constrained")
        names = list(dict.fromkeys(row["name"] for row in curves))
        engines = dict.fromkeys(row["engine"] for row in curves)
        colours = dict(zip(engines, style.SERIES, strict=False))
        panels = figure.subplots(1, len(names), squeeze=False, sharey=True)[0]
        for axes, name in zip(panels, names, strict=True):
            _curves(axes, name, [row for row in curves if row["name"] == name], colours)
        panels[0].set_ylabel("time of a run (s)")
        style.key_of(figure, panels)
    else:
        quantities = list(dict.fromkeys(row["quantity"] for row in rows))
        groups = [[row for row in rows if row["quantity"] == name] for name in quantities]
        heights = [_BAR * len(group) + _PANEL for group in groups]
        size = (style.width(), sum(heights) + _HEAD)
        figure = Figure(figsize=size, layout="constrained")
        panels = figure.subplots(len(groups), 1, squeeze=False, height_ratios=heights)[:, 0]
        for axes, name, group in zip(panels, quantities, groups, strict=True):
            _bars(axes, name, group)
    style.head(figure, title, "ok")
    return figure


def _curves(axes: Axes, name: str, rows: Sequence[Row], colours: dict[str, str]) -> None:
    for engine in dict.fromkeys(row["engine"] for row in rows):
        own = [row for row in rows if row["engine"] == engine]
        own.sort(key=lambda row: float(row["at"]["error"]))
        error, time = [row["at"]["error"] for row in own], [row["median"] for row in own]
        axes.plot(error, time, "o-", markersize=3, color=colours[engine], label=engine)
    axes.set(xscale="log", yscale="log", xlabel="error of the tip")
    errors = [row["at"]["error"] for row in rows]
    # whole decades: within one alone the labels between would overlap
    axes.set_xlim(*(10.0**end for end in _decades(min(errors), max(errors))))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.set_title(name, loc="left")


def _decades(least: float, most: float) -> tuple[int, int]:
    return math.floor(math.log10(least)), math.ceil(math.log10(most))


def _bars(axes: Axes, quantity: str, rows: Sequence[Row]) -> None:
    median, least, most = (
        np.array([row[key] for row in rows]) for key in ("median", "least", "most")
    )
    unit = rows[0]["unit"]
    scale = Unit(1.0, unit) if unit == "1/s" else si_unit(float(median.max()), unit)
    places = np.arange(len(rows))
    axes.barh(places, median * scale.factor, height=0.65, color=style.BLUE, alpha=0.75)
    ends = np.stack([median - least, most - median]) * scale.factor
    look: Any = {"fmt": "none", "ecolor": style.INK, "elinewidth": 0.8}
    axes.errorbar(median * scale.factor, places, xerr=ends, **look)
    for place, row in zip(places, rows, strict=True):
        text = f" {scale.number(row['median'])}"
        axes.annotate(text, (row["most"] * scale.factor, place), va="center", fontsize=8.0)
    axes.set_yticks(places, [_label(row, rows) for row in rows], parse_math=False)
    axes.set_ylim(len(rows) - 0.5, -0.5)
    axes.tick_params(axis="y", length=0)
    axes.grid(visible=False, axis="y")
    if median.min() > 0 and median.max() > _WIDE * median.min():
        axes.set_xscale("log")
    else:
        axes.set_xlim(0.0, 1.12 * most.max() * scale.factor)
    axes.set_title(quantity if unit == "1" else f"{quantity} ({scale.name})", loc="left")


def _label(row: Row, rows: Sequence[Row]) -> str:
    """Return the name of a row, with the numbers in which it differs from others."""
    varied = [key for key in row["at"] if len({other["at"].get(key) for other in rows}) > 1]
    return ", ".join([row["name"], *(f"{row['at'][key]:g} {key}" for key in varied)])
