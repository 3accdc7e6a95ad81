"""The arm in a parallel view: its shapes, the path of its tip, the target and its base."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.patches import Polygon
from scipy.interpolate import CubicSpline

from crinoid.results.result import Result
from crinoid.results.scene.bodies import RigidBody, mount_bodies
from crinoid.results.scene.clip import arm_outline, convex_outline
from crinoid.results.scene.data import Point, base_word, even_indices, moves, target_word
from crinoid.results.scene.mesh import arm_facets
from crinoid.results.scene.projection import View
from crinoid.results.scene.scene import Keyframes, Scene
from crinoid.view.figures import surroundings
from crinoid.view.figures.painter import STEEL, instant
from crinoid.view.figures.style import GREY, INK, PALE, VERMILLION, time_map, timed

_SHAPES = 25  # more would merge into a smear
_HULL = 0.16  # share of the arm's length about the root, within which its base is shown
_RIM = "#B4BDC2"  # around the arm's thickness


_PIECES = 100  # lines that an arm is drawn with, at least


def smooth_arm(run: Keyframes) -> Keyframes:
    """Return a run whose arm is a smooth curve through its nodes, of which few make kinks."""
    nodes = np.arange(len(run.diameter))
    fine = np.linspace(0, nodes[-1], -(-_PIECES // nodes[-1]) * nodes[-1] + 1)
    position = CubicSpline(nodes, run.position, axis=1)(fine)
    return replace(run, position=position, diameter=np.interp(fine, nodes, run.diameter), fields=())


def chosen_records(count: int) -> Int[np.ndarray, " shape"]:
    """Return the indices of those of some records whose shape is drawn."""
    return even_indices(count, _SHAPES)


def points_of(scene: Scene) -> Float[np.ndarray, "point axis=3"]:
    """Points that a window must contain to show the runs of a scene, without their water."""
    found = [mount_points(scene)]
    for run in scene.members:
        thick, places = float(run.diameter.max()), run.position.reshape(-1, 3)
        near = surroundings.obstacle_points(run.obstacles, places, scene.length)
        tool = surroundings.tool_facets(run).reshape(-1, 3)
        found += [places - thick / 2, places + thick / 2, run.target, near, tool]
    return np.concatenate(found)


Chosen = Int[np.ndarray, " shape"] | None


def draw_arm(
    axes: Axes, both: Result, one: int, box: tuple[Point, Point], view: View, chosen: Chosen = None
) -> None:
    """Draw one run of a result in a box without its water, the arm at chosen records."""
    (_, result), scene, run = both.members[one], both.scene, smooth_arm(both.scene.members[one])
    shapes = view.paper(run.position)
    if chosen is None:
        chosen = chosen_records(len(shapes))
    else:  # the scene omits instants that are not finite
        chosen = np.flatnonzero(np.isin(run.at, chosen))

    surroundings.draw_obstacles(axes, run, chosen, *box, view)
    # an arm that points toward the eye is in front of its base
    hull = 0.9 if view.depth(run.mount.direction[-1]) > 1e-9 else 3.0
    looks = {"hull": (GREY, base_word(result.known_scenario)), "steel": (STEEL, "clamp")}
    for body in _mount(scene, run):
        facets = body.transform(body.shape.mesh(0.01 * scene.length).facets, 0)
        colour, name = looks[body.material]
        part = Polygon(convex_outline(view.paper(facets).reshape(-1, 2)), closed=True)
        order, label = (1.5, None) if name == "clamp" else (hull, name)
        part.set(facecolor=colour, edgecolor=INK, linewidth=0.8, zorder=order, label=label)
        axes.add_patch(part)
    base = shapes[:, 0]
    if moves(base):
        axes.plot(*base.T, color=INK, linewidth=0.8, zorder=3.5, label="path of the base")
    _draw_thickness(axes, run, view, scene.spatial)

    lines = LineCollection(
        list(shapes[chosen]), linewidths=1.0, zorder=2, **timed(run.time, chosen)
    )
    axes.add_collection(lines)
    middle, label = (0.5, "arm over time") if len(chosen) > 1 else (0.0, "arm")
    axes.plot([], [], color=time_map()(middle), linewidth=1.0, label=label)
    surroundings.draw_tool(axes, run, view)
    _draw_tip(axes, run, view, target_word(result))


def _draw_thickness(axes: Axes, run: Keyframes, view: View, spatial: bool) -> None:
    position, diameter = run.position[-1], run.diameter
    if not spatial:
        band = arm_outline(view.paper(position), diameter)
        body = Polygon(band, closed=True, facecolor=PALE, edgecolor=_RIM, linewidth=0.6)
        body.set_label("arm at the end")
        axes.add_patch(body)
        return
    # facets may overlap: the rims are drawn first, and the insides over them
    facets = view.paper(arm_facets(position, diameter, None))
    for colour, width, label in ((_RIM, 1.2, None), (PALE, 0.2, "arm at the end")):
        surface = PolyCollection(list(facets), facecolors=colour, edgecolors=colour, zorder=1)
        surface.set(linewidth=width, label=label)
        axes.add_collection(surface, autolim=False)


def _draw_tip(axes: Axes, run: Keyframes, view: View, word: str) -> None:
    path, target = view.paper(run.position[:, -1]), view.paper(run.target)
    if len(path) > 1:
        axes.plot(*path.T, color=VERMILLION, linewidth=0.8, label="path of the tip", zorder=4)
    if word != "target":
        return
    wanders = moves(run.target)
    if wanders:
        axes.plot(*target.T, color=INK, linewidth=1.0, linestyle=(0, (4, 2)), zorder=4.5)
    (ring,) = axes.plot(*target[-1], "o", markersize=8.5, mfc="none", mec=INK, mew=1.2, zorder=5)
    ring.set(linestyle=(0, (4, 2)) if wanders else "none", linewidth=1.0, color=INK)
    ring.set_label(word + (" (ring: at the end)" if wanders else ""))


def _mount(scene: Scene, run: Keyframes) -> list[RigidBody]:
    """Return the bodies of the mount of a run at the end."""
    now = instant(run, run.time[-1])
    return mount_bodies(now.mount, now.position[:, 0], float(now.diameter[0]) / 2, scene.length)


def mount_points(scene: Scene) -> Float[np.ndarray, "point axis=3"]:
    """Points that a window must contain to show the bases, as far as they are near the roots."""
    near, found = _HULL * scene.length, []
    for run in scene.members:
        for body in _mount(scene, run):
            points = body.transform(body.shape.mesh(0.05 * scene.length).points, 0)
            found.append(points.clip(run.position[-1, 0] - near, run.position[-1, 0] + near))
    return np.concatenate(found)
