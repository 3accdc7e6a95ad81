"""Where the energy goes, and how well the books balance."""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from crinoid.report.run import Run
from crinoid.report.style import (
    GREY,
    INK,
    SERIES,
    WIDTH,
    head,
    key,
    line_style,
    note,
    share_time,
)
from crinoid.report.units import largest, si_unit

_STORED = ("kinetic", "elastic", "potential")


def draw_energy(run: Run) -> Figure:
    """Draw the change of the stored energies, the running works, and what they fail to balance.

    The defect is (stored energy - its initial value - sum of works), relative to the largest
    magnitude that any change or work reaches.
    """
    figure = Figure(figsize=(WIDTH, 6.8), layout="constrained")
    stored, works, balance = figure.subplots(3, 1, sharex=True, height_ratios=[1.2, 1.2, 0.8])
    time = run.result["time"].values
    kinds = _kinds(run)
    changes = {k: v - v[0] for k, v in kinds.items() if k in _STORED}
    done = {k: v for k, v in kinds.items() if k not in _STORED}
    _lines(stored, time, changes, "change of\nstored energy")
    _lines(works, time, done, "work done on\nthe arm so far")
    _balance(balance, time, changes, done)
    share_time([stored, works, balance], time)
    figure.align_ylabels([stored, works, balance])
    head(figure, run.title, run.status)
    return figure


def _kinds(run: Run) -> dict[str, Float[np.ndarray, " time"]]:
    if "energy" not in run.result or "kind" not in run.result.coords:
        return {}
    energy = run.result["energy"].transpose("time", "kind").values
    return {str(kind): energy[:, i] for i, kind in enumerate(run.result["kind"].values)}


def _lines(
    axes: Axes,
    time: Float[np.ndarray, " time"],
    lines: dict[str, Float[np.ndarray, " time"]],
    label: str,
) -> None:
    unit = si_unit(largest(*lines.values()), "J")
    axes.set_ylabel(f"{label} ({unit.name})")
    axes.axhline(0.0, color=GREY, linewidth=0.7)
    if not lines:
        note(axes, "no energy recorded")
        return
    for (kind, values), colour in zip(lines.items(), SERIES, strict=False):
        name = kind.replace("_", " ")
        if largest(values) == 0.0:
            continue
        axes.plot(time, values * unit.factor, color=colour, label=name, **line_style(time.size))
    zero = [kind.replace("_", " ") for kind, values in lines.items() if largest(values) == 0.0]
    if zero:
        axes.plot([], [], linestyle="none", label=f"zero: {', '.join(zero)}")
    key(axes, columns=6)


def _balance(
    axes: Axes,
    time: Float[np.ndarray, " time"],
    changes: dict[str, Float[np.ndarray, " time"]],
    done: dict[str, Float[np.ndarray, " time"]],
) -> None:
    scale = largest(*changes.values(), *done.values())
    axes.set_ylabel("balance defect")
    axes.axhline(0.0, color=GREY, linewidth=0.7)
    if not changes:
        note(axes, "no energy recorded")
        return
    defect = sum(changes.values(), np.zeros(time.shape)) - sum(done.values(), np.zeros(time.shape))
    if scale == 0.0:
        note(axes, "no energy changes hands")
        return
    relative = defect / scale
    worst = largest(relative)
    # The power of ten stands in the label: matplotlib would put it where the legend is.
    power = math.floor(math.log10(worst)) if worst > 0.0 else 0
    axes.set_ylabel(f"balance defect\n($10^{{{power}}}$ of scale)" if power else "balance defect")
    axes.plot(
        time,
        relative / 10.0**power,
        color=INK,
        label=f"change \N{MINUS SIGN} works, at most {worst:.1e} of the largest change or work, "
        f"{si_unit(scale, 'J').text(scale)}",
        **line_style(time.size),
    )
    key(axes)
