"""The box that a scene in perspective stands in: floor, two walls behind, and their numbers."""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.patches import Polygon
from matplotlib.ticker import MaxNLocator

from crinoid.report.solids import Point
from crinoid.report.surface import Facets, box_corners
from crinoid.report.view import View, left_of
from crinoid.space import AXES

_FLOOR, _PANE, _GRID, _FRAME, _SHADE = "#F7F8F8", "white", "#E2E5E7", "#C8CDD0", "#D2D6D8"


def draw_box(axes: Axes, low: Point, high: Point, view: View) -> None:
    """Draw the sides of a box that its inside does not hide, and its numbers outside."""
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


def draw_shadow(axes: Axes, facets: Facets, low: Point, view: View) -> None:
    """Draw what lies right under a body on the floor of the box."""
    flat = facets.copy()
    flat[..., 2] = low[2]
    shadow = PolyCollection(
        list(view.paper(flat)), facecolors=_SHADE, edgecolors=_SHADE, linewidths=0.3, zorder=0.6
    )
    axes.add_collection(shadow, autolim=False)


def _write_numbers(
    axes: Axes, low: Point, high: Point, ticks: list[np.ndarray], view: View
) -> None:
    """Write numbers and names along those edges of the box that are outermost on paper."""
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
        marks = np.tile(edge, (len(ticks[axis]), 1))
        marks[:, axis] = ticks[axis]
        step = float(np.diff(ticks[axis]).min(initial=np.inf))
        digits = max(0, -math.floor(math.log10(step) + 1e-9)) if math.isfinite(step) else 6
        for mark, tick in zip(marks, ticks[axis], strict=True):
            number = f"{tick:.{digits}f}" if math.isfinite(step) else f"{tick:g}"
            number = number.replace("-", "\N{MINUS SIGN}")
            away = (3.0 if axis == 2 else 7.0) * outward
            _write(axes, number, view.paper(mark), away, size=7.0, side=side)
        away = 22.0 * outward
        if axis == 2:
            edge[2], away, side = high[2], np.array([0.0, 9.0]), "center"
        _write(axes, f"{name} (m)", view.paper(edge), away, size=8.0, side=side)


def _write(
    axes: Axes,
    text: str,
    place: Float[np.ndarray, "axis=2"],
    away: Float[np.ndarray, "axis=2"],
    *,
    size: float,
    side: str,
) -> None:
    axes.annotate(
        text,
        (float(place[0]), float(place[1])),
        xytext=(float(away[0]), float(away[1])),
        textcoords="offset points",
        ha=side,
        va="center",
        fontsize=size,
        annotation_clip=False,
    )
