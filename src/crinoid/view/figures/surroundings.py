"""Obstacles, the tool and the arrows of the water in a parallel view."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.patches import Polygon

from crinoid.results.result import Result
from crinoid.results.scene.bodies import tool_bodies
from crinoid.results.scene.clip import convex_outline, obstacle_outline, shows_edge
from crinoid.results.scene.data import (
    STILL,
    Indices,
    Obstacle,
    Point,
    arm_length,
    even_indices,
    in_space,
)
from crinoid.results.scene.mesh import Facets
from crinoid.results.scene.projection import PaperPoints, View
from crinoid.results.scene.scene import CALM, NEAR, REACH, Keyframes, arrow_nodes, arrow_starts
from crinoid.results.units import largest, round_down
from crinoid.view.figures import style

_BEHIND = 0.04  # depth shown behind a wall, of the arm's length


def tool_facets(run: Keyframes) -> Facets:
    """Facets of the tool at the last record that has it."""
    if run.tool is None:
        return np.empty((0, 4, 3))
    last = np.flatnonzero(run.held)[[-1]]
    parts = tool_bodies(run.tool, run.position[last, -2:], np.ones(1, bool))
    fine = run.tool.radius / 16
    return np.concatenate([part.transform(part.shape.mesh(fine).facets, 0) for part in parts])


def draw_tool(axes: Axes, run: Keyframes, view: View) -> None:
    """Draw the tool at the end, or where it was released."""
    facets = tool_facets(run)
    if not len(facets):
        return
    at_the_end = bool(run.held[-1])
    shape = Polygon(convex_outline(view.paper(facets).reshape(-1, 2)), closed=True)
    face = style.PURPLE if at_the_end else "none"
    shape.set(facecolor=face, edgecolor=style.INK, linewidth=0.6, zorder=2.5)
    shape.set_label("tool" if at_the_end else "tool, where it was released")
    axes.add_patch(shape)


SOLID = "#C9C2B8"
WALL = "#F1EEEA"


def draw_obstacles(
    axes: Axes, run: Keyframes, chosen: Indices, low: Point, high: Point, view: View
) -> None:
    """Draw obstacles at the end, and those that move also at chosen records."""
    obstacles, arm = run.obstacles, run.position[-1]
    colours = style.time_map()(style.time_norm(run.time)(run.time[chosen]))
    round_too = any(obstacle.kind != "plane" for obstacle in obstacles)
    label = "obstacle at the end" if any(obstacle.moves for obstacle in obstacles) else "obstacle"
    window = view.paper(np.stack([low, high]))
    for obstacle in obstacles:
        wall, radius = obstacle.kind == "plane", obstacle.radius
        middle = obstacle.nearest(np.s_[:, None], (low + high)[None, None] / 2)[:, 0]
        depth = view.depth(middle)
        near, far = sorted((float(view.depth(low)), float(view.depth(high))))
        if not wall and not np.any((depth > near - radius) & (depth < far + radius)):
            continue  # its distance from the eye is never that of the window
        edge_on = wall and shows_edge(obstacle, view)
        order = 1.2 if edge_on else 0.2  # the arm's is 1
        if not wall:
            order = 0.95 if _is_behind(obstacle, arm, view) else 1.2
        if obstacle.solid is not None:
            _draw_solid(axes, obstacle, view, order, label)
            if len(obstacles) > 1 and obstacle.kind == "mesh":
                _write_name(axes, obstacle, low, high, view)
            continue
        outline = obstacle_outline(obstacle, -1, low, high, view)
        shows = outline.size and np.all((outline.min(0) < window[1]) & (outline.max(0) > window[0]))
        face, edge = (WALL, style.GREY) if wall else (SOLID, style.INK)
        solid = Polygon(outline, closed=True, facecolor=face, edgecolor=edge, linewidth=0.8)
        solid.set(hatch="////" if edge_on else None, zorder=order)
        solid.set_label(None if (wall and round_too) or not shows else label)
        axes.add_patch(solid)
        if obstacle.moves and (edge_on or not wall):
            outlines = [obstacle_outline(obstacle, int(at), low, high, view) for at in chosen]
            draw_earlier(axes, outlines, colours)
            (path,) = axes.plot(*view.paper(obstacle.path).T, color=style.INK, linewidth=0.8)
            path.set(linestyle=(0, (1, 1.5)), zorder=3.2, label="path of an obstacle")
        if len(obstacles) > 1:
            _write_name(axes, obstacle, low, high, view)


def _draw_solid(axes: Axes, obstacle: Obstacle, view: View, order: float, label: str) -> None:
    """Draw a solid from a file at the end: its rims first, and the insides over them."""
    assert obstacle.solid is not None
    corners = view.paper(obstacle.path[-1] + obstacle.solid.points)
    for colour, width, text in ((style.INK, 2.0, None), (SOLID, 0.6, label)):
        surface = PolyCollection(list(corners[obstacle.solid.facets]), zorder=order)
        surface.set(facecolors=colour, edgecolors=colour, linewidths=width, label=text)
        axes.add_collection(surface, autolim=False)


def draw_earlier(
    axes: Axes, outlines: list[Float[np.ndarray, "_ 2"]], colours: Float[np.ndarray, "shape 4"]
) -> None:
    """Draw earlier places of an obstacle, in the colours of the times."""
    shapes = PolyCollection(outlines, facecolors="none", edgecolors=colours, linewidths=0.6)
    shapes.set(alpha=0.55, zorder=1.4, label="obstacle over time")
    axes.add_collection(shapes, autolim=False)


def _write_name(axes: Axes, obstacle: Obstacle, low: Point, high: Point, view: View) -> None:
    """Write an obstacle's number on it, within the window."""
    window = view.paper(np.stack([low, high]))
    inset = 0.025 * float(np.linalg.norm(window[1] - window[0]))
    if obstacle.kind == "plane" and not shows_edge(obstacle, view):
        seen = np.clip(obstacle_outline(obstacle, -1, low, high, view), *window)
        if not seen.size:
            return
        at = seen[np.argmax(seen @ [1.0, -1.0])] + 1.5 * inset * np.array([-1.0, 1.0])
    else:
        place = obstacle.path[-1]
        if obstacle.solid is not None:
            place = place + obstacle.solid.points.mean(axis=0)
        wall = obstacle.kind == "plane"
        if wall or np.any((view.paper(place) < window[0]) | (view.paper(place) > window[1])):
            place = obstacle.nearest(-1, (low + high) / 2)
        at = view.paper(place) - (inset * view.paper(obstacle.normal) if wall else 0.0)
    box: Any = {"boxstyle": "round,pad=0.12", "facecolor": "white", "linewidth": 0}
    look: Any = {"ha": "center", "va": "center", "annotation_clip": True, "zorder": 6}
    axes.annotate(obstacle.name, (float(at[0]), float(at[1])), fontsize=7.5, bbox=box, **look)


def _is_behind(obstacle: Obstacle, arm: Float[np.ndarray, "node axis=3"], view: View) -> bool:
    """Whether it is farther from the eye at the end than an arm, where they meet on paper."""
    core = obstacle.nearest(-1, arm)
    apart = np.linalg.norm(view.paper(core) - view.paper(arm), axis=1)
    meet = np.argmin(apart)
    return bool(view.depth(core[meet]) < view.depth(arm[meet]) - STILL)


def obstacle_points(
    obstacles: Sequence[Obstacle], shapes: Float[np.ndarray, "point axis=3"], length: float
) -> Float[np.ndarray, "corner axis=3"]:
    """Points that a window must contain to show the obstacles, as far as they are near the arm."""
    low, high = shapes.min(axis=0) - NEAR * length, shapes.max(axis=0) + NEAR * length
    middle = (low + high)[None, None] / 2
    points = [np.empty((0, 3))]
    for obstacle in obstacles:
        if obstacle.solid is not None:
            points.append(obstacle.corners_within(low, high))
            continue
        half, nearest = obstacle.half_axis, obstacle.nearest(np.s_[:, None], middle)[:, 0]
        if obstacle.kind == "plane":
            seen = np.concatenate([nearest, nearest - _BEHIND * length * obstacle.normal])
        else:
            short = np.linalg.norm(half[0]) <= length
            ends = [obstacle.path - half, obstacle.path + half]
            core = np.concatenate(ends) if short else nearest
            seen = np.concatenate([core - obstacle.radius, core + obstacle.radius])
        points.append(np.clip(seen, low, high))
    return np.concatenate(points)


_INSTANTS = 12


class CurrentArrows(NamedTuple):
    """Arrows on paper: where they start (m), the mean and some instants of the velocity (m/s)."""

    start: Float[np.ndarray, "place axis=2"]
    mean: Float[np.ndarray, "place axis=2"]
    instants: Float[np.ndarray, "instant place axis=2"]
    scale: float  # m/s of water per m of arrow that suits this run; 0: still water

    def corners(self, scale: float) -> Float[np.ndarray, "point axis=2"]:
        """Points that a window must contain so that no arrow is cut."""
        if self.scale == 0.0:
            return self.start
        heads = self.start + self.instants / scale
        return np.concatenate([self.start, heads.reshape(-1, 2)])

    def draw(self, axes: Axes, scale: float) -> None:
        """Draw the arrows at a scale (m/s per m) that all runs of a figure share."""
        if self.scale == 0.0:
            axes.set_title("still water", loc="right", color=style.GREY, fontsize=style.small())
            return
        if not np.allclose(self.instants, self.mean, atol=2e-2 * largest(self.instants)):
            start = np.broadcast_to(self.start, self.instants.shape)
            threads = np.stack([start, start + self.instants / scale], axis=-2).reshape(-1, 2, 2)
            lines = LineCollection(list(threads), colors=style.SKY, alpha=0.6, linewidths=0.8)
            lines.set_label("water, instants")
            axes.add_collection(lines, autolim=False)
        _arrows(axes, self.start, self.mean, scale)
        axes.plot([], [], color=style.BLUE, linewidth=1.8, label="water, mean")


def draw_key(axes: Axes, corner: Float[np.ndarray, "axis=2"], fastest: float, scale: float) -> None:
    """Draw an arrow with its speed as the key, its head at a corner (m)."""
    speed = round_down(0.85 * fastest)
    tail = corner - np.array([speed / scale, 0.0])
    _arrows(axes, tail[None], np.array([[speed, 0.0]]), scale)
    look: Any = {"textcoords": "offset points", "ha": "right", "va": "center"}
    look |= {"fontsize": style.small(), "annotation_clip": False}
    axes.annotate(f"water {speed:g} m/s", (float(tail[0]), float(tail[1])), (-5, 0), **look)


def find_current(run: Result, view: View) -> CurrentArrows:
    """Place the arrows of the flow next to all that the arm sweeps, and choose their scale."""
    data = run.dataset
    nothing = CurrentArrows(np.empty((0, 2)), np.empty((0, 2)), np.empty((0, 0, 2)), 0.0)
    if "flow_velocity" not in data:
        return nothing
    flow, shapes = view.project(data, "flow_velocity"), view.project(data, "position")
    shape, length = shapes.mean(axis=0), arm_length(data)
    chosen = arrow_nodes(shape, length)
    times = even_indices(len(flow), _INSTANTS)
    mean, instants = flow[:, chosen].mean(axis=0), flow[times][:, chosen]
    # of all places and in space, so that all views have one scale
    speed = np.linalg.norm(in_space(data, "flow_velocity")[times], axis=-1)
    fastest = float(speed.max(initial=0.0))
    if not math.isfinite(fastest) or fastest < CALM:
        return nothing
    swept = np.concatenate([shapes.reshape(-1, 2), view.project(data, "tip_target")])
    start = arrow_starts(shape, chosen, swept - shape[0], mean.mean(axis=0), length)
    return CurrentArrows(start, mean, instants, fastest / (REACH * length))


def _arrows(axes: Axes, start: PaperPoints, flow: PaperPoints, scale: float) -> None:
    look: Any = {"angles": "xy", "scale_units": "xy", "units": "inches", "width": 0.022}
    axes.quiver(*start.T, *flow.T, scale=scale, color=style.BLUE, zorder=4, clip_on=False, **look)
