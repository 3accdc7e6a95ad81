"""Chart of an observer's estimate of tip and current, next to the true ones."""

import numpy as np
import xarray as xr
from jaxtyping import Float

from crinoid.results.errors import short_way
from crinoid.results.result import Result
from crinoid.results.units import DEGREES, Unit, largest, length_unit, si_unit
from crinoid.view.figures.charts.chart import Chart, Panel, Trace, rms

_WIDE = 2.0  # standard deviations from the estimate to the edge of the band

Series = Float[np.ndarray, " time"]


def estimate_chart(run: Result) -> Chart | None:
    """Return tip and current, true and estimated, with the band of two standard deviations.

    None where no observer estimated the tip.
    """
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
    for sign in (1, -1):
        edge = value - before + sign * _WIDE * std
        name = f"band: \N{PLUS-MINUS SIGN}{_WIDE:g} std"
        traces.append(Trace(name, at, edge, "faint", "dotted", quiet=sign < 0))
    return Panel(label.replace("\n", "_").replace(" ", "_"), label, unit, tuple(traces), columns=3)
