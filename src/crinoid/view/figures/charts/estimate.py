"""Charts of an observer's estimate of tip and current, from a run and from a log."""

from dataclasses import replace

import numpy as np
import xarray as xr

from crinoid.results.errors import short_way
from crinoid.results.result import Result
from crinoid.results.units import DEGREES, Unit, largest, length_unit, si_unit
from crinoid.view.figures.charts.chart import Chart, Level, Panel, Series, Trace, rms

_WIDE = 2.0  # standard deviations from the estimate to the edge of the band
_NAMED = 8  # most readings that have different colours, and names in the key


def estimate_chart(run: Result) -> Chart | None:
    """Return tip and current, true and estimated; None where no observer estimated the tip."""
    data, panels = run.dataset, []
    found = data.get("estimated_tip_position")
    if found is None or not np.isfinite(found.values).any():
        return None
    for axis in map(str, data["axis"].values):
        true, target = (data[name].sel(axis=axis).values for name in ("tip_position", "tip_target"))
        part = _part(data, "estimated_tip_position", axis)
        unit = length_unit(largest(true - target))
        panels.append(_panel(data, f"tip {axis}\n\N{MINUS SIGN} target", unit, true, part, target))
    if {"estimated_tip_angle", "tip_angle_target"} <= set(data):
        names = "tip_angle", "tip_angle_target"
        true, target = (data[name].values for name in names)
        turns = true - target - short_way(true - target)
        part = _part(data, "estimated_tip_angle")
        label = "tip angle\n\N{MINUS SIGN} target"
        panels.append(_panel(data, label, DEGREES, true, part, target + turns))
    if {"estimated_flow_velocity", "flow_velocity"} <= set(data):
        nodes = data["flow_velocity"].values
        mean = np.mean((nodes[:, 1:] + nodes[:, :-1]) / 2, axis=1)
        unit = si_unit(largest(mean), "m/s")
        for axis, true in zip(map(str, data["axis"].values), mean.T, strict=True):
            part = _part(data, "estimated_flow_velocity", axis)
            panels.append(_panel(data, f"mean current\n{axis}", unit, true, part))
    return Chart("estimate", "Estimate", tuple(panels))


def _part(data: xr.Dataset, name: str, axis: str = "") -> tuple[Series, Series]:
    """Return an estimate and its standard deviation."""
    value, std = (data[each] for each in (name, f"{name}_std"))
    if axis:
        value, std = value.sel(axis=axis), std.sel(axis=axis)
    return value.values, std.values


def _panel(
    data: xr.Dataset,
    label: str,
    unit: Unit,
    true: Series,
    estimate: tuple[Series, Series],
    origin: Series | float = 0.0,
) -> Panel:
    """Return a panel of a quantity (SI), less that of an ``origin``."""
    time, given = data["time"].values, data["estimate_time"].values
    known = np.flatnonzero(np.isfinite(given))
    # an estimate lasts until the next one
    known = known[np.unique(given[known], return_index=True)[1]]
    at, (value, std) = given[known], (each[known] for each in estimate)
    before = np.interp(at, time, np.broadcast_to(origin, time.shape))
    error = value - np.interp(at, time, true)
    within = np.mean(np.abs(error) <= _WIDE * std)
    words = f"RMS error {unit.text(rms(error))}, {100 * within:.3g} % within the band"
    traces = [
        Trace("true", time, true - origin, "ink"),
        Trace("estimated", at, value - before, "run", summary=words),
    ]
    return _framed(label, unit, [*traces, *_band(at, value - before, std)])


def _band(at: Series, value: Series, std: Series) -> list[Trace]:
    name = f"band: \N{PLUS-MINUS SIGN}{_WIDE:g} std"
    edges = ((sign < 0, value + sign * _WIDE * std) for sign in (1, -1))
    return [Trace(name, at, edge, "faint", "dotted", quiet=quiet) for quiet, edge in edges]


def _framed(label: str, unit: Unit, traces: list[Trace]) -> Panel:
    return Panel(label.replace("\n", "_").replace(" ", "_"), label, unit, tuple(traces), columns=3)


def log_chart(data: xr.Dataset) -> Chart:
    """Return the estimate from a log: tip and current with readings, and the innovations."""
    time, readings = data["time"].values, [str(name) for name in data["reading"].values]
    axes, panels = [str(axis) for axis in data["axis"].values], []
    rows = [(f"tip {axis}", "estimated_tip_position", axis) for axis in axes]
    rows += [("tip angle", "estimated_tip_angle", "")] * ("estimated_tip_angle" in data)
    rows += [(f"mean current\n{axis}", "estimated_flow_velocity", axis) for axis in axes]
    for label, name, axis in rows:
        value, std = _part(data, name, axis)
        size, reading, traces = largest(value, std), label.replace(" ", "."), []
        unit = length_unit(size) if axis else DEGREES
        unit = si_unit(size, "m/s") if name.endswith("velocity") else unit
        if reading in readings:
            measured = data["sensor_reading"].sel(reading=reading).values
            measured = measured if axis else value + short_way(measured - value)
            traces.append(Trace("reading", time, measured, "ink", "points"))
        traces += [Trace("estimated", time, value, "run"), *_band(time, value, std)]
        # a wide prior at the start leaves the rest of the panel visible
        edges = np.concatenate([each.values[time.size // 10 :] for each in traces[-2:]])
        room = 0.15 * max(np.ptp(edges), 1e-9 * max(largest(edges), 1e-3))
        low, high = float(edges.min()) - room, float(edges.max()) + room
        panels.append(replace(_framed(label, unit, traces), low=low, high=high))
    over = (data["innovation"] / data["innovation_std"]).transpose("reading", "time").values
    points = tuple(
        Trace(name, time, each, f"series {index}", "points", quiet=len(readings) > _NAMED)
        for index, (name, each) in enumerate(zip(readings, over, strict=True))
    )
    share = f"{100 * data.attrs['within_two_std']:.1f} % within \N{PLUS-MINUS SIGN}{_WIDE:g} std"
    ends = tuple(Level(edge, "ink") for edge in (-_WIDE, _WIDE))
    panels.append(Panel("innovation", "innovation\n(std)", None, points, ends, left_out=share))
    return Chart("log_estimate", "", tuple(panels))
