"""How well the tip keeps to its target."""

from __future__ import annotations

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from crinoid.report.run import Run
from crinoid.report.style import (
    BLUE,
    GREEN,
    GREY,
    INK,
    ORANGE,
    VERMILLION,
    WIDTH,
    head,
    key,
    line_style,
    note,
    share_time,
)
from crinoid.report.units import largest, length_unit, si_unit


def draw_tip_error(run: Run) -> Figure:
    """Draw the tip's error, its components, and the water's speed at the tip, over time."""
    figure = Figure(figsize=(WIDTH, 6.6), layout="constrained")
    error, parts, flow = figure.subplots(3, 1, sharex=True, height_ratios=[1.25, 1.25, 0.8])
    _error(error, run)
    _components(parts, run)
    _speed(flow, run.result)
    share_time([error, parts, flow], run.result["time"].values)
    head(figure, run.title, run.status)
    return figure


def _error(axes: Axes, run: Run) -> None:
    unit = length_unit(largest(*(data["tip_error"].values for _, data in run.members)))
    # The uncontrolled run lies behind: it is the background that control is judged against.
    for order, ((label, data), colour) in enumerate(
        zip(run.members, (BLUE, VERMILLION), strict=False)
    ):
        time, values = data["time"].values, data["tip_error"].values
        rms = float(np.sqrt(np.nanmean(values**2))) if np.isfinite(values).any() else np.nan
        name = f"{label}: " if label else ""
        axes.plot(
            time,
            values * unit.factor,
            color=colour,
            zorder=3 - order,
            label=f"{name}RMS {unit.text(rms)} (dashed), maximum {unit.text(largest(values))}",
            **line_style(time.size),
        )
        axes.axhline(rms * unit.factor, color=colour, linestyle=(0, (4, 2)), linewidth=1.0)
    top = max(axes.get_ylim()[1], 0.0) if largest(run.result["tip_error"].values) > 0 else 1.0
    axes.set_ylim(0.0, top)
    axes.set_ylabel(f"tip error ({unit.name})")
    key(axes, columns=1)


def _components(axes: Axes, run: Run) -> None:
    misses = [
        (label, data, data["tip_position"].values - data["tip_target"].values)
        for label, data in run.members
    ]
    unit = length_unit(largest(*(miss for _, _, miss in misses)))
    axes.axhline(0.0, color=GREY, linewidth=0.7)
    for label, data, miss in misses:
        behind = label == "without control"
        for part, (axis, colour) in enumerate((("x", GREEN), ("z", ORANGE))):
            axes.plot(
                data["time"].values,
                miss[:, part] * unit.factor,
                color=colour,
                alpha=0.45 if behind else 1.0,
                linewidth=1.0 if behind else 1.3,
                linestyle=(0, (3, 1.2)) if behind else "-",
                zorder=2 if behind else 3,
                label=f"{axis}, {label}" if label else axis,
                **line_style(data.sizes["time"]),
            )
    axes.set_ylabel(f"tip \N{MINUS SIGN} target ({unit.name})")
    key(axes, columns=2)


def _speed(axes: Axes, data: xr.Dataset) -> None:
    axes.set_ylabel("water speed\nat tip (m/s)")
    if "flow_velocity" not in data:
        note(axes, "no flow recorded")
        return
    speed = np.linalg.norm(data["flow_velocity"].isel(node=-1).values, axis=-1)
    if largest(speed) == 0.0:
        note(axes, "still water")
    unit = si_unit(1.0, "m/s")
    axes.plot(
        data["time"].values,
        speed,
        color=INK,
        label=f"mean {unit.text(float(np.nanmean(speed)))}",
        **line_style(speed.size),
    )
    axes.set_ylim(0.0, 1.08 * largest(speed) or 1.0)
    key(axes)
