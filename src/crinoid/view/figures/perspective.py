"""The arm in perspective: a box with axes, and lit bodies sorted by depth."""

import math
from operator import itemgetter
from typing import Any

import numpy as np
import xarray as xr
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import to_hex, to_rgba
from matplotlib.patches import Polygon
from matplotlib.ticker import MaxNLocator

from crinoid.foundation.axes import AXES
from crinoid.results.result import Result
from crinoid.results.scene import clip
from crinoid.results.scene.data import (
    Point,
    even_indices,
    find_obstacles,
    in_space,
    moves,
    tool_held,
)
from crinoid.results.scene.mesh import AROUND, Facets, Vectors, arm_facets
from crinoid.results.scene.projection import View, left_of
from crinoid.view.figures.arm import chosen_records, mount_facets
from crinoid.view.figures.style import GREY, INK, PALE, PURPLE, VERMILLION, time_map, time_norm
from crinoid.view.figures.surroundings import SOLID, WALL, draw_earlier, tool_facets

_FLOOR, _PANE, _GRID, _FRAME, _SHADE = "#F7F8F8", "white", "#E2E5E7", "#C8CDD0", "#D2D6D8"


def draw_box(axes: Axes, low: Point, high: Point, view: View) -> None:
    """Draw the sides of a box behind its contents, and its numbers outside."""
    behind = np.where(view.sight(low) > 0.0, low, high)
    before = low + high - behind
    # by the length of each axis on paper
    middle, half = (low + high) / 2, np.diag(high - low) / 2
    lengths = np.linalg.norm(view.paper(middle + half) - view.paper(middle - half), axis=1)
    ticks = []
    for least, most, share in zip(low, high, lengths / lengths.max(), strict=True):
        bins = max(2, round(5 * float(share)))
        found = MaxNLocator(bins, steps=[1, 2, 5, 10]).tick_values(least, most)
        ticks.append(found[(found >= least) & (found <= most)])
    for across in range(3):
        one, two = (axis for axis in range(3) if axis != across)
        corner = np.tile(behind, (4, 1))
        corner[[1, 2], one], corner[[2, 3], two] = before[one], before[two]
        pane = Polygon(view.paper(corner), closed=True, facecolor=_FLOOR if across == 2 else _PANE)
        pane.set(edgecolor=_FRAME, linewidth=0.6, zorder=0.1)
        axes.add_patch(pane)
        lines = []
        for axis, other in ((one, two), (two, one)):
            for tick in ticks[axis]:
                ends = np.tile(behind, (2, 1))
                ends[:, axis], ends[1, other] = tick, before[other]
                lines.append(view.paper(ends))
        grid = LineCollection(lines, colors=_GRID, linewidths=0.5, zorder=0.2)
        axes.add_collection(grid, autolim=False)
    _write_numbers(axes, low, high, ticks, view)


def _write_numbers(
    axes: Axes, low: Point, high: Point, ticks: list[np.ndarray], view: View
) -> None:
    """Write numbers and names along the outermost edges of the box on paper."""
    middle, before = (low + high) / 2, np.where(view.sight(low) > 0.0, high, low)
    for axis, name in enumerate(AXES[3]):
        edge = np.array([before[0], before[1], low[2]])
        if axis == 2:  # the edge farthest to the left
            corners = clip.box_corners(low, high)
            edge = corners[np.argmin(view.paper(corners)[:, 0])]
        edge[axis] = middle[axis]
        ends = np.tile(edge, (2, 1))
        ends[:, axis] = low[axis], high[axis]
        outward = np.array([-1.0, 0.0])
        if axis != 2:  # across the edge, away from the middle
            outward = left_of(np.diff(view.paper(ends), axis=0)[0])
            outward *= np.sign(outward @ (view.paper(edge) - view.paper(middle)))
        side = "right" if outward[0] < 0.0 else "left"  # so that numbers of two edges keep apart
        look: Any = {"textcoords": "offset points", "va": "center", "annotation_clip": False}
        marks = np.tile(edge, (len(ticks[axis]), 1))
        marks[:, axis] = ticks[axis]
        places: Any = view.paper(marks)
        away: Any = (3.0 if axis == 2 else 7.0) * outward
        step = float(np.diff(ticks[axis]).min(initial=np.inf))
        digits = max(0, -math.floor(math.log10(step) + 1e-9)) if math.isfinite(step) else 6
        for place, tick in zip(places, ticks[axis], strict=True):
            number = f"{tick:.{digits}f}" if math.isfinite(step) else f"{tick:g}"
            number = number.replace("-", "\N{MINUS SIGN}")
            axes.annotate(number, place, away, ha=side, fontsize=7.0, **look)
        away = 22.0 * outward
        if axis == 2:
            edge[2], away, side = high[2], np.array([0.0, 9.0]), "center"
        end: Any = view.paper(edge)
        axes.annotate(f"{name} (m)", end, away, ha=side, fontsize=8.0, **look)


Colours = Float[np.ndarray, "piece 4"]
Colour = str | tuple[float, float, float, float]

DARK = "#6F8591"  # the half of the arm that is on the side of its director m_1
_PATH = 300  # pieces of a path


class PerspectivePlot:
    """Surfaces and lines in a box, drawn from far to near (the painter's algorithm)."""

    def __init__(self, axes: Axes, low: Point, high: Point, view: View) -> None:
        self.axes, self.low, self.high, self.view = axes, low, high, view
        self._pieces: list[tuple[Any, ...]] = []  # depth, outline, colours of face and edge, width
        draw_box(axes, low, high, view)

    def add_surface(self, facets: Facets, colours: Colours, lift: float = 0.0) -> None:
        """Add facets of a body and its shadow, sorted as if nearer than they are by a lift (m)."""
        view, middle, flat = self.view, facets.mean(axis=1), facets.copy()
        flat[..., 2] = self.low[2]
        look: Any = {"facecolors": _SHADE, "edgecolors": _SHADE, "linewidths": 0.3, "zorder": 0.6}
        shadow = PolyCollection(list(view.paper(flat)), **look)
        self.axes.add_collection(shadow, autolim=False)
        normal = np.cross(facets[:, 2] - facets[:, 0], facets[:, 3] - facets[:, 1])
        away = np.sum(normal * view.sight(middle), axis=1) < 0.0
        normal *= np.where(away, -1.0, 1.0)[:, None]
        lit = view.lit(colours, normal, 0.62)
        self._add(facets, lit, lit, 0.4, lift)

    def add_line(self, points: Float[np.ndarray, "point axis=3"], colour: Colour) -> None:
        """Add a line, parts of which bodies may hide."""
        pieces = np.stack([points[:-1], points[1:]], axis=1)
        edges = _colours(colour, len(pieces))
        self._add(pieces, np.zeros_like(edges), edges, 1.0)

    def _add(
        self, pieces: Vectors, faces: Colours, edges: Colours, width: float, lift: float = 0.0
    ) -> None:
        depths, outlines = self.view.depth(pieces.mean(axis=1)) + lift, self.view.paper(pieces)
        widths = np.full(len(pieces), width)
        self._pieces += zip(depths, outlines, faces, edges, widths, strict=True)

    def draw(self) -> None:
        """Draw everything added."""
        self._pieces.sort(key=itemgetter(0))
        _, outlines, faces, edges, widths = zip(*self._pieces, strict=True)
        pieces = PolyCollection(outlines, facecolors=faces, edgecolors=edges, linewidths=widths)
        pieces.set(joinstyle="round", zorder=2)
        self.axes.add_collection(pieces, autolim=False)


def draw_scene(scene: PerspectivePlot, data: xr.Dataset) -> None:
    """Draw a run without its water."""
    low, high, view = scene.low, scene.high, scene.view
    shapes, time = in_space(data, "position"), data["time"].values
    chosen = chosen_records(data)
    colours = time_map()(time_norm(data)(time[chosen]))
    for record, colour in zip(chosen, colours, strict=True):
        scene.add_line(shapes[record], to_hex(colour))
    for name, colour in (("tip_position", VERMILLION), ("tip_target", INK)):
        path = in_space(data, name)
        if moves(path):
            scene.add_line(path[even_indices(len(path), _PATH)], colour)
    add_arm(scene, data)
    for obstacle in find_obstacles(Result(data)):
        if obstacle.kind == "plane":
            # behind everything, or transparent in front where the eye is inside it
            foot = obstacle.nearest(-1, (low + high) / 2)
            cut, _ = clip.cut_box(obstacle.normal, foot, low, high)
            if len(cut):
                behind = float(view.sight(cut[0]) @ obstacle.normal) > 0.0
                wall = Polygon(view.paper(cut), closed=True, facecolor=WALL, edgecolor=GREY)
                alpha, order = (0.85, 0.4) if behind else (0.25, 3.0)
                wall.set(linewidth=0.7, alpha=alpha, zorder=order)
                scene.axes.add_patch(wall)
            continue
        facets = clip.obstacle_facets(obstacle, low, high)
        scene.add_surface(facets, _colours(SOLID, len(facets)))
        if obstacle.moves:
            earlier = [
                clip.clipped_outline(obstacle, low, high, view, int(record)) for record in chosen
            ]
            draw_earlier(scene.axes, earlier, colours)
    scene.draw()
    target = view.project(data, "tip_target")[-1]
    scene.axes.plot(*target, "o", markersize=7.5, mfc="none", mec=INK, mew=1.2, zorder=5)


def add_arm(scene: PerspectivePlot, data: xr.Dataset) -> None:
    """Add the arm at the end, half of it dark where its director is known, and its mount."""
    thick = float(data["diameter"].values[0]) if "diameter" in data else 0.0
    for facets, colour, name in mount_facets(data):
        part = clip.within_box(facets, scene.low, scene.high)
        # the arm is not to be seen through the clamp around it
        lift = 2 * thick if name == "clamp" else 0.0
        scene.add_surface(part, _colours(colour, len(part)), lift)
    if "diameter" not in data:
        return
    director = in_space(data, "director")[-1] if "director" in data else None
    diameter = data["diameter"].values.astype(float)
    facets = arm_facets(in_space(data, "position")[-1], diameter, director)
    colours = _colours(PALE, len(facets))
    if director is not None:
        around = np.arange(len(facets)) % AROUND
        colours[(around + AROUND // 4) % AROUND <= AROUND // 2] = to_rgba(DARK)
    scene.add_surface(facets, colours)
    if tool_held(data)[-1]:
        tool = tool_facets(data)
        scene.add_surface(tool, _colours(PURPLE, len(tool)))


def _colours(colour: Colour, count: int) -> Colours:
    return np.tile(np.array(to_rgba(colour)), (count, 1))
