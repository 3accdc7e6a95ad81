"""Measures of a study over what varied, as documents of Bokeh.

A document holds the means of all measures in columns of their names; the page shows one of them,
and fills in those of the cases, which it holds anyway.
"""

from __future__ import annotations

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
    Line,
    LinearAxis,
    LinearScale,
    LogAxis,
    LogScale,
    LogTicker,
    Plot,
    Range1d,
    Rect,
    Scale,
    Scatter,
    Text,
    VArea,
)
from jaxtyping import Float

from crinoid.report.charts.study import Key, Measure, Study, gridded, means_of
from crinoid.report.page.plots import empty_plot

_FEW = 200
"""Cells that have room for their number."""
_CROWD = 300
"""Cases over which their points are small."""
_ROOM = 0.06
"""Share of an axis that is left beyond its outermost points."""
_WORDS = 14
"""Levels that have room for their words along an axis."""


def views_of(study: Study) -> list[dict[str, Any]]:
    """Return the charts of a study: document, root, kind, keys, and the ends of each measure."""
    return [_view(study, keys) for keys in study.views()]


def _view(study: Study, keys: tuple[Key, ...]) -> dict[str, Any]:
    if len(keys) == 1:
        kind, plot = "lines", _lines(study, *keys)
    elif gridded(keys):
        kind, plot = "cells", _cells(study, *keys)
    else:
        kind, plot = "points", _points(study, *keys)
    document = Document()
    document.add_root(plot)
    return {
        "root": plot.id,
        "document": document.to_json(deferred=False),
        "keys": [study.keys.index(key) for key in keys],
        "kind": kind,
        "ends": {each.name: _ends(study, each) for each in study.measures},
    }


def _cells(study: Study, across: Key, up: Key) -> Plot:
    wide, tall = len(across.levels), len(up.levels)
    plot = _plot(_Side(across, even=True), _Side(up, even=True), max(240, min(520, 64 * tall)))
    place = across.level * tall + up.level
    cells = np.unique(place)
    columns: dict[str, Any] = {"x": cells // tall, "y": cells % tall}
    for measure in study.measures:
        columns[measure.name] = _shown(measure, means_of(measure.values, place, wide * tall).mean)[
            cells
        ]
    source = _source(columns)
    cell = Rect(x="x", y="y", width=1.0, height=1.0, fill_color="fill", line_width=1.0)
    plot.add_glyph(source, cell, name="cells")
    if cells.size <= _FEW and wide <= 16:
        text = Text(x="x", y="y", text="text", text_color="tone", text_font_size="11px")
        text.text_align, text.text_baseline = "center", "middle"
        plot.add_glyph(source, text, name="numbers")
    return plot


def _points(study: Study, across: Key, up: Key) -> Plot:
    plot = _plot(_Side(across), _Side(up), 420)
    source = _source({"x": across.values, "y": up.values})
    glyph = Scatter(x="x", y="y", size=_size(study), fill_color="fill", line_color=None)
    plot.add_glyph(source, glyph, name="points")
    return plot


def _lines(study: Study, key: Key) -> Plot:
    plot = _plot(_Side(key), None, 380)
    x = np.arange(len(key.levels)) if key.numbers is None else key.numbers
    columns: dict[str, Any] = {"x": x.astype(float)}
    for measure in study.measures:
        found = means_of(measure.values, key.level, len(key.levels))
        columns[measure.name] = _shown(measure, found.mean)
        columns[f"{measure.name} low"] = _shown(measure, found.low)
        columns[f"{measure.name} high"] = _shown(measure, found.high)
    source = _source(columns, bands=True)
    band = VArea(x="x", y1="low", y2="high", fill_alpha=0.16)
    plot.add_glyph(source, band, name="band")
    plot.add_glyph(source, Line(x="x", y="v", line_width=1.8), name="line")
    if key.repeated:
        mark = Scatter(x="x", y="v", size=8.0, marker="diamond", line_color=None)
        plot.add_glyph(source, mark, name="means")
    points = Scatter(x="x", y="v", size=_size(study), fill_color="fill", line_color=None)
    points.fill_alpha = 0.75
    plot.add_glyph(_source({"x": key.values}), points, name="points")
    return plot


def _shown(measure: Measure, values: Float[np.ndarray, " place"]) -> Float[np.ndarray, " place"]:
    return values * measure.unit.factor


def _source(columns: dict[str, Any], *, bands: bool = False) -> ColumnDataSource:
    """Return a source of all measures, and of the columns that the page fills with one of them."""
    count = len(columns["x"])
    filled: dict[str, Any] = {"v": np.full(count, np.nan), "fill": [""] * count}
    filled |= {"text": [""] * count, "tone": [""] * count}
    if bands:
        filled |= {"low": np.full(count, np.nan), "high": np.full(count, np.nan)}
    return ColumnDataSource(columns | filled)


def _size(study: Study) -> float:
    return 9.0 if len(study.names) <= _CROWD else 4.0


def _ends(study: Study, measure: Measure) -> list[float]:
    known = _shown(measure, measure.values[np.isfinite(measure.values)])
    low, high = min(0.0, float(known.min())), max(0.0, float(known.max()))
    room = _ROOM * (high - low) or 1.0
    return [low - room * (low < 0), high + room]


class _Side:
    """An axis of a chart: the numbers of a key, or its levels side by side."""

    def __init__(self, key: Key, *, even: bool = False) -> None:
        numbers = None if even else key.numbers
        self.words: list[str] | None = None
        self.log = numbers is not None and key.logarithmic
        if numbers is None:
            self.words = [_short(text) for text in key.levels]
            self.ends = -0.5, len(key.levels) - 0.5
        elif self.log:
            room = (numbers[-1] / numbers[0]) ** _ROOM
            self.ends = float(numbers[0] / room), float(numbers[-1] * room)
        else:
            gap = _ROOM * float(numbers[-1] - numbers[0])
            self.ends = float(numbers[0]) - gap, float(numbers[-1]) + gap

    def range(self) -> Range1d:
        return Range1d(start=self.ends[0], end=self.ends[1])

    def scale(self) -> Scale:
        return LogScale() if self.log else LinearScale()

    def axis(self) -> Axis:
        formatter = BasicTickFormatter(power_limit_low=-5, power_limit_high=6)
        if self.log:
            log = LogAxis(ticker=LogTicker())
            log.update(formatter=formatter)  # numbers rather than powers
            return log
        if self.words is None:
            return LinearAxis(ticker=BasicTicker(desired_num_ticks=5), formatter=formatter)
        every = -(-len(self.words) // _WORDS)
        axis = LinearAxis(major_label_overrides=dict(enumerate(self.words)))
        axis.update(ticker=FixedTicker(ticks=list(range(0, len(self.words), every))))
        return axis


def _short(text: str) -> str:
    try:
        return f"{float(text):.4g}"
    except ValueError:
        return text if len(text) <= 24 else f"{text[:22]} …"


def _plot(across: _Side, up: _Side | None, height: int) -> Plot:
    """Return an empty plot; without ``up`` a measure is upwards, whose ends the page sets."""
    plot = empty_plot(
        x_range=across.range(),
        x_scale=across.scale(),
        y_range=Range1d(start=0.0, end=1.0) if up is None else up.range(),
        y_scale=LinearScale() if up is None else up.scale(),
        height=height,
        min_border_bottom=26,
    )
    below, left = across.axis(), LinearAxis() if up is None else up.axis()
    plot.add_layout(below, "below")
    plot.add_layout(left, "left")
    plot.add_layout(Grid(dimension=1, axis=left))
    plot.add_layout(Grid(dimension=0, axis=below))
    return plot
