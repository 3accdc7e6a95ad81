"""The arm in a parallel view: its shapes, the path of its tip, the target and its base."""

import numpy as np
import xarray as xr
from jaxtyping import Float, Int
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.patches import Polygon

from crinoid.results.result import Result
from crinoid.results.scene.bodies import mount_bodies
from crinoid.results.scene.clip import arm_outline, convex_outline
from crinoid.results.scene.data import (
    Point,
    arm_length,
    base_word,
    even_indices,
    find_obstacles,
    in_space,
    is_spatial,
    moves,
    target_word,
)
from crinoid.results.scene.mesh import Facets, arm_facets
from crinoid.results.scene.mount import find_mount
from crinoid.results.scene.projection import View
from crinoid.view.figures.style import GREY, INK, PALE, VERMILLION, time_map, timed
from crinoid.view.figures.surroundings import (
    draw_obstacles,
    draw_tool,
    obstacle_points,
    tool_facets,
)

_SHAPES = 25  # more would merge into a smear
_HULL = 0.16  # share of the arm's length about the root, within which its base is shown
_STEEL = "#75858F"
_RIM = "#B4BDC2"  # around the arm's thickness


def chosen_records(data: xr.Dataset) -> Int[np.ndarray, " shape"]:
    """Return the indices of the records whose shape is drawn."""
    return even_indices(data.sizes["time"], _SHAPES)


def points_of(data: xr.Dataset) -> Float[np.ndarray, "point axis=3"]:
    """Points that a window must contain to show a run, without its water."""
    thick = float(np.max(data["diameter"].values)) if "diameter" in data else 0.0
    places = in_space(data, "position").reshape(-1, 3)
    near = obstacle_points(find_obstacles(Result(data)), places, arm_length(data))
    points = [places - thick / 2, places + thick / 2, in_space(data, "tip_target"), near]
    points.append(tool_facets(data).reshape(-1, 3))
    return np.concatenate(points)


Chosen = Int[np.ndarray, " shape"] | None


def draw_arm(
    axes: Axes, data: xr.Dataset, low: Point, high: Point, view: View, chosen: Chosen = None
) -> None:
    """Draw a run without its water, with the shape of the arm at chosen records."""
    shapes = view.project(data, "position")
    chosen = chosen_records(data) if chosen is None else chosen

    draw_obstacles(axes, data, chosen, low, high, view)
    # an arm that points toward the eye is in front of its base
    hull = 0.9 if view.depth(find_mount(Result(data.isel(time=[-1]))).direction[0]) > 1e-9 else 3.0
    for facets, colour, name in mount_facets(data, 0.01):
        part = Polygon(convex_outline(view.paper(facets).reshape(-1, 2)), closed=True)
        order, label = (1.5, None) if name == "clamp" else (hull, name)
        part.set(facecolor=colour, edgecolor=INK, linewidth=0.8, zorder=order, label=label)
        axes.add_patch(part)
    base = shapes[:, 0]
    if moves(base):
        axes.plot(*base.T, color=INK, linewidth=0.8, zorder=3.5, label="path of the base")
    if "diameter" in data:
        _draw_thickness(axes, data, view)

    lines = LineCollection(list(shapes[chosen]), linewidths=1.0, zorder=2, **timed(data, chosen))
    axes.add_collection(lines)
    middle, label = (0.5, "arm over time") if len(chosen) > 1 else (0.0, "arm")
    axes.plot([], [], color=time_map()(middle), linewidth=1.0, label=label)
    draw_tool(axes, data, view)
    _draw_tip(axes, data, view)


def _draw_thickness(axes: Axes, data: xr.Dataset, view: View) -> None:
    diameter = np.asarray(data["diameter"].values, dtype=float)
    if not is_spatial(data):
        band = arm_outline(view.project(data, "position")[-1], diameter)
        body = Polygon(band, closed=True, facecolor=PALE, edgecolor=_RIM, linewidth=0.6)
        body.set_label("arm at the end")
        axes.add_patch(body)
        return
    # facets may overlap: the rims are drawn first, and the insides over them
    facets = view.paper(arm_facets(in_space(data, "position")[-1], diameter, None))
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
    (ring,) = axes.plot(*target[-1], "o", markersize=8.5, mfc="none", mec=INK, mew=1.2, zorder=5)
    ring.set(linestyle=(0, (4, 2)) if wanders else "none", linewidth=1.0, color=INK)
    ring.set_label(target_word(Result(data)) + (" (ring: at the end)" if wanders else ""))


def mount_facets(data: xr.Dataset, longest: float = 0.05) -> list[tuple[Facets, str, str]]:
    """Facets (at most a share of the arm long), colours and names of the mount at the end."""
    last = data.isel(time=[-1])
    root, length = in_space(last, "position")[:, 0], arm_length(data)
    thick = float(data["diameter"].values[0]) / 2 if "diameter" in data else 0.01 * length
    looks = {"hull": (GREY, base_word(Result(data).known_scenario)), "steel": (_STEEL, "clamp")}
    return [
        (body.transform(body.shape.mesh(longest * length).facets, 0), *looks[body.material])
        for body in mount_bodies(find_mount(Result(last)), root, thick, length)
    ]


def mount_points(data: xr.Dataset) -> Float[np.ndarray, "point axis=3"]:
    """Points that a window must contain to show the base, as far as it is near the root."""
    root, near = in_space(data, "position")[-1, 0], _HULL * arm_length(data)
    points = [facets.reshape(-1, 3) for facets, _, _ in mount_facets(data)]
    return np.clip(np.concatenate(points), root - near, root + near)
