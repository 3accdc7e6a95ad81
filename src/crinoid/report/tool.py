"""The tool at the tip in a figure: a ball of its volume about its centre of mass, on a stem."""

from __future__ import annotations

import numpy as np
import xarray as xr
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.patches import Polygon

from crinoid.report.charts.tool import ball, held
from crinoid.report.style import INK, PURPLE
from crinoid.report.surface import Facets, perpendicular, turned_body
from crinoid.report.view import View, convex_outline, in_space

_STEM = 0.2  # radius of the stem over that of the ball


def surface(data: xr.Dataset) -> Facets:
    """Facets of the tool at the last record that has it; none where none does."""
    records = np.flatnonzero(held(data))
    if not records.size:
        return np.empty((0, 4, 3))
    radius, offset = ball(data)
    before, tip = in_space(data, "position")[records[-1], -2:]
    ahead = (tip - before) / np.linalg.norm(tip - before)
    turn = np.linspace(0.0, np.pi, 25)
    along, around = offset - radius * np.cos(turn), radius * np.sin(turn)
    if offset > radius:
        round_part = (around > _STEM * radius) | (along > offset)
        along = np.concatenate([[0.0], along[round_part]])
        around = np.concatenate([[_STEM * radius], around[round_part]])
    return turned_body(tip, ahead, along, around, perpendicular(ahead))


def points(data: xr.Dataset) -> Float[np.ndarray, "point axis=3"]:
    """Points of space that a window must hold to show the tool."""
    return surface(data).reshape(-1, 3)


def draw_tool(axes: Axes, data: xr.Dataset, view: View) -> None:
    """Draw the tool at the end, or where it was let go."""
    facets = surface(data)
    if not len(facets):
        return
    at_the_end = bool(held(data)[-1])
    shape = Polygon(convex_outline(view.paper(facets).reshape(-1, 2)), closed=True)
    shape.set(facecolor=PURPLE if at_the_end else "none", edgecolor=INK, linewidth=0.6, zorder=2.5)
    shape.set_label("tool" if at_the_end else "tool, where it was let go")
    axes.add_patch(shape)
