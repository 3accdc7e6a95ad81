"""The charts of the page, as documents of Bokeh, and what the page writes beside them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from bokeh.document import Document
from bokeh.models import (
    Axis,
    BasicTicker,
    BasicTickFormatter,
    ColumnDataSource,
    FixedTicker,
    Grid,
    HBar,
    Line,
    LinearAxis,
    LinearScale,
    LogAxis,
    LogScale,
    LogTicker,
    Plot,
    Range1d,
    VAreaStep,
)
from bokeh.models.annotations import Span
from jaxtyping import Float, Int

from crinoid.report.charts.chart import Chart, Panel, Trace
from crinoid.report.charts.drive import THROUGH
from crinoid.report.units import largest

RECORDS = 1501
"""Most values of a trace, over which all but its extremes are left out."""
_EDGE = 58
"""Pixels for the numbers of the axes, the same for all panels so that their times line up."""
_DASHES = {"solid": [], "dashed": [6, 3], "dotted": [2, 3], "filled": []}


@dataclass(frozen=True)
class Plots:
    """Charts ready to be shown."""

    document: dict[str, Any]
    """The document, as Bokeh's script reads it."""
    charts: list[dict[str, Any]]
    """Titles, names and units, and which root of the document each panel is."""
    left_out: list[str]


def plots_of(charts: list[Chart], begin: float, end: float) -> Plots:
    """Make plots of charts over a time (s)."""
    document = Document()
    span = Range1d(start=begin, end=end if end > begin else begin + 1.0)
    listed: list[dict[str, Any]] = []
    drawn: list[Plot] = []
    most = 0
    for chart in charts:
        panels = []
        for panel in chart.panels:
            last = panel is chart.panels[-1]
            plot, said, count = _panel(panel, span, last)
            drawn.append(plot)
            panels.append(said | {"root": plot.id})
            most = max(most, count if panel.over is None else 0)
        listed.append({"name": chart.name, "title": chart.title, "panels": panels})
    with document.models.freeze():  # else all models are counted anew for each
        for plot in drawn:
            document.add_root(plot)
    left_out = []
    if most > RECORDS:
        left_out.append(
            f"Charts show at most {RECORDS} of {most} saved instants of a trace: of each stretch "
            "of time the smallest and the largest value, so that no peak is lost."
        )
    return Plots(dict(document.to_json(deferred=False)), listed, left_out)


def empty_plot(**options: Any) -> Plot:
    """Return a plot as wide as its place on the page, which gives it its colours."""
    return Plot(
        sizing_mode="stretch_width",
        toolbar_location=None,
        min_border_left=_EDGE,
        min_border_right=10,
        min_border_top=6,
        outline_line_color=None,
        background_fill_color=None,
        border_fill_color=None,
        output_backend="canvas",
        **options,
    )


def _panel(panel: Panel, span: Range1d, last: bool) -> tuple[Plot, dict[str, Any], int]:
    rows = len(panel.rows)
    low, high = (-0.5, rows - 0.5) if rows else _ends(panel)
    plot = empty_plot(
        name=panel.name,
        x_range=Range1d(start=panel.over[0], end=panel.over[1]) if panel.over else span,
        x_scale=LogScale() if panel.over else LinearScale(),
        y_scale=LogScale() if panel.over else LinearScale(),
        y_range=Range1d(start=high, end=low) if rows else Range1d(start=low, end=high),
        height=max(56, 24 * rows) + 24 * last if rows else 112 + 24 * last,
        min_border_bottom=24 if last else 6,
    )
    across, up = _axes(panel)
    across.visible = last
    plot.add_layout(across, "below")
    plot.add_layout(up, "left")
    plot.add_layout(Grid(dimension=0, axis=across))
    if not rows:
        plot.add_layout(Grid(dimension=1, axis=up))
    for level in panel.levels:
        where = level.value * panel.factor
        if math.isfinite(where):
            dash = _DASHES[level.line]
            plot.add_layout(
                Span(location=where, dimension="width", line_dash=dash, name=level.role)
            )
    for index, row in enumerate(panel.rows):
        source = ColumnDataSource({"left": row.spans[:, 0], "right": row.spans[:, 1]})
        glyph = HBar(y=index, left="left", right="right", height=0.7, line_color=None)
        glyph.fill_alpha = 0.5 if row.behind else 1.0
        plot.add_glyph(source, glyph, name=f"row {index}")
    count = 0
    for index, trace in enumerate(panel.traces):
        chosen = kept(trace, panel.traces)
        source = ColumnDataSource(
            {
                "t": trace.at[chosen].astype(np.float32),
                "v": (trace.values[chosen] * panel.factor).astype(np.float32),
            }
        )
        plot.add_glyph(source, _glyph(trace), name=f"trace {index}")
        count = max(count, trace.at.size)
    plot.renderers.sort(key=lambda renderer: _order(panel, str(renderer.name)))
    return plot, _said(panel), count


def _axes(panel: Panel) -> tuple[Axis, Axis]:
    """Return the axes across and up."""
    if panel.over:
        low, high = panel.over
        rounds = [m * 10.0**k for k in range(-12, 13) for m in (1.0, 2.0, 5.0)]
        ticks: Any = FixedTicker(ticks=[each for each in rounds if low <= each <= high])
        plain: Any = BasicTickFormatter()
        return LogAxis(ticker=ticks, formatter=plain), LogAxis(ticker=LogTicker())
    across, up = LinearAxis(ticker=BasicTicker(desired_num_ticks=8)), LinearAxis()
    if panel.rows:
        names = {i: row.name.split(":")[0] for i, row in enumerate(panel.rows)}
        words: Any = {i: text.replace("without control", "without") for i, text in names.items()}
        ticks = FixedTicker(ticks=list(range(len(panel.rows))))
        up.update(ticker=ticks, major_label_overrides=words)
        return across, up
    up.ticker = BasicTicker(desired_num_ticks=4)
    for axis in (across, up):
        axis.formatter = BasicTickFormatter(power_limit_low=-5, power_limit_high=6)
    return across, up


def _glyph(trace: Trace) -> Line | VAreaStep:
    if trace.line == "filled":
        alpha = 0.15 if trace.behind else 0.3
        return VAreaStep(x="t", y1=0.0, y2="v", step_mode="after", fill_alpha=alpha)
    fainter = trace.behind and trace.role not in ("run", "free")
    return Line(
        x="t",
        y="v",
        line_width=1.0 if trace.line != "solid" or fainter else 1.6,
        line_alpha=0.5 if fainter else 0.9,
        line_dash=[4, 2] if fainter else _DASHES[trace.line],
        line_join="round",
    )


def _order(panel: Panel, name: str) -> int:
    """Put what is there to be compared with behind."""
    kind, index = name.split()
    return -int(kind == "trace" and panel.traces[int(index)].behind)


def _ends(panel: Panel) -> tuple[float, float]:
    """Return the ends of an axis, in the unit of its panel."""
    found = [trace.values[np.isfinite(trace.values)] for trace in panel.traces]
    found += [np.array([level.value]) for level in panel.levels if math.isfinite(level.value)]
    together = np.concatenate([*found, [0.0]] if not any(map(np.size, found)) else found)
    low, high = float(together.min()), float(together.max())
    room = 0.06 * (high - low) or 0.1 * largest(together) or 1.0
    low = low - room if panel.low is None else panel.low
    high = high + room if panel.high is None else panel.high
    return low * panel.factor, high * panel.factor


def kept(trace: Trace, together: tuple[Trace, ...]) -> Int[np.ndarray, " kept"]:
    """Choose instants of a trace: all, or those of the extremes of stretches of equal length.

    Traces of one time share their instants, so that a cursor reads them all at once.
    """
    count = trace.at.size
    if count <= RECORDS:
        return np.arange(count)
    group = [each.values for each in together if each.at is trace.at] or [trace.values]
    stretches = max(1, (RECORDS - 2) // (2 * len(group)))
    ends = np.linspace(0, count, stretches + 1).astype(int)
    chosen: list[Float[np.ndarray, " stretch"]] = [np.array([0, count - 1])]
    for values in group:
        known = np.where(np.isfinite(values), values, 0.0)
        for pick in (np.argmin, np.argmax):
            chosen.append(np.array([a + pick(known[a:b]) for a, b in pairwise(ends)]))
    return np.unique(np.concatenate(chosen).astype(int))


def _said(panel: Panel) -> dict[str, Any]:
    return {
        "name": panel.name,
        "timed": panel.over is None,
        "label": panel.label.replace("\n", " ").strip(),
        "unit": panel.unit.name if panel.unit else "",
        "nothing": panel.nothing,
        "left_out": panel.left_out,
        "also": [
            f"filled: {words}" if look == "filled" else words
            for words, look in panel.also
            if look != "dashed"
        ],
        "traces": [
            {
                # all are in the key, so that none stands for those before it
                "name": trace.name.removeprefix(THROUGH) or panel.label.replace("\n", " ").strip(),
                "told": trace.told.replace(" (dashed)", ""),
                "role": trace.role,
                "line": trace.line,
                "behind": trace.behind,
            }
            for trace in panel.traces
        ],
        "rows": [{"name": row.name, "role": row.role, "behind": row.behind} for row in panel.rows],
    }
