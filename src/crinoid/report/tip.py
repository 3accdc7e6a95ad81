"""How well the tip keeps to its target."""

from __future__ import annotations

import numpy as np
import xarray as xr
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from crinoid.metrics import angle_between, short_way
from crinoid.report.run import Run
from crinoid.report.style import (
    AXIS_COLOURS,
    BLUE,
    GREY,
    INK,
    VERMILLION,
    WIDTH,
    head,
    key,
    line_style,
    note,
    share_time,
)
from crinoid.report.units import DEGREES, largest, length_unit, si_unit


def draw_tip_error(run: Run) -> Figure:
    """Draw the errors of the tip's position and direction, and the water's speed at the tip.

    In space also where the tip points.
    """
    spatial = "tip_direction" in run.result
    ratios = [1.25, 1.25, *([1.1] if spatial else []), 1.0, 0.8]
    figure = Figure(figsize=(WIDTH, 9.6 if spatial else 8.2), layout="constrained")
    panels = list(figure.subplots(len(ratios), 1, sharex=True, height_ratios=ratios))
    _error(panels[0], run)
    _components(panels[1], run)
    if spatial:
        _direction(panels[2], run.result)
    _off_direction(panels[-2], run)
    _speed(panels[-1], run.result)
    share_time(panels, run.result["time"].values)
    figure.align_ylabels(panels)
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
        for part, axis in enumerate(map(str, data["axis"].values)):
            axes.plot(
                data["time"].values,
                miss[:, part] * unit.factor,
                color=AXIS_COLOURS[axis],
                alpha=0.45 if behind else 1.0,
                linewidth=1.0 if behind else 1.3,
                linestyle=(0, (3, 1.2)) if behind else "-",
                zorder=2 if behind else 3,
                label=f"{axis}, {label}" if label else axis,
                **line_style(data.sizes["time"]),
            )
    axes.set_ylabel(f"tip \N{MINUS SIGN} target ({unit.name})")
    key(axes, columns=2 if len(misses) > 1 else len(AXIS_COLOURS))


def _direction(axes: Axes, data: xr.Dataset) -> None:
    """Draw the parts of the unit vector along which the tip points."""
    time = data["time"].values
    axes.axhline(0.0, color=GREY, linewidth=0.7)
    for axis, colour in AXIS_COLOURS.items():
        part = data["tip_direction"].sel(axis=axis).values
        axes.plot(time, part, color=colour, label=axis, **line_style(time.size))
        if "tip_direction_target" in data:
            target = data["tip_direction_target"].sel(axis=axis).values
            axes.plot(time, target, color=colour, linestyle=(0, (4, 2)), linewidth=1.0, alpha=0.8)
    if "tip_direction_target" in data:
        axes.plot([], [], color=INK, linestyle=(0, (4, 2)), linewidth=1.0, label="where it should")
    axes.set_ylim(-1.08, 1.08)
    axes.set_ylabel("tip direction")
    key(axes)


def _off_direction(axes: Axes, run: Run) -> None:
    """Draw the angle between where the tip points and where it should."""
    axes.set_ylabel("tip off\ndirection (deg)")
    top = 0.0
    for order, ((label, data), colour) in enumerate(
        zip(run.members, (BLUE, VERMILLION), strict=False)
    ):
        off = off_direction(data)
        if off is None:
            continue
        rms = float(np.sqrt(np.nanmean(off**2)))
        axes.plot(
            data["time"].values,
            off * DEGREES.factor,
            color=colour,
            zorder=3 - order,
            label=f"{label + ': ' if label else ''}RMS {DEGREES.text(rms)}, "
            f"maximum {DEGREES.text(largest(off))}",
            **line_style(off.size),
        )
        top = max(top, largest(off) * DEGREES.factor)
    if not axes.lines:
        note(axes, "no direction recorded")
    axes.set_ylim(0.0, 1.08 * top or 1.0)
    key(axes, columns=1)


def off_direction(data: xr.Dataset) -> Float[np.ndarray, " time"] | None:
    """Return the angle (rad) between where the tip points and where it should, if that is known."""
    if {"tip_direction", "tip_direction_target"} <= set(data):
        return angle_between(data["tip_direction"].values, data["tip_direction_target"].values)
    if {"tip_angle", "tip_angle_target"} <= set(data):
        return np.abs(short_way(data["tip_angle"].values - data["tip_angle_target"].values))
    return None


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
