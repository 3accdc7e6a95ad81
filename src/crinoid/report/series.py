"""The velocity of a sampled current over time."""

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from crinoid.report.flow import axes_of, differ, late, title
from crinoid.report.style import AXIS_COLOURS, GREY, INK, WIDTH, head, key, share_time


def draw_series(flow: xr.Dataset) -> Figure:
    """Draw all components and the speed over time, at the tip and behind it at the root."""
    names = axes_of(flow)
    rows = len(names) + 1
    figure = Figure(figsize=(WIDTH, 0.4 + 2.0 * rows), layout="constrained")
    panels = list(figure.subplots(rows, 1, sharex=True))
    time = flow["time"].values
    velocity, settled = flow["flow_velocity"].values, late(flow)
    apart = differ(flow)
    speed = np.linalg.norm(velocity, axis=2)
    place = "tip" if apart else "root and tip"
    lines = [
        *((axis, velocity[..., index], settled[..., index]) for index, axis in enumerate(names)),
        ("speed", speed, np.linalg.norm(settled, axis=2)),
    ]
    for axes, (name, values, steady) in zip(panels, lines, strict=True):
        colour = AXIS_COLOURS.get(name, INK)
        mean, deviation = steady[:, 1].mean(), steady[:, 1].std()
        label = f"{place}: mean {mean:.3g} (dashed), standard deviation {deviation:.2g} m/s"
        axes.plot(time, values[:, 1], color=colour, linewidth=0.9, zorder=3, label=label)
        axes.axhline(mean, color=colour, linestyle=(0, (4, 2)), linewidth=0.9, zorder=4)
        if apart:
            axes.plot(time, values[:, 0], color=GREY, linewidth=0.9, zorder=2, label="root")
        axes.set_ylabel(f"{name} (m/s)" if name == "speed" else f"velocity {name} (m/s)")
        key(axes)
    panels[-1].set_ylim(bottom=0.0)
    share_time(panels, time)
    figure.align_ylabels(panels)
    head(figure, title(flow), "ok")
    return figure
