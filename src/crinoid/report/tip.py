"""How well the tip keeps to its target."""

from __future__ import annotations

import numpy as np
import xarray as xr
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

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
from crinoid.report.units import Unit, largest, length_unit, si_unit


def draw_tip_error(run: Run) -> Figure:
    """Draw the tip's error, its components, and the water's speed at the tip, over time.

    In space also where the tip points, and how far that is from where it should.
    """
    pointing = "tip_direction" in run.result
    ratios = [1.25, 1.25, *([1.1, 1.0] if pointing else []), 0.8]
    figure = Figure(figsize=(WIDTH, 9.6 if pointing else 6.6), layout="constrained")
    panels = list(figure.subplots(len(ratios), 1, sharex=True, height_ratios=ratios))
    _error(panels[0], run)
    _components(panels[1], run)
    if pointing:
        _direction(panels[2], run.result)
        _off_direction(panels[3], run)
    _speed(panels[-1], run.result)
    share_time(panels, run.result["time"].values)
    if pointing:
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
    degrees, top = Unit(180.0 / np.pi, "deg"), 0.0
    for order, ((label, data), colour) in enumerate(
        zip(run.members, (BLUE, VERMILLION), strict=False)
    ):
        if not {"tip_direction", "tip_direction_target"} <= set(data):
            continue
        off = angle_between(data["tip_direction"].values, data["tip_direction_target"].values)
        axes.plot(
            data["time"].values,
            off * degrees.factor,
            color=colour,
            zorder=3 - order,
            label=f"{label + ': ' if label else ''}maximum {degrees.text(largest(off))}",
            **line_style(off.size),
        )
        top = max(top, largest(off) * degrees.factor)
    axes.set_ylim(0.0, 1.08 * top or 1.0)
    key(axes)


def angle_between(
    one: Float[np.ndarray, "time axis=3"], other: Float[np.ndarray, "time axis=3"]
) -> Float[np.ndarray, " time"]:
    """Angle between directions (rad), exact also where it is small."""
    sine = np.linalg.norm(np.cross(one, other), axis=1)
    return np.asarray(np.arctan2(sine, np.sum(one * other, axis=1)))


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
