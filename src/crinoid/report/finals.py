"""The shapes that several runs end with, in one drawing."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from crinoid.report.arm import draw_thickness
from crinoid.report.obstacles import WALL
from crinoid.report.scene import solid_outline
from crinoid.report.sheet import LEFT, Block, fit, fit_scene, frame, space_of, window
from crinoid.report.solids import Body, corners, find_bodies
from crinoid.report.style import INK, PALE
from crinoid.report.view import SIDE, arm_length, in_space, outline

Colour = tuple[float, float, float, float]
Finals = Sequence[tuple[xr.Dataset, Colour]]
"""The last instant of each run, and its colour."""

TITLE = "final shapes, in the colours below"


def draw_finals(axes: Axes, finals: Finals) -> None:
    """Draw planar shapes in one panel."""
    obstacles: list[tuple[Body, Colour]] = []
    for data, colour in finals:
        bodies = find_bodies(data)
        obstacles += [(body, colour) for body in bodies]
        places = in_space(data, "position")[-1]
        shape = SIDE.paper(places)
        if "diameter" in data:
            band = outline(shape, np.asarray(data["diameter"].values, dtype=float))
            axes.fill(*band.T, color=PALE, zorder=1, alpha=0.6, linewidth=0)
        _draw_line(axes, shape, colour)
        axes.update_datalim(SIDE.paper(corners(bodies, places, arm_length(data))))
    if not axes.lines:
        axes.text(0.5, 0.5, "no case has a result", transform=axes.transAxes, ha="center")
    axes.autoscale_view()
    low, high = np.transpose([axes.get_xlim(), axes.get_ylim()])
    wide = 2 * (high - low)  # equal axes will show more on one side
    for body, colour in obstacles:
        cut = body.outline(-1, SIDE.lift(low - wide), SIDE.lift(high + wide), SIDE)
        axes.add_patch(Polygon(cut, closed=True, fill=False, edgecolor=colour, linewidth=0.8))
    axes.set_xlim(low[0], high[0], auto=None)  # limits that are fixed would be ignored, and say so
    axes.set_ylim(low[1], high[1], auto=None)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_title(TITLE, loc="left")
    axes.set_xlabel(SIDE.labels[0])
    axes.set_ylabel(SIDE.labels[1])


def lay_out(finals: Finals, wide: float) -> Block:
    """Find the sizes of the views of shapes in space on a page this wide (inches)."""
    low, high = _window(finals)
    return fit(high - low, wide - LEFT - 0.3, 6.0, 2.6)


def draw_finals_in_space(figure: Figure, finals: Finals, block: Block, foot: float) -> None:
    """Draw shapes in space in three projections and in perspective, from a foot (inches) up."""
    low, high = _window(finals)
    panels, corner = block.place(figure, LEFT, foot)
    for view, axes in panels.items():
        frame(axes, view, low, high, block.inch)
        for data, colour in finals:
            for body in find_bodies(data):
                if body.is_in(low, high, view):
                    field = body.solid.kind == "plane" and not body.shows_edge(view)
                    edge = Polygon(
                        body.outline(-1, low, high, view),
                        closed=True,
                        facecolor=WALL if field else "none",
                        edgecolor=colour,
                        linewidth=0.8,
                        zorder=0.2 if field else 1,
                    )
                    axes.add_patch(edge)
            if "diameter" in data:
                draw_thickness(axes, data, view)
            _draw_line(axes, view.project(data, "position")[-1], colour)
    scene = fit_scene(corner, low, high)
    for data, colour in finals:
        shape = in_space(data, "position")[-1]
        scene.add_line(shape, colour)
        _draw_ends(corner, scene.view.paper(shape), colour)
        for body in find_bodies(data):
            cut = solid_outline(body, low, high, scene.view)
            if len(cut):
                edge = Polygon(cut, closed=True, fill=False, edgecolor=colour, linewidth=0.8)
                corner.add_patch(edge)
    scene.draw()
    width, height = figure.get_size_inches()
    above = (foot + block.height + 0.26) / height
    figure.text(LEFT / width, above, TITLE, va="bottom", fontsize=9.5)


def _window(finals: Finals) -> tuple[np.ndarray, np.ndarray]:
    return window(space_of([data for data, _ in finals]), {}, 0.0)


def _draw_line(axes: Axes, shape: Float[np.ndarray, "node 2"], colour: Colour) -> None:
    axes.plot(*shape.T, color=colour, zorder=2)
    _draw_ends(axes, shape, colour)


def _draw_ends(axes: Axes, shape: Float[np.ndarray, "node 2"], colour: Colour) -> None:
    axes.plot(*shape[-1], marker="o", markersize=4, color=colour, zorder=3)
    axes.plot(*shape[0], marker="s", markersize=5, color=INK, zorder=3)
