"""Figure of an estimate from a log: tip and current with their bands, and the innovations."""

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from crinoid.results.units import DEGREES, largest, length_unit, si_unit
from crinoid.view.figures.style import BLUE, GREY, INK, SERIES, WIDTH, head_of, key, share_time

_WIDE = 2.0  # standard deviations from the estimate to the edge of the band


def draw_estimate(data: xr.Dataset) -> Figure:
    """Draw tip and current with the band of two standard deviations, readings and innovations."""
    axes_of = [str(axis) for axis in data["axis"].values]
    rows = [(f"tip {axis}", "estimated_tip_position", axis, f"tip.{axis}") for axis in axes_of]
    if "estimated_tip_angle" in data:
        rows.append(("tip angle", "estimated_tip_angle", "", "tip.angle"))
    rows += [(f"mean current\n{axis}", "estimated_flow_velocity", axis, "") for axis in axes_of]
    figure = Figure(figsize=(WIDTH, 0.9 + 1.6 * (len(rows) + 1)), layout="constrained")
    panels = list(figure.subplots(len(rows) + 1, 1, sharex=True))
    time = data["time"].values
    for axes, (label, name, axis, reading) in zip(panels, rows, strict=False):
        value, std = (
            data[each].sel(axis=axis).values if axis else data[each].values
            for each in (name, f"{name}_std")
        )
        size = largest(value, std)
        unit = DEGREES if name.endswith("angle") else length_unit(size)
        unit = si_unit(size, "m/s") if name.endswith("velocity") else unit
        low, high = (unit.factor * (value + sign * _WIDE * std) for sign in (-1, 1))
        if reading in data["reading"].values:
            measured = unit.factor * data["sensor_reading"].sel(reading=reading).values
            if name.endswith("angle"):
                turns = np.round((measured - unit.factor * value) / 360.0)
                measured = measured - 360.0 * turns
            axes.plot(time, measured, ".", color=GREY, markersize=2.0, label="reading")
        axes.plot(time, unit.factor * value, "-", color=BLUE, label="estimated")
        axes.fill_between(
            time, low, high, color=BLUE, alpha=0.2, linewidth=0, label=f"±{_WIDE:g} std"
        )
        # a wide prior at the start leaves the rest of the panel visible
        settled = slice(time.size // 10, None)
        edges = np.concatenate([low[settled], high[settled]])
        room = 0.15 * max(np.ptp(edges), 1e-9 * max(np.abs(edges).max(), 1e-3))
        axes.set_ylim(edges.min() - room, edges.max() + room)
        axes.set_ylabel(f"{label} ({unit.name})")
    key(panels[0], columns=3)
    last = panels[-1]
    for index, name in enumerate(map(str, data["reading"].values)):
        over = (data["innovation"] / data["innovation_std"]).isel(reading=index).values
        colour = SERIES[index % len(SERIES)]
        last.plot(time, over, ".", color=colour, markersize=2.0, label=name)
    for level in (-_WIDE, _WIDE):
        last.axhline(level, color=INK, linewidth=0.8)
    last.set_ylabel("innovation\n(std)")
    share = 100 * data.attrs["within_two_std"]
    last.set_title(f"{share:.1f} % within ±{_WIDE:g} std", loc="right", fontsize=8.5)
    if data.sizes["reading"] <= len(SERIES):
        key(last, columns=4)
    share_time(panels, time)
    figure.align_ylabels(panels)
    head_of(figure, data)
    return figure
