"""The cases of a study side by side."""

import math
import textwrap
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.gridspec import GridSpecBase

from crinoid.cases import MEASURES
from crinoid.report.finals import draw_finals, draw_finals_in_space, lay_out
from crinoid.report.run import open_result
from crinoid.report.style import (
    GREY,
    INK,
    VERMILLION,
    WIDTH,
    head,
    head_height,
    lay_out_below,
    time_map,
)
from crinoid.report.sweep import draw_errors, draw_settling, find_sweep
from crinoid.report.table import Case, short_keys
from crinoid.report.units import Unit, largest, length_unit
from crinoid.report.view import is_spatial
from crinoid.status import Status

_WIDTHS = [1.0, 1.5, 1.0]  # of the panels of measures


def draw_cases(cases: Sequence[Case], title: str) -> Figure:
    """Draw the final shapes of all cases, and the measures of each in its shape's colour."""
    tall = 0.55 + 0.34 * len(cases) + 0.12 * sum(len(_label(c, cases).split("\n")) for c in cases)
    colours = [time_map()(v) for v in np.linspace(0.0, 1.0, len(cases))]
    finals = [
        (open_result(case.result).isel(time=[-1]), colour)
        for case, colour in zip(cases, colours, strict=True)
        if case.result is not None
    ]
    columns: GridSpecBase
    wide, title_height = WIDTH + 0.6, head_height(title, "ok", WIDTH + 0.6)
    if any(is_spatial(data) for data, _ in finals):
        block = lay_out(finals, wide)
        foot = tall + 1.0
        figure = Figure(
            figsize=(wide, foot + block.height + title_height + 0.5), layout="constrained"
        )
        head(figure, title, "ok")
        draw_finals_in_space(figure, finals, block, foot)
        lay_out_below(figure, foot - 0.55)
        columns = figure.add_gridspec(1, 3, width_ratios=_WIDTHS)
    else:
        figure = Figure(figsize=(wide, tall + 4.2), layout="constrained")
        rows = figure.add_gridspec(2, 1, height_ratios=[3.2, tall + 0.4])
        draw_finals(figure.add_subplot(rows[0]), finals)
        columns = rows[1].subgridspec(1, 3, width_ratios=_WIDTHS)
        head(figure, title, "ok")
    sweep = find_sweep([case.varied for case in cases])
    if sweep is not None:
        _sweep(figure, columns, cases, sweep, colours)
        return figure
    first = figure.add_subplot(columns[0])
    errors = figure.add_subplot(columns[1], sharey=first)
    settling = figure.add_subplot(columns[2], sharey=first)
    unit = length_unit(largest(_values(cases, "deflection")))
    _bars(first, cases, "deflection", unit, colours, missing="none")
    first.set_xlabel(f"deflection ({unit.name})")
    _errors(errors, cases, colours)
    _bars(settling, cases, "settling_time", Unit(1.0, "s"), colours, missing="not settled")
    settling.set_xlabel("settling time (s)")

    labels = [_label(case, cases) for case in cases]
    first.set_yticks(range(len(cases)), labels, parse_math=False)
    first.set_ylim(len(cases) - 0.4, -0.6)
    for axes in (first, errors, settling):
        axes.grid(visible=False, axis="y")
        axes.tick_params(axis="y", length=0, labelleft=axes is first)
    return figure


def _sweep(
    figure: Figure,
    columns: GridSpecBase,
    cases: Sequence[Case],
    sweep: tuple[str, np.ndarray],
    colours: Sequence[tuple[float, ...]],
) -> None:
    """Draw the measures of a study of one number over that number."""
    name, values = sweep
    measures = {measure: _values(cases, measure) for measure in MEASURES}
    draw_errors(figure.add_subplot(columns[:2]), name, values, measures, colours)
    times = measures["settling_time"]
    draw_settling(figure.add_subplot(columns[2]), name, values, times, colours)


def _values(cases: Sequence[Case], measure: str) -> np.ndarray:
    return np.array([case.measures[measure] for case in cases])


def _label(case: Case, cases: Sequence[Case]) -> str:
    """Name of a case and what was varied in it, keys shortened while that keeps them apart."""
    short = short_keys(list(case.varied))
    told = (f"{short[key]} {_short(value)}" for key, value in case.varied.items())
    parts = [each.replace("_", " ") for each in told]
    together = ", ".join(parts)
    lines = [case.name, *([together] if len(together) <= 30 else parts)]
    if Status.of(case.status) is not Status.OK:
        lines.append(textwrap.shorten(case.status, 34, placeholder=" ..."))
    return "\n".join(lines)


def _short(value: str) -> str:
    try:
        return f"{float(value):.4g}"
    except ValueError:
        return textwrap.shorten(value, 28, placeholder=" ...")


def _bars(
    axes: Axes,
    cases: Sequence[Case],
    measure: str,
    unit: Unit,
    colours: Sequence[tuple[float, ...]],
    *,
    missing: str,
) -> None:
    values = _values(cases, measure) * unit.factor
    shown = np.where(np.isfinite(values), values, 0.0)
    axes.barh(range(len(cases)), shown, height=0.55, color=list(colours))
    top = max(float(shown.max()), 0.0) or 1.0
    axes.set_xlim(min(0.0, float(shown.min()) * 1.3), top * 1.3)  # room for the numbers
    for place, (value, case) in enumerate(zip(values, cases, strict=True)):
        known = math.isfinite(value)
        words = (
            f"{value:.3g}"
            if known
            else ("stopped" if Status.of(case.status) is not Status.OK else missing)
        )
        axes.annotate(
            words,
            (max(float(shown[place]), 0.0), place),
            xytext=(3, 0),
            textcoords="offset points",
            va="center",
            fontsize=8.0,
            color=INK if known else GREY,
        )


def _errors(axes: Axes, cases: Sequence[Case], colours: Sequence[tuple[float, ...]]) -> None:
    names = ("rms_error_uncontrolled", "rms_error", "steady_error")
    unit = length_unit(largest(*(_values(cases, name) for name in names)))
    without, with_control, steady = (_values(cases, name) * unit.factor for name in names)
    places = np.arange(len(cases))
    axes.hlines(places, without, with_control, color=GREY, linewidth=1.0, zorder=1)
    axes.scatter(
        without, places, s=34, facecolor="white", edgecolor=INK, zorder=2, label="RMS, no control"
    )
    axes.scatter(with_control, places, s=40, color=list(colours), zorder=3)
    axes.scatter([], [], s=40, color=INK, label="RMS")
    axes.scatter(
        steady, places, s=80, marker="|", linewidth=1.8, color=VERMILLION, zorder=4, label="steady"
    )
    axes.set_xlim(left=0.0)
    axes.set_xlabel(f"tip error ({unit.name})")
    axes.legend(
        loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3, columnspacing=1.0, handletextpad=0.1
    )
