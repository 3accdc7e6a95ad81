"""The arm in space on one page: from above, from the side, from ahead, and in perspective."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray as xr
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from crinoid.report.arm import draw_arm, hull, points_of
from crinoid.report.current import Current, draw_key, find_current
from crinoid.report.frame import in_best_frame, measured_from
from crinoid.report.run import Run
from crinoid.report.scene import Scene, draw_scene
from crinoid.report.solids import Point
from crinoid.report.style import WIDTH, add_axes, colour_bar, head, head_height, key_below
from crinoid.report.surface import box_corners
from crinoid.report.units import largest
from crinoid.report.view import ABOVE, AHEAD, SIDE, View, perspective

VIEWS = (ABOVE, SIDE, AHEAD)
LEFT, GAP = 0.85, (0.3, 0.42)  # inches
_RIGHT = 1.0
_NUMBERS = 0.25  # on the left of what is in perspective
_MARGIN = 0.04  # around everything, of the largest extent
_LEAST = 0.35  # extent of the window along any axis, of the largest


@dataclass(frozen=True)
class Block:
    """Sizes in inches of three projections of one scale, and of the corner that they leave."""

    extent: Point
    corner: tuple[float, float]
    """Width and height of what is beside the view from above, and above that from ahead."""
    inch: float
    """Inches per m."""

    @property
    def height(self) -> float:
        """From the foot of the view from the side to the top of the corner."""
        return float(self.extent[2]) + GAP[1] + self.corner[1]

    def place(self, figure: Figure, left: float, foot: float) -> tuple[dict[View, Axes], Axes]:
        """Add the axes of the projections to a figure, and those of the corner."""
        wide, deep, high = map(float, self.extent)
        right, above = left + wide + GAP[0], foot + high + GAP[1]
        width, height = self.corner
        return {
            ABOVE: add_axes(figure, left, above, wide, deep),
            SIDE: add_axes(figure, left, foot, wide, high),
            AHEAD: add_axes(figure, right, foot, deep, high),
        }, add_axes(figure, right + _NUMBERS, above, width - _NUMBERS, height)


def draw_sheet(run: Run) -> Figure:
    """Draw the arm over time in three projections of one scale, and in perspective.

    The views lie as on a drawing in third-angle projection: above the view from the side is that
    from above, beside it that from ahead. A run without control lies below.
    """
    run, about = in_best_frame(run)
    members = [data for _, data in run.members]
    currents = {view: [find_current(data, view) for data in members] for view in VIEWS}
    scale = max(current.scale for some in currents.values() for current in some)
    inside = space_of(members)
    low, high = window(inside, currents, scale)
    bottom, top = box_around(inside)

    alone = len(members) == 1
    block = fit(high - low, WIDTH - LEFT - _RIGHT, *((6.6, 2.5) if alone else (4.5, 2.2)))
    below, between = 1.13, 0.95
    above = head_height(run.title, run.status, WIDTH) + (0.26 if alone else 0.52)
    inner = len(members) * block.height + (len(members) - 1) * between
    figure = Figure(figsize=(WIDTH, below + inner + above))
    head(figure, run.title, run.status)

    flat: list[Axes] = []
    for index, (label, data) in enumerate(run.members):
        foot = below + (len(members) - 1 - index) * (block.height + between)
        panels, corner = block.place(figure, LEFT, foot)
        for view, axes in panels.items():
            frame(axes, view, low, high, block.inch, about)
            draw_arm(axes, data, low, high, view)
            if scale > 0.0 or view is SIDE:  # which else says that the water is still
                currents[view][index].draw(axes, scale)
        flat += panels.values()
        if label:
            _write_label(figure, label, foot + block.height + 0.24)
        draw_scene(fit_scene(corner, bottom, top), data)
        colour_bar(figure, run.result, WIDTH - _RIGHT + 0.15, foot, float(block.extent[2]))
        if scale > 0.0 and index == 0:
            fastest = max(largest(each.instants) for some in currents.values() for each in some)
            # above the view from ahead, out to the edge of the page
            right = WIDTH - LEFT - float(block.extent[0]) - GAP[0] - 0.15
            head_at = np.array([low[1] + right / block.inch, high[2] + 0.11 / block.inch])
            draw_key(panels[AHEAD], head_at, fastest, scale)
    key_below(figure, flat)
    return figure


def fit(extent: Point, room: float, tallest: float, corner: float) -> Block:
    """Find the scale at which three views of a window (m) fill a room (inches).

    They leave a corner at least as wide as it is told, and nearly as high.
    """
    wide, deep, high = extent
    room, tallest, low = room - GAP[0], tallest - GAP[1], 0.8 * corner
    inch = min(
        (room - corner) / wide,
        room / (wide + deep),
        (tallest - low) / high,
        tallest / (high + deep),
    )
    size = np.asarray(extent * inch)
    return Block(size, (room - float(size[0]), max(float(size[1]), low)), float(inch))


def frame(axes: Axes, view: View, low: Point, high: Point, inch: float, about: str = "") -> None:
    """Give a panel its window, at a scale in inches per m, and what it does not share with another.

    The view from above shares x with that from the side below it, that from ahead z beside it.
    """
    (left, bottom), (right, top) = view.paper(low), view.paper(high)
    axes.set(xlim=(left, right), ylim=(bottom, top), aspect="equal")
    axes.locator_params(axis="x", nbins=max(3, int((right - left) * inch / 0.6)))
    axes.locator_params(axis="y", nbins=max(3, int((top - bottom) * inch / 0.45)))
    axes.tick_params(labelbottom=view is not ABOVE, labelleft=view is not AHEAD)
    across, up = measured_from(view, about)
    axes.set_xlabel("" if view is ABOVE else across)
    axes.set_ylabel("" if view is AHEAD else up)
    axes.set_title(view.name, loc="left", fontsize=8.5, pad=4)


def space_of(members: list[xr.Dataset]) -> np.ndarray:
    """Points that a window must hold to show some runs, their water left out."""
    return np.concatenate(
        [part for data in members for part in (points_of(data), hull(data).reshape(-1, 3))]
    )


def window(
    inside: np.ndarray, currents: dict[View, list[Current]], scale: float
) -> tuple[Point, Point]:
    """Corners (m) of a box of which every view shows a side, with all that is drawn in it."""
    low, high = np.nanmin(inside, axis=0), np.nanmax(inside, axis=0)
    for view, some in currents.items():
        heads = np.concatenate([view.paper(inside), *(each.corners(scale) for each in some)])
        low[view.axes] = np.fmin(low[view.axes], np.nanmin(heads, axis=0))
        high[view.axes] = np.fmax(high[view.axes], np.nanmax(heads, axis=0))
    return box_around(np.stack([low, high]))


def box_around(points: Float[np.ndarray, "point axis=3"]) -> tuple[Point, Point]:
    """Corners of a box around points that is neither tight nor flat."""
    low, high = np.nanmin(points, axis=0), np.nanmax(points, axis=0)
    margin = _MARGIN * float((high - low).max())
    low, high = low - margin, high + margin
    lacking = np.maximum(_LEAST * float((high - low).max()) - (high - low), 0.0)
    return low - lacking / 2, high + lacking / 2


def fit_scene(axes: Axes, low: Point, high: Point) -> Scene:
    """Make a scene in perspective of a box, shown whole and as large as it goes."""
    view = perspective(low, high)
    corners = view.paper(box_corners(low, high))
    left, right = corners.min(axis=0), corners.max(axis=0)
    edge = 0.005 * (right - left)  # half a line
    left, right = left - edge, right + edge
    axes.set(aspect="equal", xlim=(left[0], right[0]), ylim=(left[1], right[1]))
    axes.set_axis_off()
    axes.set_title(view.name, loc="left", fontsize=8.5, pad=4)
    return Scene(axes, low, high, view)


def _write_label(figure: Figure, label: str, height: float) -> None:
    wide, tall = figure.get_size_inches()
    figure.text(LEFT / wide, height / tall, label, va="bottom", fontsize=9.5, fontweight="bold")
