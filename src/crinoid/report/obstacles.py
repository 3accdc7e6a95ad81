"""The obstacles beside the arm as they look in a view."""

from __future__ import annotations

import numpy as np
import xarray as xr
from jaxtyping import Float, Int
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.patches import Polygon

from crinoid.report.solids import Body, Point, find_bodies
from crinoid.report.style import GREY, INK, time_map, time_norm
from crinoid.report.view import View, in_space

SOLID = "#C9C2B8"
WALL = "#F1EEEA"


def draw_bodies(
    axes: Axes,
    data: xr.Dataset,
    chosen: Int[np.ndarray, " shape"],
    low: Point,
    high: Point,
    view: View,
) -> None:
    """Draw obstacles at the end, and those that move at the chosen records too, in a window."""
    bodies, arm = find_bodies(data), in_space(data, "position")[-1]
    colours = time_map()(time_norm(data)(data["time"].values[chosen]))
    round_too = any(body.solid.kind != "plane" for body in bodies)  # rather in the key than a wall
    label = "obstacle at the end" if any(body.moves for body in bodies) else "obstacle"
    window = view.paper(np.stack([low, high]))
    for body in bodies:
        if not body.is_in(low, high, view):
            continue
        wall = body.solid.kind == "plane"
        edge_on = wall and body.shows_edge(view)
        order = 1.2  # the arm's is 1
        if wall and not edge_on:
            order = 0.2
        elif not wall and body.is_behind(arm, view):
            order = 0.95
        outline = body.outline(-1, low, high, view)
        shows = outline.size and np.all((outline.min(0) < window[1]) & (outline.max(0) > window[0]))
        solid = Polygon(
            outline,
            closed=True,
            facecolor=WALL if wall else SOLID,
            edgecolor=GREY if wall else INK,
            hatch="////" if edge_on else None,
            linewidth=0.8,
            zorder=order,
            label=None if (wall and round_too) or not shows else label,
        )
        axes.add_patch(solid)
        if body.moves and (edge_on or not wall):
            outlines = [body.outline(int(record), low, high, view) for record in chosen]
            draw_earlier(axes, outlines, colours)
            axes.plot(
                *view.paper(body.path).T,
                color=INK,
                linewidth=0.8,
                linestyle=(0, (1, 1.5)),
                zorder=3.2,
                label="path of an obstacle",
            )
        if len(bodies) > 1:
            _write_name(axes, body, low, high, view)


def draw_earlier(
    axes: Axes, outlines: list[Float[np.ndarray, "_ 2"]], colours: Float[np.ndarray, "shape 4"]
) -> None:
    """Draw where an obstacle was before, in the colours of the times."""
    shapes = PolyCollection(
        outlines,
        facecolors="none",
        edgecolors=colours,
        linewidths=0.6,
        alpha=0.55,
        zorder=1.4,
        label="obstacle over time",
    )
    axes.add_collection(shapes, autolim=False)


def _write_name(axes: Axes, body: Body, low: Point, high: Point, view: View) -> None:
    """Write an obstacle's number on it, within the window."""
    window = view.paper(np.stack([low, high]))
    inset = 0.025 * float(np.linalg.norm(window[1] - window[0]))
    if body.solid.kind == "plane" and not body.shows_edge(view):
        seen = np.clip(body.outline(-1, low, high, view), *window)
        if not seen.size:
            return
        at = seen[np.argmax(seen @ [1.0, -1.0])] + 1.5 * inset * np.array([-1.0, 1.0])
    else:
        place = body.path[-1]
        wall = body.solid.kind == "plane"
        if wall or np.any((view.paper(place) < window[0]) | (view.paper(place) > window[1])):
            place = body.nearest(-1, (low + high) / 2)
        at = view.paper(place) - (inset * view.paper(body.solid.out) if wall else 0.0)
    axes.annotate(
        body.name,
        (float(at[0]), float(at[1])),
        ha="center",
        va="center",
        fontsize=7.5,
        annotation_clip=True,
        bbox={"boxstyle": "round,pad=0.12", "facecolor": "white", "linewidth": 0},
        zorder=6,
    )
