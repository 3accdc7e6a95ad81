"""How well the tip keeps to its target."""

from __future__ import annotations

import numpy as np
import xarray as xr
from jaxtyping import Float

from crinoid.metrics import angle_between, short_way
from crinoid.report.charts.chart import MEMBER_ROLES, Chart, Level, Panel, Trace, rms
from crinoid.report.run import Run
from crinoid.report.units import DEGREES, Unit, largest, length_unit, si_unit
from crinoid.space import AXES

_ROOM = 1.08  # of an axis, above the largest value


def tip_chart(run: Run) -> Chart:
    """Return errors of the tip's position and direction, and the water's speed at the tip.

    In space also where the tip points.
    """
    spatial = "tip_direction" in run.result
    panels = [_error(run), _components(run)]
    panels += [_direction(run.result)] if spatial else []
    return Chart("tip_error", "Tip", (*panels, _off_direction(run), _speed(run.result)))


def _error(run: Run) -> Panel:
    unit = length_unit(largest(*(data["tip_error"].values for _, data in run.members)))
    traces, levels = [], []
    # The uncontrolled run lies behind: it is the background that control is judged against.
    for (label, data), role in zip(run.members, MEMBER_ROLES, strict=False):
        values = data["tip_error"].values
        told = f"RMS {unit.text(rms(values))} (dashed), maximum {unit.text(largest(values))}"
        behind = role == "free"
        traces.append(Trace(label, _time(data), values, role, behind=behind, told=told))
        levels.append(Level(rms(values), role, "dashed", of=f"RMS {label}".strip()))
    high = None if largest(run.result["tip_error"].values) > 0 else 1.0 / unit.factor
    return Panel(
        "tip_error",
        "tip error",
        unit,
        tuple(traces),
        tuple(levels),
        low=0.0,
        high=high,
        tall=2.25,
        columns=1,
    )


def _components(run: Run) -> Panel:
    misses = [
        (label, data, data["tip_position"].values - data["tip_target"].values)
        for label, data in run.members
    ]
    unit = length_unit(largest(*(miss for _, _, miss in misses)))
    traces = [
        Trace(
            f"{axis}, {label}" if label else axis,
            _time(data),
            miss[:, part],
            axis,
            behind=label == "without control",
        )
        for label, data, miss in misses
        for part, axis in enumerate(map(str, data["axis"].values))
    ]
    columns = 2 if len(misses) > 1 else len(AXES[3])
    return Panel(
        "tip_miss",
        "tip \N{MINUS SIGN} target",
        unit,
        tuple(traces),
        (Level(0.0, "faint"),),
        tall=2.25,
        columns=columns,
    )


def _direction(data: xr.Dataset) -> Panel:
    """Return the parts of the unit vector along which the tip points."""
    aimed, traces = "tip_direction_target" in data, []
    for axis in AXES[3]:
        part = data["tip_direction"].sel(axis=axis).values
        traces.append(Trace(axis, _time(data), part, axis))
        if aimed:
            wanted = data["tip_direction_target"].sel(axis=axis).values
            words = f"{axis}, where it should"
            traces.append(Trace(words, _time(data), wanted, axis, "dashed", quiet=True))
    return Panel(
        "tip_direction",
        "tip direction",
        None,
        tuple(traces),
        (Level(0.0, "faint"),),
        low=-_ROOM,
        high=_ROOM,
        tall=2.0,
        also=(("where it should", "dashed"),) if aimed else (),
    )


def _off_direction(run: Run) -> Panel:
    """Return the angle between where the tip points and where it should."""
    traces = []
    for (label, data), role in zip(run.members, MEMBER_ROLES, strict=False):
        off = off_direction(data)
        if off is not None:
            told = f"RMS {DEGREES.text(rms(off))}, maximum {DEGREES.text(largest(off))}"
            behind = role == "free"
            traces.append(Trace(label, _time(data), off, role, behind=behind, told=told))
    top = largest(*(trace.values for trace in traces))
    return Panel(
        "tip_off_direction",
        "tip off\ndirection",
        DEGREES,
        tuple(traces),
        low=0.0,
        high=_ROOM * top or 1.0 / DEGREES.factor,
        tall=1.8,
        columns=1,
        nothing="" if traces else "no direction recorded",
    )


def off_direction(data: xr.Dataset) -> Float[np.ndarray, " time"] | None:
    """Return the angle (rad) between where the tip points and where it should, if that is known."""
    if {"tip_direction", "tip_direction_target"} <= set(data):
        return angle_between(data["tip_direction"].values, data["tip_direction_target"].values)
    if {"tip_angle", "tip_angle_target"} <= set(data):
        return np.abs(short_way(data["tip_angle"].values - data["tip_angle_target"].values))
    return None


def _speed(data: xr.Dataset) -> Panel:
    label, unit = "water speed\nat tip", Unit(1.0, "m/s")
    if "flow_velocity" not in data:
        return Panel("tip_water", label, unit, tall=1.45, nothing="no flow recorded")
    speed = np.linalg.norm(data["flow_velocity"].isel(node=-1).values, axis=-1)
    top = largest(speed)
    told = f"mean {si_unit(1.0, 'm/s').text(float(np.nanmean(speed)))}"
    return Panel(
        "tip_water",
        label,
        unit,
        (Trace("", _time(data), speed, "ink", told=told),),
        low=0.0,
        high=_ROOM * top or 1.0,
        tall=1.45,
        nothing="" if top else "still water",
    )


def _time(data: xr.Dataset) -> Float[np.ndarray, " time"]:
    return np.asarray(data["time"].values, float)
