"""The arm in a view: its shape over time, its tip's path, the target, and the hull behind it."""

from __future__ import annotations

import numpy as np
import xarray as xr
from jaxtyping import Float, Int
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.patches import Polygon

from crinoid.report.obstacles import draw_bodies
from crinoid.report.run import base_direction
from crinoid.report.solids import Point, corners, find_bodies
from crinoid.report.style import GREY, INK, PALE, VERMILLION, time_map, time_norm
from crinoid.report.surface import Facets, perpendicular, tube, turned_body
from crinoid.report.tool import draw_tool
from crinoid.report.tool import points as points_of_tool
from crinoid.report.view import View, arm_length, convex_outline, in_space, is_spatial, outline

_SHAPES = 25  # more would merge into a smear
_HULL, _LARGEST_HULL = 0.16, 2.0  # length of the hull behind the base: of the arm's, and in m
_RIM = "#B4BDC2"  # around the arm's thickness


def chosen_records(data: xr.Dataset) -> Int[np.ndarray, " shape"]:
    """Which records to draw the shape of."""
    last = data.sizes["time"] - 1
    return np.unique(np.linspace(0, last, min(_SHAPES, last + 1)).round().astype(int))


def moves(path: Float[np.ndarray, "time axis"]) -> bool:
    """Whether a point goes anywhere."""
    return bool(np.ptp(path, axis=0).max() > 1e-6)


def points_of(data: xr.Dataset) -> Float[np.ndarray, "point axis=3"]:
    """Points of space that a window must hold to show a run, its water left out."""
    thick = float(np.max(data["diameter"].values)) if "diameter" in data else 0.0
    places = in_space(data, "position").reshape(-1, 3)
    near = corners(find_bodies(data), places, arm_length(data))
    points = [places - thick / 2, places + thick / 2, in_space(data, "tip_target"), near]
    points.append(points_of_tool(data))
    return np.concatenate(points)


def draw_arm(
    axes: Axes,
    data: xr.Dataset,
    low: Point,
    high: Point,
    view: View,
    chosen: Int[np.ndarray, " shape"] | None = None,
) -> None:
    """Draw a run, all but its water, in a window, with the arm's shape at chosen records."""
    shapes = view.project(data, "position")
    time = data["time"].values
    chosen = chosen_records(data) if chosen is None else chosen

    draw_bodies(axes, data, chosen, low, high, view)
    bow = Polygon(hull_outline(data, view), closed=True, facecolor=GREY, edgecolor=INK)
    # an arm that points toward the eye is before what holds it
    order = 0.9 if view.depth(base_direction(data, -1)) > 1e-9 else 3.0
    bow.set(linewidth=0.8, zorder=order, label="submarine's bow")
    axes.add_patch(bow)
    base = shapes[:, 0]
    if moves(base):
        axes.plot(*base.T, color=INK, linewidth=0.8, zorder=3.5, label="path of the base")
    if "diameter" in data:
        draw_thickness(axes, data, view)

    lines = LineCollection(
        list(shapes[chosen]),
        array=time[chosen],
        cmap=time_map(),
        norm=time_norm(data),
        linewidths=1.0,
        zorder=2,
    )
    axes.add_collection(lines)
    if len(chosen) > 1:
        axes.plot([], [], color=time_map()(0.5), linewidth=1.0, label="arm over time")
    else:
        axes.plot([], [], color=time_map()(0.0), linewidth=1.0, label="arm")
    draw_tool(axes, data, view)
    _draw_tip(axes, data, view)


def draw_thickness(axes: Axes, data: xr.Dataset, view: View) -> None:
    """Draw how thick the arm is at the end."""
    diameter = np.asarray(data["diameter"].values, dtype=float)
    if not is_spatial(data):
        band = outline(view.project(data, "position")[-1], diameter)
        body = Polygon(band, closed=True, facecolor=PALE, edgecolor=_RIM, linewidth=0.6)
        body.set_label("arm at the end")
        axes.add_patch(body)
        return
    # Facets may lie over one another: rims first, and what is inside over them.
    facets = view.paper(tube(in_space(data, "position")[-1], diameter, None))
    for colour, width, label in ((_RIM, 1.2, None), (PALE, 0.2, "arm at the end")):
        surface = PolyCollection(list(facets), facecolors=colour, edgecolors=colour, zorder=1)
        surface.set(linewidth=width, label=label)
        axes.add_collection(surface, autolim=False)


def _draw_tip(axes: Axes, data: xr.Dataset, view: View) -> None:
    path, target = view.project(data, "tip_position"), view.project(data, "tip_target")
    if len(path) > 1:
        axes.plot(*path.T, color=VERMILLION, linewidth=0.8, label="path of the tip", zorder=4)
    wanders = moves(in_space(data, "tip_target"))
    if wanders:
        axes.plot(*target.T, color=INK, linewidth=1.0, linestyle=(0, (4, 2)), zorder=4.5)
    axes.plot(
        *target[-1],
        marker="o",
        markersize=8.5,
        markerfacecolor="none",
        markeredgecolor=INK,
        markeredgewidth=1.2,
        linestyle=(0, (4, 2)) if wanders else "none",
        linewidth=1.0,
        color=INK,
        label="target" + (" (ring: at the end)" if wanders else ""),
        zorder=5,
    )


def hull(data: xr.Dataset) -> Facets:
    """Half an ellipsoid behind the base, its nose where the arm is held."""
    long = min(_HULL * arm_length(data), _LARGEST_HULL)  # that of a cable would be a ship's
    turn = np.linspace(0.0, np.pi / 2, 13)
    along = long * (np.append(np.cos(turn), 0.0) - 1.0)
    radius = 0.45 * long * np.append(np.sin(turn), 0.0)
    nose, ahead = in_space(data, "position")[-1, 0], base_direction(data, -1)
    return turned_body(nose, ahead, along, radius, perpendicular(ahead))


def hull_outline(data: xr.Dataset, view: View) -> Float[np.ndarray, "corner 2"]:
    """Corners of the hull in a view."""
    return convex_outline(view.paper(hull(data)).reshape(-1, 2))
