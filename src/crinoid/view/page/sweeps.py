"""Charts of a study: its measures over the varied keys, as documents of Bokeh.

A document contains the means of all measures in columns of their names. The page shows one of
them, and adds the values of the cases from its table.
"""

import math
from typing import Any

import numpy as np
from bokeh import models
from bokeh.document import Document
from jaxtyping import Float, Int
from matplotlib.ticker import LogLocator, MaxNLocator

from crinoid.results.measure_labels import plain_number
from crinoid.studies.statistics import grouped, means_of
from crinoid.view.figures.study import CaseNumbers, Key, Study, StudyMeasure, gridded
from crinoid.view.page.plots import empty_plot

_FEW = 200  # cells that have room for their number
_CROWD = 300  # number of cases above which their points are small
_ROOM = 0.06  # margin beyond the outermost points, as a share of an axis
_BAND, BAND_CASES = (0.05, 0.95), 5  # quantiles around a line, and the fewest cases for them
_WORDS = 14  # most labelled levels along an axis


def view_of(study: Study, keys: tuple[Key, ...]) -> dict[str, Any]:
    """Return a chart of a study: document, root, kind, keys, and the ends of each measure."""
    if len(keys) == 1:
        kind, plot = "lines", _lines(study, *keys)
    elif gridded(keys):
        kind, plot = "cells", _cells(study, *keys)
    else:
        kind, plot = "points", _plot(_StudyAxis(keys[0]), _StudyAxis(keys[1]), 420)
        source = _source({"x": keys[0].values, "y": keys[1].values})
        glyph = models.Scatter(x="x", y="y", fill_color="fill", line_color=None, size=_size(study))
        plot.add_glyph(source, glyph, name="points")
    document = Document()
    document.add_root(plot)
    return {
        "root": plot.id,
        "document": document.to_json(deferred=False),
        "keys": [study.keys.index(key) for key in keys],
        "kind": kind,
        "ends": {each.name: _ends(each) for each in study.measures},
    }


def _cells(study: Study, across: Key, up: Key) -> models.Plot:
    wide, tall = len(across.levels), len(up.levels)
    axes = _StudyAxis(across, even=True), _StudyAxis(up, even=True)
    plot = _plot(*axes, max(240, min(520, 64 * tall)))
    place = across.level * tall + up.level
    cells = np.unique(place)
    columns: dict[str, Any] = {"x": cells // tall, "y": cells % tall}
    for measure in study.measures:
        known, factor = means_of(measure.values, place, wide * tall), measure.unit.factor
        columns[measure.name] = known.value[cells] * factor
        if cells.size < place.size:
            columns[f"{measure.name} half"] = known.half[cells] * factor
    source = _source(columns)
    cell = models.Rect(x="x", y="y", width=1.0, height=1.0, fill_color="fill", line_width=1.0)
    plot.add_glyph(source, cell, name="cells")
    if cells.size <= _FEW and wide <= 16:
        text = models.Text(x="x", y="y", text="text", text_color="tone", text_font_size="11px")
        text.text_align, text.text_baseline = "center", "middle"
        plot.add_glyph(source, text, name="numbers")
    return plot


def _lines(study: Study, key: Key) -> models.Plot:
    plot = _plot(_StudyAxis(key), None, 380)
    x = np.arange(len(key.levels)) if key.numbers is None else key.numbers
    columns: dict[str, Any] = {"x": x.astype(float)}
    for measure in study.measures:
        at, factor = (measure.values, key.level, len(key.levels)), measure.unit.factor
        parts = zip(("", " low", " high"), (means_of(*at).value, *bands_of(*at)), strict=True)
        columns |= {f"{measure.name}{part}": values * factor for part, values in parts}
    source = _source(columns, bands=True)
    band = models.VArea(x="x", y1="low", y2="high", fill_alpha=0.16)
    plot.add_glyph(source, band, name="band")
    plot.add_glyph(source, models.Line(x="x", y="v", line_width=1.8), name="line")
    if key.repeated:
        mark = models.Scatter(x="x", y="v", size=8.0, marker="diamond", line_color=None)
        plot.add_glyph(source, mark, name="means")
    points = models.Scatter(x="x", y="v", size=_size(study), fill_color="fill", line_color=None)
    points.fill_alpha = 0.75
    plot.add_glyph(_source({"x": key.values}), points, name="points")
    return plot


def bands_of(
    values: CaseNumbers, place: Int[np.ndarray, " case"], places: int
) -> Float[np.ndarray, "2 place"]:
    """Return the quantiles of 5 and 95 % at each place; NaN where few cases are known."""
    ends = np.full((2, places), np.nan)
    for some, rows in grouped(values, place, places):
        if rows.shape[1] >= BAND_CASES:
            ends[:, some] = np.quantile(rows, _BAND, axis=1)
    return ends


def _source(columns: dict[str, Any], *, bands: bool = False) -> models.ColumnDataSource:
    """Return a source of all measures, with columns that the page fills from one of them."""
    count = len(columns["x"])
    filled: dict[str, Any] = {"v": np.full(count, np.nan), "fill": [""] * count}
    filled |= {"text": [""] * count, "tone": [""] * count}
    if bands:
        filled |= {"low": np.full(count, np.nan), "high": np.full(count, np.nan)}
    return models.ColumnDataSource(columns | filled)


def _size(study: Study) -> float:
    return 9.0 if len(study.names) <= _CROWD else 4.0


def _ends(measure: StudyMeasure) -> list[float]:
    known = measure.values[np.isfinite(measure.values)] * measure.unit.factor
    low, high = min(0.0, float(known.min())), max(0.0, float(known.max()))
    room = _ROOM * (high - low) or 1.0
    return [low - room * (low < 0), high + room]


class _StudyAxis:
    """Axis of a chart: the numbers of a key, or its levels at even distances."""

    def __init__(self, key: Key, *, even: bool = False) -> None:
        numbers = None if even else key.numbers
        self.words: list[str] | None = None
        self.log = numbers is not None and key.logarithmic
        self.scale = models.LogScale() if self.log else models.LinearScale()
        if numbers is None:
            self.words = [_short(text) for text in key.levels]
            low, high = -0.5, len(key.levels) - 0.5
        elif self.log:
            room = (numbers[-1] / numbers[0]) ** _ROOM
            low, high = float(numbers[0] / room), float(numbers[-1] * room)
        else:
            gap = _ROOM * float(numbers[-1] - numbers[0])
            low, high = float(numbers[0]) - gap, float(numbers[-1]) + gap
        self.ends = low, high
        self.range = models.Range1d(start=low, end=high)

    def axis(self) -> models.Axis:
        """Return the axis, with a tick at some levels or at round numbers."""
        if self.words is not None:
            every = -(-len(self.words) // _WORDS)
            named = dict(list(enumerate(self.words))[::every])
        else:
            named = {tick: plain_number(tick) for tick in self._round_numbers()}
        axis = models.LogAxis() if self.log else models.LinearAxis()
        axis.update(ticker=models.FixedTicker(ticks=list(named)), major_label_overrides=named)
        return axis

    def _round_numbers(self) -> list[float]:
        low, high = self.ends
        locator = LogLocator(subs=(1.0, 2.0, 5.0)) if self.log else MaxNLocator(6)
        ticks = [float(each) for each in locator.tick_values(low, high) if low <= each <= high]
        return ticks if len(ticks) <= _WORDS else [t for t in ticks if math.log10(t) % 1 < 1e-9]


def _short(text: str) -> str:
    try:
        return plain_number(float(text))
    except ValueError:
        return text if len(text) <= 24 else f"{text[:22]} …"


def _plot(across: _StudyAxis, up: _StudyAxis | None, height: int) -> models.Plot:
    """Return an empty plot; without ``up`` its vertical axis is a measure with ends of the page."""
    plot = empty_plot(
        x_range=across.range,
        x_scale=across.scale,
        y_range=models.Range1d(start=0.0, end=1.0) if up is None else up.range,
        y_scale=models.LinearScale() if up is None else up.scale,
        height=height,
        min_border_bottom=26,
    )
    below, left = across.axis(), models.LinearAxis() if up is None else up.axis()
    if up is None:
        left.formatter = models.BasicTickFormatter(power_limit_low=-5, power_limit_high=6)
    plot.add_layout(below, "below")
    plot.add_layout(left, "left")
    plot.add_layout(models.Grid(dimension=1, axis=left))
    plot.add_layout(models.Grid(dimension=0, axis=below))
    return plot
