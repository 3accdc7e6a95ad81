"""The arm over time in one view, in axes that are given."""

from __future__ import annotations

import numpy as np
import xarray as xr
from jaxtyping import Int
from matplotlib.axes import Axes

from crinoid.report.arm import draw_arm
from crinoid.report.current import draw_key, find_current
from crinoid.report.frame import in_best_frame, measured_from
from crinoid.report.run import Run
from crinoid.report.sheet import space_of, window
from crinoid.report.style import key_within
from crinoid.report.units import largest
from crinoid.report.view import View

_CORNER = 0.03
"""Room between the corner and the arrow that tells the water's speed, of the longer side."""


def draw_in(
    axes: Axes, data: xr.Dataset, view: View, chosen: Int[np.ndarray, " shape"] | None, legend: bool
) -> None:
    """Draw a run in a parallel view, with the arm's shape at chosen records."""
    run, about = in_best_frame(Run(data))
    current = find_current(run.result, view)
    low, high = window(space_of([run.result]), {view: [current]}, current.scale)
    (left, bottom), (right, top) = view.paper(low), view.paper(high)
    across, up = measured_from(view, about)
    axes.set(xlabel=across, ylabel=up)
    draw_arm(axes, run.result, low, high, view, chosen)
    current.draw(axes, current.scale)
    if current.scale > 0.0:
        corner = np.array([right, top]) - _CORNER * max(right - left, top - bottom)
        draw_key(axes, corner, largest(current.instants), current.scale)
    for artist in (*axes.collections, *axes.texts):
        artist.set_in_layout(False)  # arrows are taken to be far too large by who lays out figures
    # the window has room for the legend at its top, and the shape of the axes that are given
    room, shape = key_within(axes) if legend else 0.0, axes.bbox.width / axes.bbox.height
    wide, tall = right - left, (top - bottom) / (1.0 - room)
    aside, above = max(0.0, tall * shape - wide), max(0.0, wide / shape - tall)
    axes.set(xlim=(left - aside / 2, right + aside / 2))
    axes.set(ylim=(bottom - above / 2, bottom + tall + above / 2))
    axes.set_aspect("equal", adjustable="box")  # "datalim" refuses axes that share both
