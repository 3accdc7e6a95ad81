"""The run in perspective: bodies with light on them, what is near over what is far."""

from __future__ import annotations

import math

import numpy as np
import xarray as xr
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_hex, to_rgba
from matplotlib.patches import Polygon

from crinoid.report.arm import chosen_records, hull, moves
from crinoid.report.box import draw_box, draw_shadow
from crinoid.report.charts.tool import held
from crinoid.report.obstacles import SOLID, WALL, draw_earlier
from crinoid.report.solids import Body, Point, find_bodies
from crinoid.report.style import GREY, INK, PALE, PURPLE, VERMILLION, time_map, time_norm
from crinoid.report.surface import (
    AROUND,
    Facets,
    cut_box,
    perpendicular,
    tube,
    turned_body,
    within_box,
)
from crinoid.report.tool import surface as tool_surface
from crinoid.report.view import View, convex_outline, in_space

Colour = str | tuple[float, float, float, float]

DARK = "#6F8591"  # the half of the arm that is on the side of its director m_1
_PATH = 300  # pieces of a path
_RINGS = 36  # along a body, at most


class Scene:
    """Surfaces and lines in a box, drawn from far to near (the painter's algorithm)."""

    def __init__(self, axes: Axes, low: Point, high: Point, view: View) -> None:
        self.axes, self.low, self.high, self.view = axes, low, high, view
        self._pieces: list[np.ndarray] = []
        self._depths: list[float] = []
        self._faces: list[np.ndarray] = []
        self._edges: list[np.ndarray] = []
        self._widths: list[float] = []
        draw_box(axes, low, high, view)

    def add_surface(self, facets: Facets, colours: Float[np.ndarray, "facet 4"]) -> None:
        """Add facets of a body, lit from the upper left, and its shadow."""
        draw_shadow(self.axes, facets, self.low, self.view)
        view, middle = self.view, facets.mean(axis=1)
        light = view.toward + 0.8 * np.array(view.up) - 0.6 * np.array(view.across)
        normal = np.cross(facets[:, 2] - facets[:, 0], facets[:, 3] - facets[:, 1])
        away = np.sum(normal * view.sight(middle), axis=1) < 0.0
        normal *= np.where(away, -1.0, 1.0)[:, None]
        area = np.maximum(np.linalg.norm(normal, axis=1), np.finfo(float).tiny)
        bright = 0.62 + 0.38 * np.maximum(normal @ light / (area * np.linalg.norm(light)), 0.0)
        lit = np.column_stack([colours[:, :3] * bright[:, None], colours[:, 3]])
        self._add(facets, lit, lit, 0.4)

    def add_line(self, points: Float[np.ndarray, "point axis=3"], colour: Colour) -> None:
        """Add a line, which bodies may hide in part."""
        pieces = np.stack([points[:-1], points[1:]], axis=1)
        edges = _colours(colour, len(pieces))
        self._add(pieces, np.zeros_like(edges), edges, 1.0)

    def _add(self, pieces: np.ndarray, faces: np.ndarray, edges: np.ndarray, width: float) -> None:
        self._pieces += list(self.view.paper(pieces))
        self._depths += list(self.view.depth(pieces.mean(axis=1)))
        self._faces += list(faces)
        self._edges += list(edges)
        self._widths += [width] * len(pieces)

    def draw(self) -> None:
        """Draw everything added."""
        order = np.argsort(self._depths, kind="stable")
        pieces = PolyCollection(
            [self._pieces[piece] for piece in order],
            facecolors=[self._faces[piece] for piece in order],
            edgecolors=[self._edges[piece] for piece in order],
            linewidths=[self._widths[piece] for piece in order],
            joinstyle="round",
            zorder=2,
        )
        self.axes.add_collection(pieces, autolim=False)


def draw_scene(scene: Scene, data: xr.Dataset) -> None:
    """Draw a run in a scene, all but its water."""
    low, high, view = scene.low, scene.high, scene.view
    shapes, time = in_space(data, "position"), data["time"].values
    chosen = chosen_records(data)
    colours = time_map()(time_norm(data)(time[chosen]))
    for record, colour in zip(chosen, colours, strict=True):
        scene.add_line(shapes[record], to_hex(colour))
    for name, colour in (("tip_position", VERMILLION), ("tip_target", INK)):
        path = in_space(data, name)
        if moves(path):
            records = np.linspace(0, len(path) - 1, min(_PATH, len(path))).round().astype(int)
            scene.add_line(path[records], colour)
    add_arm(scene, data)
    for body in find_bodies(data):
        if body.solid.kind == "plane":
            _draw_wall(scene, body)
            continue
        facets = solid_surface(body, low, high)
        scene.add_surface(facets, _colours(SOLID, len(facets)))
        if body.moves:
            earlier = [solid_outline(body, low, high, view, int(record)) for record in chosen]
            draw_earlier(scene.axes, earlier, colours)
    scene.draw()
    target = view.project(data, "tip_target")[-1]
    scene.axes.plot(*target, "o", markersize=7.5, mfc="none", mec=INK, mew=1.2, zorder=5)


def add_arm(scene: Scene, data: xr.Dataset) -> None:
    """Add the arm at the end, half of it dark where its director is known, and the hull."""
    bow = hull(data)
    scene.add_surface(bow, _colours(GREY, len(bow)))
    if "diameter" not in data:
        return
    director = in_space(data, "director")[-1] if "director" in data else None
    diameter = np.asarray(data["diameter"].values, dtype=float)
    facets = tube(in_space(data, "position")[-1], diameter, director)
    colours = _colours(PALE, len(facets))
    if director is not None:
        around = np.arange(len(facets)) % AROUND
        colours[(around + AROUND // 4) % AROUND <= AROUND // 2] = to_rgba(DARK)
    scene.add_surface(facets, colours)
    if held(data)[-1]:
        tool = tool_surface(data)
        scene.add_surface(tool, _colours(PURPLE, len(tool)))


def _colours(colour: Colour, count: int) -> Float[np.ndarray, "piece 4"]:
    return np.tile(np.array(to_rgba(colour)), (count, 1))


def _draw_wall(scene: Scene, body: Body) -> None:
    """Draw a wall behind everything, or like glass before it where the eye is in what is solid."""
    middle = (scene.low + scene.high) / 2
    cut, _ = cut_box(body.solid.out, body.nearest(-1, middle), scene.low, scene.high)
    if len(cut):
        behind = float(scene.view.sight(cut[0]) @ body.solid.out) > 0.0
        wall = Polygon(scene.view.paper(cut), closed=True, facecolor=WALL, edgecolor=GREY)
        alpha, order = (0.85, 0.4) if behind else (0.25, 3.0)
        wall.set(linewidth=0.7, alpha=alpha, zorder=order)
        scene.axes.add_patch(wall)


def solid_outline(
    body: Body, low: Point, high: Point, view: View, record: int = -1
) -> Float[np.ndarray, "corner 2"]:
    """Corners of what is seen of an obstacle at a record, as much of it as a box holds."""
    if body.solid.kind == "plane":
        surface, _ = cut_box(body.solid.out, body.nearest(record, (low + high) / 2), low, high)
    else:
        surface = solid_surface(body, low, high, record).reshape(-1, 3)
    return convex_outline(view.paper(surface)) if len(surface) else np.empty((0, 2))


def solid_surface(body: Body, low: Point, high: Point, record: int = -1) -> Facets:
    """Facets of what is round at a record (the end), as much of it as a box holds."""
    place, half, radius = body.path[record], body.solid.half_axis, body.solid.radius
    long = float(np.linalg.norm(half))
    direction = half / long if long else np.array([0.0, 0.0, 1.0])
    if body.solid.kind == "cylinder":
        # out to where the whole of it is outside
        wide = radius * np.sqrt(np.maximum(1.0 - direction**2, 0.0))
        with np.errstate(divide="ignore", invalid="ignore"):
            sides = np.stack([low - wide - place, high + wide - place]) / direction
        sides[:, direction == 0.0] = [[-np.inf], [np.inf]]
        begin, end = sides.min(axis=0).max(), sides.max(axis=0).min()
        rim = np.linspace(0.0, radius, 6)
        along = np.concatenate([np.full(6, begin), np.linspace(begin, end, 24), np.full(6, end)])
        around = np.concatenate([rim, np.full(24, radius), rim[::-1]])
    else:
        turn = np.linspace(0.0, np.pi / 2, 48)
        straight = np.linspace(-long, long, 24)[1:-1] if long else np.empty(0)
        cap, rim = radius * np.cos(turn), radius * np.sin(turn)
        along = np.concatenate([-long - cap, straight, long + cap[::-1]])
        around = np.concatenate([rim, np.full(straight.size, radius), rim[::-1]])

    # Only what is near the box, along and around: facets are small beside it however large a body.
    middle, reach = (low + high) / 2 - place, float(np.linalg.norm(high - low)) / 2
    outward = middle - (middle @ direction) * direction
    away = float(np.linalg.norm(outward))
    near = np.flatnonzero(np.hypot(along - middle @ direction, around - away) <= reach)
    if not near.size:
        return np.empty((0, 4, 3))
    first, last = max(near[0] - 1, 0), min(near[-1] + 1, along.size - 1)
    rings = np.linspace(first, last, min(_RINGS, last - first + 1)).round().astype(int)
    aside, wedge = perpendicular(direction), math.pi
    if away > reach:
        aside, wedge = outward / away, math.asin(reach / away)
    facets = turned_body(place, direction, along[rings], around[rings], aside, wedge)
    return within_box(facets, low, high)
