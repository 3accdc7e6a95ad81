"""Figures of optimisation, training and identification."""

import textwrap
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from crinoid.results.measure_labels import key_label, label_of, plain_number, plain_unit
from crinoid.view.figures import style
from crinoid.view.figures.style import BLUE, GREY, INK, SERIES, VERMILLION, head_of, key


def draw_optimisation(data: xr.Dataset) -> Figure:
    """Draw the measures of each trial, filled where it keeps the limits, over each number."""
    names, keys = [str(name) for name in data["measure"].values], data["key"].values
    across = style.columns(1.0, len(keys))
    down = -(-len(keys) // across)
    figure = style.new_figure(0.7 + 2.0 * len(names) * down)
    head_of(figure, data)
    grid = figure.subplots(down * len(names), across, squeeze=False)
    # the panels of a key are one below the other
    grid = grid.reshape(down, len(names), across).swapaxes(1, 2).reshape(-1, len(names))
    for axes in grid[len(keys) :].flat:
        axes.set_axis_off()
    sign, limit = data["sign"].values[:, None], data["limit"].values[:, None]
    found = data["found"].values
    # the mean of the measure, the worst draw of each limit
    shown = np.where(sign > 0, found.max(axis=2).T, found.min(axis=2).T)
    shown[0] = found[:, 0].mean(axis=1)
    kept = (sign * (shown - limit) <= 0)[1:].all(axis=0) & np.isfinite(shown).all(axis=0)
    start = data["start"].values
    for row, key_of in enumerate(map(str, keys)):
        tried = data["tried"].values[:, row]
        for column, axes in enumerate(grid[row]):
            if column:
                axes.sharex(grid[row, 0])
            axes.tick_params(labelbottom=column == len(names) - 1, labelleft=row % across == 0)
            some = shown[column][np.isfinite(shown[column]) & (shown[column] > 0)]
            if some.size and some.max() > 10 * some.min():
                axes.set_yscale("log")
            if row % across == 0:
                unit = plain_unit(str(data["unit"].values[column]))
                label = label_of(names[column]) + (f" ({unit})" if unit else "")
                axes.set_ylabel(textwrap.fill(label, 22))
            for number in np.unique(start):
                colour = SERIES[int(number) % len(SERIES)] if len(np.unique(start)) < 8 else BLUE
                for some, face in ((start == number, "none"), ((start == number) & kept, colour)):
                    look = {"color": colour, "mfc": face, "ms": 3, "alpha": 0.7}
                    axes.plot(tried[some], shown[column, some], "o", **look)
            axes.axvline(float(data["given"][row]), color=GREY, linestyle=":")
            axes.axvline(float(data["best"][row]), color=INK, linestyle="--", linewidth=1.0)
            if column:
                axes.axhline(float(limit[column, 0]), color=VERMILLION, linewidth=1.0)
        axes.set_xlabel(style.wrap(key_label(key_of), 1 + across))
        axes.xaxis.set_major_formatter("{x:.3g}")
        near, far = np.sort(np.abs(data["range"].values[row]))
        if near > 0 and far > 10 * near:  # of one sign
            negative = data["best"].values[row] < 0
            below: dict[str, Any] = {"linthresh": near} if negative else {}
            axes.set_xscale("symlog" if negative else "log", **below)
            axes.xaxis.set_minor_formatter(NullFormatter())
    words = "colours: starts; filled: limits are kept; dotted: initial; dashed: best; red: limit"
    figure.supxlabel(style.wrap(words), fontsize=style.small(), color=GREY)
    return figure


def draw_training(data: xr.Dataset) -> Figure:
    """Draw cost and error over the updates; the selected policy is marked."""
    figure = style.new_figure(4.6)
    head_of(figure, data)
    upper, lower = figure.subplots(2, 1, sharex=True)
    update, cost, error = data["update"].values, data["cost"].values, data["error"].values
    for axes, values, colour in ((upper, cost, SERIES[0]), (lower, 1e3 * error, SERIES[1])):
        axes.semilogy(update, values, "-", color=colour)
        if np.isfinite(cost).any():
            best = int(np.nanargmin(cost))
            axes.plot(update[best], values[best], "o", color=INK, ms=5, label="kept")
        if np.isfinite(values).any():
            axes.axhline(values[0], color=GREY, linestyle=":", label="imitation")
        axes.grid(which="minor", axis="y")
        for ticks in (axes.yaxis.set_major_formatter, axes.yaxis.set_minor_formatter):
            ticks("{x:g}")
        key(axes)
    upper.set_ylabel("cost over that\nof the imitation")
    lower.set(xlabel="update", ylabel="RMS error of\nthe tip (mm)")
    return figure


def draw_identification(data: xr.Dataset) -> Figure:
    """Draw each coordinate as measured and as computed over time or holds, and its residual."""
    names = [str(name) for name in data["quantity"].values]
    found = [_found(data.sel(parameter=each)) for each in data["parameter"].values]
    figure = style.new_figure(0.9 + 2.7 * len(names) + 0.17 * len(found))
    head_of(figure, data)
    figure.supxlabel("\n".join(found), x=0.02, ha="left", fontsize=style.small())
    one = len({name.rpartition(".")[0] for name in names}) == 1
    heights = [2.0, 1.0] * len(names)
    panels = figure.subplots(2 * len(names), 1, sharex=one, height_ratios=heights)
    for index, name in enumerate(names):
        pair = panels[2 * index], panels[2 * index + 1]
        # the rows of other experiments are empty
        rows = data.isel(time=np.isfinite(data["measured"].values[:, index]), quantity=index)
        words = _draw_coordinate(*pair, rows, name)
        if index == 0:
            key(pair[0], columns=4)
        if not one or index == len(names) - 1:
            pair[1].set_xlabel(words)
    return figure


def _found(row: xr.Dataset) -> str:
    """Return a parameter in words: its value with its standard error and its unit."""
    label, _, unit = key_label(str(row["parameter"].item())).partition(" (")
    value, error, given = (float(row[each]) for each in ("found", "standard_error", "given"))
    determined = bool(row.get("determined", True))
    words = [label, plain_number(value)]
    words += ["±", plain_number(float(f"{error:.2g}"))] if determined else []
    words += [unit.removesuffix(")")] if unit else []
    words += [] if determined else ["not determined"]
    return f"{' '.join(words)} (initially {plain_number(given)})"


def _draw_coordinate(upper: Axes, lower: Axes, rows: xr.Dataset, name: str) -> str:
    """Draw the rows of a coordinate, and return the words for the horizontal axis."""
    coordinate = name.rpartition(".")[2]
    factor, unit = _UNITS.get(coordinate, (1.0, ""))
    names_of = ("measured", "computed", "computed_before")
    measured, after, before = (factor * rows[each].values for each in names_of)
    time, aside = rows["time"].values, rows["set_aside"].values.astype(bool)
    marker, hold = (rows[each].values for each in ("marker", "hold"))
    size, words = 2.0, "time (s)"
    if hold.any():
        labels = list(dict.fromkeys(hold.tolist()))
        time, size, words = np.array([labels.index(each) for each in hold]), 5.0, "hold"
        for axes in (upper, lower):
            axes.set_xticks(range(len(labels)), labels)
    good = np.where(aside, np.nan, measured)
    left = good - after
    if coordinate == "angle":
        left = (left + 180.0) % 360.0 - 180.0
    for each in dict.fromkeys(marker.tolist()):
        of = marker == each
        upper.plot(time[of], good[of], ".", color=GREY, markersize=size, label="measured")
        upper.plot(time[of], before[of], "--", color=VERMILLION, linewidth=1.0, label="initial")
        upper.plot(time[of], after[of], "-", color=BLUE, label="identified")
        lower.plot(time[of], left[of], ".", color=INK, markersize=0.75 * size)
    low, high = np.nanmin(good), np.nanmax(good)
    room = 0.25 * max(high - low, 1e-9 * max(abs(low), abs(high), 1e-3))
    upper.set_ylim(low - room, high + room)
    if aside.any():  # far ones at the edge, so that the motion stays visible
        lost = np.clip(measured[aside], low - 0.8 * room, high + 0.8 * room)
        upper.plot(time[aside], lost, "x", color=INK, markersize=4.0, label="set aside")
    upper.set_ylabel(f"{name}{unit}")
    lower.axhline(0.0, color=GREY, linewidth=0.8)
    lower.set_ylabel(f"residual\n{unit.strip()}".strip())
    return words


_UNITS = {**dict.fromkeys(("x", "y", "z"), (1e3, " (mm)")), "angle": (180.0 / np.pi, " (deg)")}
