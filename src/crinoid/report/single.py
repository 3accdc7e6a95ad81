"""The arm over time in one view, in axes that are given."""

from __future__ import annotations

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from crinoid.report.arm import draw_arm
from crinoid.report.current import draw_key, find_current
from crinoid.report.frame import in_best_frame, measured_from
from crinoid.report.run import Run
from crinoid.report.sheet import space_of, window
from crinoid.report.style import key
from crinoid.report.units import largest
from crinoid.report.view import View

_CORNER = 0.03
"""Room between the corner and the arrow that tells the water's speed, of the longer side."""


def draw_in(axes: Axes, data: xr.Dataset, view: View) -> None:
    """Draw a run in a parallel view."""
    run, about = in_best_frame(Run(data))
    current = find_current(run.result, view)
    low, high = window(space_of([run.result]), {view: [current]}, current.scale)
    (left, bottom), (right, top) = view.paper(low), view.paper(high)
    axes.set(xlim=(left, right), ylim=(bottom, top))
    axes.set_aspect("equal", adjustable="datalim")  # axes that are given keep their size
    across, up = measured_from(view, about)
    axes.set(xlabel=across, ylabel=up)
    draw_arm(axes, run.result, low, high, view)
    current.draw(axes, current.scale)
    if current.scale > 0.0:
        corner = np.array([right, top]) - _CORNER * max(right - left, top - bottom)
        draw_key(axes, corner, largest(current.instants), current.scale)
    for artist in (*axes.collections, *axes.texts):
        artist.set_in_layout(False)  # arrows are taken to be far too large by who lays out figures
    key(axes, columns=3)
