"""Charts of a page as documents of Bokeh, and their legends."""

import math
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from bokeh import models
from bokeh.document import Document
from bokeh.models.annotations import BoxAnnotation, Span
from jaxtyping import Float, Int

from crinoid.results.units import largest
from crinoid.view.figures.charts.chart import Chart, Panel, Trace
from crinoid.view.figures.charts.drive import THROUGH

RECORDS = 1501  # most values of a trace; above it only extremes remain
_EDGE = 58  # pixels for the numbers of an axis, the same in all panels to align their times
_NOISE = 1e-6  # of the largest value: less is round-off
_FOLDED = {"energy", "effort"}  # charts that are folded away
_DASHES = {"solid": [], "dashed": [6, 3], "dotted": [2, 3], "filled": []}


class PlotDocument(NamedTuple):
    """A Bokeh document of charts, and their texts."""

    document: dict[str, Any]  # the document in JSON
    charts: list[dict[str, Any]]
    """Titles, names and units, and the root of each panel in the document."""
    left_out: list[str]


def plots_of(charts: list[Chart], begin: float, end: float) -> PlotDocument:
    """Return the plots of charts over a time span (s)."""
    document = Document()
    span = models.Range1d(start=begin, end=end if end > begin else begin + 1.0)
    listed: list[dict[str, Any]] = []
    drawn: list[models.Plot] = []
    most = 0  # instants of a trace
    for chart in charts:
        panels = []
        filled = chart.filled
        for panel in filled:
            drawn.append(_panel(panel, span, panel is filled[-1]))
            panels.append(_texts(panel) | {"root": drawn[-1].id})
            if panel.over is None:
                most = max([most, *(trace.at.size for trace in panel.traces)])
        about = {"name": chart.name, "title": chart.title, "folded": chart.name in _FOLDED}
        listed.append(about | {"panels": panels})
    with document.models.freeze():  # or each root would count all models again
        for plot in drawn:
            document.add_root(plot)
    note = (
        f"Charts show at most {RECORDS} of {most} saved instants of a trace: the smallest and "
        "the largest value of each interval, so that no peak is lost."
    )
    left_out = [note] if most > RECORDS else []
    return PlotDocument(dict(document.to_json(deferred=False)), listed, left_out)


def empty_plot(**options: Any) -> models.Plot:
    """Return a plot as wide as its place on the page, where a script sets its colours."""
    borders = {"min_border_left": _EDGE, "min_border_right": 10, "min_border_top": 6}
    colours = ("outline_line_color", "background_fill_color", "border_fill_color")
    options |= borders | dict.fromkeys(("toolbar_location", *colours))
    return models.Plot(sizing_mode="stretch_width", output_backend="canvas", **options)


def _panel(panel: Panel, span: models.Range1d, last: bool) -> models.Plot:
    rows = len(panel.rows)
    low, high = (rows - 0.5, -0.5) if rows else _ends(panel)  # rows from the top down
    plot = empty_plot(
        name=panel.name,
        x_range=models.Range1d(start=panel.over[0], end=panel.over[1]) if panel.over else span,
        x_scale=models.LogScale() if panel.over else models.LinearScale(),
        y_scale=models.LogScale() if panel.over else models.LinearScale(),
        y_range=models.Range1d(start=low, end=high),
        height=max(56, 24 * rows) + 24 * last if rows else 112 + 24 * last,
        min_border_bottom=24 if last else 6,
    )
    across, up = _axes(panel)
    across.visible = last
    plot.add_layout(across, "below")
    plot.add_layout(up, "left")
    plot.add_layout(models.Grid(dimension=0, axis=across))
    if not rows:
        plot.add_layout(models.Grid(dimension=1, axis=up))
    for level in panel.levels:
        where = level.value * panel.factor
        if math.isfinite(where):
            line = Span(location=where, dimension="width", name=level.role)
            line.line_dash = _DASHES[level.line]
            plot.add_layout(line)
    if panel.aside is not None:
        shade: Any = {"fill_color": "gray", "fill_alpha": 0.15, "line_color": None}
        plot.add_layout(BoxAnnotation(right=panel.aside, **shade))
    for index, row in enumerate(panel.rows):
        source = models.ColumnDataSource({"left": row.spans[:, 0], "right": row.spans[:, 1]})
        glyph = models.HBar(y=index, left="left", right="right", height=0.7, line_color=None)
        glyph.fill_alpha = 0.5 if row.behind else 1.0
        plot.add_glyph(source, glyph, name=f"row {index}")
    for index, trace in enumerate(panel.traces):
        chosen = extreme_instants(trace, panel.traces)
        at, values = trace.at[chosen], trace.values[chosen] * panel.factor
        source = models.ColumnDataSource({"t": at.astype("f4"), "v": values.astype("f4")})
        plot.add_glyph(source, _glyph(trace), name=f"trace {index}")
    behind = {f"trace {index}" for index, trace in enumerate(panel.traces) if trace.behind}
    plot.renderers.sort(key=lambda renderer: renderer.name not in behind)
    return plot


def _axes(panel: Panel) -> tuple[models.Axis, models.Axis]:
    if panel.over:
        low, high = panel.over
        rounds = [m * 10.0**k for k in range(-12, 13) for m in (1.0, 2.0, 5.0)]
        ticks: Any = models.FixedTicker(ticks=[each for each in rounds if low <= each <= high])
        plain: Any = models.BasicTickFormatter()
        above = models.LogAxis(ticker=models.LogTicker())
        return models.LogAxis(ticker=ticks, formatter=plain), above
    across = models.LinearAxis(ticker=models.BasicTicker(desired_num_ticks=8))
    up = models.LinearAxis()
    if panel.rows:
        names = {i: row.name.split(":")[0] for i, row in enumerate(panel.rows)}
        words: Any = {i: text.replace("without control", "without") for i, text in names.items()}
        ticks = models.FixedTicker(ticks=list(range(len(panel.rows))))
        up.update(ticker=ticks, major_label_overrides=words)
        return across, up
    up.ticker = models.BasicTicker(desired_num_ticks=4)
    for axis in (across, up):
        axis.formatter = models.BasicTickFormatter(power_limit_low=-5, power_limit_high=6)
    return across, up


def _glyph(trace: Trace) -> models.Line | models.VAreaStep:
    if trace.line == "filled":
        alpha = 0.15 if trace.behind else 0.3
        return models.VAreaStep(x="t", y1=0.0, y2="v", step_mode="after", fill_alpha=alpha)
    fainter = trace.behind and trace.role not in ("run", "free")
    dash = [4, 2] if fainter else _DASHES[trace.line]
    line = models.Line(x="t", y="v", line_dash=dash, line_join="round")
    line.line_width = 1.0 if trace.line != "solid" or fainter else 1.6
    line.line_alpha = 0.5 if fainter else 0.9
    return line


def _ends(panel: Panel) -> tuple[float, float]:
    """Return the ends of an axis, in the unit of its panel."""
    found = [trace.values[np.isfinite(trace.values)] for trace in panel.traces]
    found += [np.array([level.value]) for level in panel.levels if math.isfinite(level.value)]
    together = np.concatenate([*found, [0.0]] if not any(map(np.size, found)) else found)
    low, high = float(together.min()), float(together.max())
    most = largest(together)
    room = 0.06 * (high - low) if high - low > _NOISE * most else 0.1 * most or 1.0 / panel.factor
    low = low - room if panel.low is None else panel.low
    high = high + room if panel.high is None else panel.high
    return low * panel.factor, high * panel.factor


def extreme_instants(trace: Trace, together: tuple[Trace, ...]) -> Int[np.ndarray, " chosen"]:
    """Return all instants of a trace, or those of the extremes in intervals of equal length.

    Traces of the same times share these instants, so that a cursor reads them together.
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


def _texts(panel: Panel) -> dict[str, Any]:
    label = panel.label.replace("\n", " ").strip()
    also: list[tuple[str, str]] = [each for each in panel.also if each[1] != "dashed"]
    also += [("does not count", "shaded")] if panel.aside is not None else []
    return {
        "name": panel.name,
        "timed": panel.over is None,
        "label": label,
        "unit": panel.unit.name if panel.unit else "",
        "nothing": panel.nothing,
        "left_out": panel.left_out,
        "also": [
            f"{look}: {words}" if look in ("filled", "shaded") else words for words, look in also
        ],
        "traces": [
            {
                # the legend has an entry for each of several numbered traces
                "name": trace.name.removeprefix(THROUGH) or label,
                "told": trace.summary.replace(" (dashed)", ""),
                "role": trace.role,
                "line": trace.line,
                "behind": trace.behind,
            }
            for trace in panel.traces
        ],
        "rows": [{"name": row.name, "role": row.role, "behind": row.behind} for row in panel.rows],
    }
