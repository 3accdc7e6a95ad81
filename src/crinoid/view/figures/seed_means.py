"""Figure of means over seeds: over one key with intervals, over two in a grid."""

import math
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from crinoid.foundation.status import Status
from crinoid.results.measure_labels import key_label, main_measures, plain_number
from crinoid.results.metrics import MEASURES
from crinoid.results.units import length_unit
from crinoid.studies.design import SEED
from crinoid.studies.statistics import means_of
from crinoid.view.figures import style
from crinoid.view.figures.study import Key, Study, StudyMeasure

_FEW = 4  # panels without those of packages
_LENGTHS = [length_unit(each) for each in (1.0, 0.01, 1e-6)]
"""Units of lengths, of which a figure has one: millimetres where its measures differ in size."""
_MOST_LEVELS = 24  # largest number of levels with labels or cells


def means_keys(study: Study) -> list[Key]:
    """Return the one or two keys over which means over seeds are drawn; else none.

    Without seeds the cases must be all combinations of the values of the keys, each once.
    """
    keys = [key for key in study.varied if key.name != SEED]
    whole = len(study.names) == math.prod(len(key.levels) for key in keys)
    fits = 1 <= len(keys) <= 2 and all(len(key.levels) <= _MOST_LEVELS for key in keys)
    return keys if fits and (whole or _seeded(study)) else []


def _seeded(study: Study) -> bool:
    return any(key.name == SEED for key in study.varied)


def draw_means(study: Study, title: str) -> Figure:
    """Draw the main measures over the keys of `means_keys`, each with intervals of 95 %."""
    complete = [Status.of(each) is Status.OK for each in study.status]
    keys = means_keys(study)
    known = {
        each.name: each._replace(values=np.where(complete, each.values, np.nan))
        for each in study.measures
    }
    if len({each.unit for each in known.values() if each.unit in _LENGTHS}) > 1:
        for each in [each for each in known.values() if each.unit in _LENGTHS]:
            known[each.name] = each._replace(unit=_LENGTHS[1])
    names = main_measures(known)
    shown = [*names[:_FEW], *(name for name in names[_FEW:] if name not in MEASURES)]
    across = style.columns(3.0 if len(keys) == 2 else 1.6, 2)
    rows = math.ceil(len(shown) / across)
    figure = style.new_figure(0.4 + 2.7 * rows)
    style.head(figure, title, "ok")
    if _seeded(study):
        runs = "" if len(keys) == 2 else "; points: runs"
        words = f"means over seeds and their 95 % intervals{runs}"
        figure.supxlabel(style.wrap(words), fontsize=style.small(), color=style.GREY)
    grid = list(figure.subplots(rows, across, squeeze=False).flat)
    for axes, name in zip(grid, shown, strict=False):
        (_draw_grid if len(keys) == 2 else _draw_line)(axes, known[name], *keys)
        unit = known[name].unit.name
        label = known[name].label + (f" ({unit})" if unit else "")
        axes.set_title(style.wrap(label, across), loc="left")
    for axes in grid[len(shown) :]:
        axes.set_axis_off()
    return figure


def _draw_line(axes: Axes, measure: StudyMeasure, key: Key) -> None:
    values = measure.values * measure.unit.factor
    means = means_of(values, key.level, len(key.levels))
    at = np.arange(len(key.levels)) if key.numbers is None else key.numbers
    axes.scatter(key.values, values, s=9, color=style.SKY, linewidth=0)
    look: Any = {"color": style.BLUE, "capsize": 3, "marker": "o", "markersize": 3.5}
    axes.errorbar(at, means.value, means.half, **look)  # NaN of one seed: no bar
    axes.set_xlabel(style.wrap(key_label(key.name), 2))
    axes.set_ylim(min(0.0, axes.get_ylim()[0]))
    if key.logarithmic:
        axes.set_xscale("log")
    if key.numbers is None:
        axes.set_xticks(at, key.levels, parse_math=False)
    elif len(at) <= 8:
        axes.set_xticks(at, [plain_number(float(each)) for each in at], minor=False)
        axes.set_xticks([], minor=True)


def _draw_grid(axes: Axes, measure: StudyMeasure, across: Key, up: Key) -> None:
    shape = len(up.levels), len(across.levels)
    means = means_of(measure.values, up.level * shape[1] + across.level, math.prod(shape))
    values = means.value.reshape(shape) * measure.unit.factor
    mesh = axes.pcolormesh(values, cmap="viridis", edgecolors="white", linewidth=3.0)
    axes.grid(visible=False)
    middle = np.nanmean([np.nanmin(values), np.nanmax(values)])
    if shape[1] <= 5 and shape[0] <= 10:
        texts = iter(means.texts(measure.unit))
        look: Any = {"ha": "center", "va": "center", "fontsize": 7.5 if shape[1] <= 3 else 6.0}
        for (row, column), value in np.ndenumerate(values):
            ink = style.INK if value > middle else "white"
            axes.text(column + 0.5, row + 0.5, next(texts), color=ink, **look)
    else:
        axes.figure.colorbar(mesh, ax=axes)
    for key, axis in ((across, axes.xaxis), (up, axes.yaxis)):
        every = -(-len(key.levels) // 8)
        words = key.levels if key.numbers is None else [plain_number(v) for v in key.numbers]
        axis.set_ticks(np.arange(0, len(words), every) + 0.5, words[::every], parse_math=False)
        axis.set_label_text(style.wrap(key_label(key.name), 2))
