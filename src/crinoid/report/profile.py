"""The velocity of a sampled current over height."""

import re

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from crinoid.report.flow import axes_of, title
from crinoid.report.style import AXIS_COLOURS, INK, PALE, WIDTH, head, key


def draw_profile(flow: xr.Dataset) -> Figure:
    """Draw mean and standard deviation of all components above and below the root."""
    names = axes_of(flow)
    figure = Figure(figsize=(WIDTH, 4.2 + 0.2 * len(names)), layout="constrained")
    panels = list(figure.subplots(1, len(names), sharey=True))
    height = flow["height"].values
    ends = flow["position"].sel(axis="z").values
    records = [name for name in flow.data_vars if re.fullmatch(r"record_\d+_mean", str(name))]
    for index, (axes, axis) in enumerate(zip(panels, names, strict=True)):
        mean = flow["profile_mean"].values[:, index]
        deviation = flow["profile_standard_deviation"].values[:, index]
        colour = AXIS_COLOURS[axis]
        axes.fill_betweenx(
            height,
            mean - deviation,
            mean + deviation,
            color=colour,
            alpha=0.25,
            linewidth=0,
            label="standard deviation",
        )
        axes.plot(mean, height, color=colour, label="mean")
        for name in records:
            levels = flow[str(name).replace("_mean", "_height")].values
            axes.plot(
                flow[name].values[:, index],
                levels,
                linestyle="none",
                marker="o",
                markersize=3.0,
                color=INK,
                label="as measured",
            )
        thick = 0.004 * float(np.ptp(height))
        low, high = float(ends.min()) - thick, float(ends.max()) + thick
        axes.axhspan(low, high, color=PALE, zorder=0, label="the arm at rest")
        axes.set_xlabel(f"velocity {axis} (m/s)")
        axes.margins(x=0.3)
        axes.locator_params(axis="x", nbins=12 // len(names))
        if np.ptp(axes.get_xlim()) < 1e-3:  # round-off is no profile
            middle = float(mean.mean())
            axes.set_xlim(middle - 0.05, middle + 0.05)
        key(axes, columns=2 if len(names) == 2 else 1)
    depth = flow.attrs.get("depth")
    if depth is not None:
        panels[0].set_ylim(-float(depth), max(0.0, float(height.max())))
    else:
        panels[0].set_ylim(float(height.min()), float(height.max()))
    panels[0].set_ylabel("z (m)")
    head(figure, title(flow), "ok")
    return figure
