"""The arm in perspective: a box with axes, and lit bodies sorted by depth."""

import math
from collections.abc import Iterable
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.patches import Polygon
from matplotlib.ticker import MaxNLocator

from crinoid.foundation.axes import AXES
from crinoid.results.scene.bodies import obstacle_body
from crinoid.results.scene.clip import box_corners, convex_outline, within_box
from crinoid.results.scene.data import Point, even_indices, moves
from crinoid.results.scene.projection import View, left_of, perspective
from crinoid.results.scene.scene import Keyframes, Scene
from crinoid.view.figures import painter, style
from crinoid.view.figures.arm import chosen_records
from crinoid.view.figures.surroundings import SOLID, WALL, draw_earlier

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
            corners = box_corners(low, high)
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


_COLOURS = {"hull": style.GREY, "steel": painter.STEEL, "obstacle": SOLID, "tool": style.PURPLE}
_PATH = 300  # pieces of a path


def draw_end(
    axes: Axes,
    scene: Scene,
    run: Keyframes,
    box: tuple[Point, Point],
    lines: Iterable[painter.Surface] = (),
    arm: painter.Surface | None = None,
) -> View:
    """Draw a run of a scene at its end, and lines, in a box that is shown as large as it goes.

    Another surface of the arm may be given. Return the view, from which bodies may hide lines.
    """
    low, high = box
    view, now = perspective(low, high), painter.instant(run, float(run.time[-1]))
    corners = view.paper(box_corners(low, high))
    left, right = corners.min(axis=0), corners.max(axis=0)
    edge = 0.005 * (right - left)  # half a line
    left, right = left - edge, right + edge
    axes.set(aspect="equal", xlim=(left[0], right[0]), ylim=(left[1], right[1]))
    axes.set_axis_off()
    axes.set_title(view.name, loc="left", fontsize=style.small(), pad=4)
    draw_box(axes, low, high, view)
    bodies = painter.BodySurfaces(scene, _COLOURS, float(np.linalg.norm(high - low)))
    solids = [part._replace(facets=within_box(part.facets, low, high)) for part in bodies.at(now)]
    solids.append(arm or painter.arm_surface(now, style.PALE))
    flat = np.concatenate([part.facets for part in solids])
    flat[..., 2] = low[2]
    look: Any = {"facecolors": _SHADE, "edgecolors": _SHADE, "linewidths": 0.3, "zorder": 0.6}
    axes.add_collection(PolyCollection(list(view.paper(flat)), **look), autolim=False)
    collection = PolyCollection([], joinstyle="round", zorder=2)
    painter.paint(collection, [*solids, *lines], view, whole=False)
    axes.add_collection(collection, autolim=False)
    walls = painter.wall_outlines(now.obstacles, low, high, view)
    for outlines, alpha, order in zip(walls, (0.85, 0.25), (0.4, 3.0), strict=True):
        wall = PolyCollection(outlines, facecolors=WALL, edgecolors=style.GREY, linewidths=0.7)
        wall.set(alpha=alpha, zorder=order)
        axes.add_collection(wall, autolim=False)
    return view


def draw_over_time(axes: Axes, scene: Scene, run: Keyframes, box: tuple[Point, Point]) -> None:
    """Draw a run of a scene over time without its water, its bodies at the end."""
    chosen = chosen_records(run.time.size)
    colours = style.time_map()(style.time_norm(run.time)(run.time[chosen]))
    shapes = zip(run.position[chosen], colours, strict=True)
    lines = [painter.line_surface(points, colour) for points, colour in shapes]
    for path, ink in ((run.position[:, -1], style.VERMILLION), (run.target, style.INK)):
        if moves(path):
            lines.append(painter.line_surface(path[even_indices(len(path), _PATH)], ink))
    view = draw_end(axes, scene, run, box, lines)
    for obstacle in (each for each in run.obstacles if each.moves and each.kind != "plane"):
        body = obstacle_body(obstacle, scene, run, float(np.linalg.norm(box[1] - box[0])))
        mesh = body.shape.mesh().facets
        parts = (within_box(body.transform(mesh, int(record)), *box) for record in chosen)
        outlines = [convex_outline(view.paper(part.reshape(-1, 3))) for part in parts if part.size]
        draw_earlier(axes, outlines, colours)
    ring: Any = {"markersize": 7.5, "mfc": "none", "mec": style.INK, "mew": 1.2, "zorder": 5}
    axes.plot(*view.paper(run.target[-1]), "o", **ring)
