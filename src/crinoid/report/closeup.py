"""The tip close up: its path about the target, at the scale of its error, and how fast it errs."""

from __future__ import annotations

import numpy as np
import xarray as xr
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from crinoid.report.charts.spectrum import miss, spectrum_panel
from crinoid.report.paper import draw_panel
from crinoid.report.run import Run
from crinoid.report.style import (
    GREY,
    INK,
    VERMILLION,
    WIDTH,
    head,
    key_below,
    time_map,
    time_norm,
)
from crinoid.report.units import largest, length_unit
from crinoid.report.view import ABOVE, AHEAD, SIDE, View, is_spatial


def draw_close_up(run: Run) -> Figure:
    """Draw the tip's path about its target, each run at its own scale, and the error's spectrum."""
    views = (ABOVE, SIDE, AHEAD) if is_spatial(run.result) else (SIDE,)
    members = run.members
    # planar runs beside each other, those in space below each other
    shape = (len(members), len(views)) if len(views) > 1 else (1, len(members))
    high = 2.5 * shape[0] if max(shape) > 1 else 4.2
    figure = Figure(figsize=(WIDTH, 3.7 + high), layout="constrained")
    rows = figure.add_gridspec(2, 1, height_ratios=[high, 2.6])
    panels = rows[0].subgridspec(*shape).subplots(squeeze=False).reshape(len(members), len(views))
    misses = [miss(data) for _, data in members]
    # each at its own scale, and the smaller window shown in the larger one
    halves = [1.1 * (largest(each) or 5e-4) for each in misses]
    for some, (label, data), off, half in zip(panels, members, misses, halves, strict=True):
        for axes, view in zip(some, views, strict=True):
            _path(axes, data, view, off, half)
            if half > halves[0]:
                unit = length_unit(half)
                corner, wide = -halves[0] * unit.factor, 2 * halves[0] * unit.factor
                window = Rectangle((corner, corner), wide, wide, fill=False, edgecolor=INK)
                window.set(zorder=4, label="window with control")
                axes.add_patch(window)
        words = f"{label}: RMS {_rms_text(off, half)}" if label else f"RMS {_rms_text(off, half)}"
        some[0].set_title(words, loc="left")
    time = run.result["time"].values
    if time[-1] > time[0]:
        times = ScalarMappable(time_norm(run.result), time_map())
        bar = figure.colorbar(times, ax=panels, label="time (s)", aspect=25)
        bar.ax.grid(visible=False)
    spectrum = figure.add_subplot(rows[1])
    draw_panel(spectrum, spectrum_panel(run))
    spectrum.set_xlabel("frequency (Hz)")
    key_below(figure, panels.flat, "outside lower center")
    head(figure, run.title, run.status)
    return figure


def _rms_text(off: Float[np.ndarray, "time axis=3"], half: float) -> str:
    return length_unit(half).text(float(np.sqrt(np.nanmean(np.sum(off**2, axis=1)))))


def _path(
    axes: Axes, data: xr.Dataset, view: View, off: Float[np.ndarray, "time axis=3"], half: float
) -> None:
    unit = length_unit(half)
    points, time = view.paper(off) * unit.factor, data["time"].values
    axes.axhline(0.0, color=GREY, linewidth=0.7)
    axes.axvline(0.0, color=GREY, linewidth=0.7)
    pieces = np.stack([points[:-1], points[1:]], axis=1)
    line = LineCollection(
        list(pieces), array=time[1:], cmap=time_map(), norm=time_norm(data), linewidths=0.9
    )
    axes.add_collection(line, autolim=False)
    axes.plot(*points[-1], "o", color=VERMILLION, markersize=4, zorder=5, label="tip at the end")
    axes.plot(0.0, 0.0, "o", markersize=8.5, mfc="none", mec=INK, mew=1.2, zorder=5, label="target")
    limit = half * unit.factor
    axes.set(xlim=(-limit, limit), ylim=(-limit, limit), aspect="equal")
    across, up = (label.split()[0] for label in view.labels)
    axes.set_xlabel(f"{across} \N{MINUS SIGN} target ({unit.name})")
    axes.set_ylabel(f"{up} \N{MINUS SIGN} target ({unit.name})")
