"""Measures of a study over the numbers that were swept."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes

from crinoid.report.charts.study import key_of, spread_far
from crinoid.report.style import GREY, INK, VERMILLION
from crinoid.report.style import key as legend
from crinoid.report.units import largest, length_unit


def find_sweep(
    varied: Sequence[Mapping[str, str]],
) -> tuple[str, Float[np.ndarray, " case"]] | None:
    """Return the one key of a study that varies, if its values are at least three numbers."""
    keys = [key_of(name, [case[name] for case in varied]) for name in varied[0]]
    changing = [key for key in keys if len(key.levels) > 1]
    if len(changing) != 1 or changing[0].numbers is None:
        return None
    (key,) = changing
    return (key.name, key.values) if np.unique(key.values).size >= 3 else None


def draw_errors(
    axes: Axes,
    name: str,
    values: Float[np.ndarray, " case"],
    measures: dict[str, Float[np.ndarray, " case"]],
    colours: Sequence[Any],
) -> None:
    """Draw errors (m) over the swept number, in the colours of the cases."""
    unit = length_unit(largest(*measures.values()))
    order = np.argsort(values)
    looks: dict[str, tuple[str, dict[str, Any]]] = {
        "rms_error_uncontrolled": ("RMS, no control", {"mfc": "white", "color": INK}),
        "rms_error": ("RMS", {"color": INK}),
        "deflection": ("steady, no control", {"color": GREY, "linestyle": (0, (3, 1.5))}),
        "steady_error": ("steady", {"color": VERMILLION}),
    }
    for measure, (label, look) in looks.items():
        shown = measures[measure] * unit.factor
        if np.isfinite(shown).any():
            axes.plot(values[order], shown[order], marker="o", markersize=4, label=label, **look)
    axes.scatter(values, measures["rms_error"] * unit.factor, s=40, color=list(colours), zorder=4)
    axes.set_ylim(bottom=0.0)
    axes.set_ylabel(f"tip error ({unit.name})")
    _number_axis(axes, name, values)
    legend(axes, columns=2)


def draw_settling(
    axes: Axes,
    name: str,
    values: Float[np.ndarray, " case"],
    times: Float[np.ndarray, " case"],
    colours: Sequence[Any],
) -> None:
    """Draw settling times (s) over the swept number; crosses at the foot did not settle."""
    order, settled = np.argsort(values), np.isfinite(times)
    axes.plot(values[order], times[order], color=INK)
    axes.scatter(values, times, s=40, color=list(colours), zorder=4)
    if not settled.all():
        axes.plot(values[~settled], 0 * values[~settled], "x", color=GREY, label="not settled")
    axes.set_ylim(bottom=-0.02 * (largest(times) or 1.0))
    axes.set_ylabel("settling time (s)")
    _number_axis(axes, name, values)
    legend(axes)


def _number_axis(axes: Axes, name: str, values: Float[np.ndarray, " case"]) -> None:
    if spread_far(values):
        axes.set_xscale("log")
    axes.set_xlabel(name)
