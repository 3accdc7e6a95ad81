"""The arm in space on one page: from above, from the side, from ahead, and in perspective."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import xarray as xr
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.transforms import Bbox

from crinoid.results.result import Result
from crinoid.results.scene.data import Point
from crinoid.results.scene.projection import ABOVE, AHEAD, SIDE, View
from crinoid.results.units import largest
from crinoid.view.figures import style
from crinoid.view.figures.arm import Chosen, draw_arm, points_of, smooth_arm
from crinoid.view.figures.perspective import draw_over_time
from crinoid.view.figures.surroundings import CurrentArrows, draw_key, find_current

_PLACES = ("position", "tip_position", "tip_target", "obstacle_position")


def in_best_frame(run: Result) -> tuple[Result, str]:
    """Return a run relative to the world, or to a base that travels far, and words on which."""
    if not any(each.travels(run.scene.length) for each in run.scene.members):
        return run, ""
    found, *other = (Result(_relative_to_base(each.dataset)) for _, each in run.members)
    found.uncontrolled = other[0] if other else None
    return found, " from the base"


def _relative_to_base(data: xr.Dataset) -> xr.Dataset:
    root = data["position"].isel(node=0, drop=True)
    there = [name for name in _PLACES if name in data]
    return data.assign({k: (data[k] - root).transpose(*data[k].dims) for k in there})


def measured_from(view: View, about: str) -> list[str]:
    """Return the labels of a view's axes, with the origin of its positions."""
    return [label.replace(" (m)", f"{about} (m)") for label in view.labels]


_CORNER = 0.03  # room between the edge and the key of the water, of the width


def draw_in(axes: Axes, data: xr.Dataset, view: View, chosen: Chosen, legend: bool) -> None:
    """Draw a run in a parallel view, with the arm's shape at chosen records, and a legend."""
    run, about = in_best_frame(Result(data))
    current = find_current(run, view)
    low, high = window(points_of(run.scene), {view: [current]}, current.scale)
    (left, bottom), (right, top) = view.paper(low), view.paper(high)
    labels = measured_from(view, about)
    axes.set(xlabel=labels[0], ylabel=labels[1])
    draw_arm(axes, run, 0, (low, high), view, chosen)
    current.draw(axes, current.scale)
    # the window has room at its top for the legend and below it for the key of the water, and the
    # shape of the axes that are given; axes that share its scale keep what they show
    room, shape = style.key_within(axes) if legend else 0.0, axes.bbox.width / axes.bbox.height
    line = style.line_share(axes) if current.scale > 0.0 else 0.0
    wide, tall = right - left, (top - bottom) / (1.0 - room - line)
    aside, above = max(0.0, tall * shape - wide), max(0.0, wide / shape - tall)
    across = left - aside / 2, right + aside / 2
    up = bottom - above / 2, bottom + tall + above / 2
    if current.scale > 0.0:
        corner = np.array([across[1] - _CORNER * (across[1] - across[0]), top + tall * line / 2])
        draw_key(axes, corner, largest(current.instants), current.scale)
    for artist in (*axes.collections, *axes.texts):
        artist.set_in_layout(False)  # layout engines overestimate the size of arrows
    across = _shared(axes.get_shared_x_axes().get_siblings(axes), axes, axes.get_xlim(), across)
    up = _shared(axes.get_shared_y_axes().get_siblings(axes), axes, axes.get_ylim(), up)
    axes.set(xlim=across, ylim=up)
    axes.set_aspect("equal", adjustable="box")  # "datalim" refuses axes that share both


def _shared(
    siblings: Sequence[Axes], axes: Axes, drawn: tuple[float, float], wanted: tuple[float, float]
) -> tuple[float, float]:
    """Return limits of axes that contain those of others with the same scale, if they have data."""
    if not any(each.has_data() for each in siblings if each is not axes):
        return wanted
    return min(drawn[0], wanted[0]), max(drawn[1], wanted[1])


VIEWS = (ABOVE, SIDE, AHEAD)
LEFT, GAP = 0.85, (0.3, 0.42)  # inches
_RIGHT = 1.0
_NUMBERS = 0.25  # inches, left of the perspective
_MARGIN = 0.04  # around everything, of the largest extent
_LEAST = 0.35  # extent of the window along any axis, of the largest


class Block(NamedTuple):
    """Sizes in inches of three projections of one scale, and of the corner that they leave."""

    extent: Point
    corner: tuple[float, float]  # width and height of the room right of the view from above
    inch: float  # inches per m

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
            ABOVE: style.add_axes(figure, left, above, wide, deep),
            SIDE: style.add_axes(figure, left, foot, wide, high),
            AHEAD: style.add_axes(figure, right, foot, deep, high),
        }, style.add_axes(figure, right + _NUMBERS, above, width - _NUMBERS, height)


def draw_sheet(run: Result) -> Figure:
    """Draw the arm over time in three projections of one scale, and in perspective.

    The views are placed as in third-angle projection: the view from above is above that from the
    side, the view from ahead is right of it. A run without control is drawn below.
    """
    run, about = in_best_frame(run)
    currents = {view: [find_current(each, view) for _, each in run.members] for view in VIEWS}
    scale = max(current.scale for some in currents.values() for current in some)
    inside = points_of(run.scene)
    low, high = window(inside, currents, scale)
    box = box_around(inside)

    count = len(run.members)
    alone = count == 1
    left, right = (0.6, 0.12) if style.narrow() else (LEFT, _RIGHT)
    room = style.width() - left - right
    block = fit(high - low, room, *((6.6, 2.5) if alone else (4.5, 2.2)))
    if style.narrow():  # no room for the view in perspective
        block = fit(high - low, room, 4.0, 0.6)
    below, between = 0.5, 0.95 * style.scale()
    below += style.BAR_BELOW if style.narrow() else 0.0
    above = style.head_height(run.title, run.status) + (0.26 if alone else 0.52)
    inner = count * block.height + (count - 1) * between
    figure = Figure(figsize=(style.width(), below + inner + above))
    style.head(figure, run.title, run.status)

    flat: list[Axes] = []
    for index, (label, _) in enumerate(run.members):
        foot = below + (count - 1 - index) * (block.height + between)
        panels, corner = block.place(figure, left, foot)
        for view, axes in panels.items():
            frame(axes, view, low, high, block.inch, about)
            draw_arm(axes, run, index, (low, high), view)
            if scale > 0.0 or view is SIDE:  # which else says that the water is still
                currents[view][index].draw(axes, scale)
        flat += panels.values()
        if label:
            (wide, tall), top_of = figure.get_size_inches(), foot + block.height + 0.24
            place = left / wide, top_of / tall
            figure.text(*place, label, va="bottom", fontsize="medium")
        corner.set_axis_off()
        if not style.narrow():
            draw_over_time(corner, run.scene, smooth_arm(run.scene.members[index]), box)
        if not (index < count - 1 and style.narrow()):
            bar = Bbox.from_bounds(left, foot, room, float(block.extent[2]))
            style.time_bar_at(figure, run.dataset, bar)
        if scale > 0.0 and index == 0:
            fastest = max(largest(each.instants) for some in currents.values() for each in some)
            # above the view from ahead, out to the edge of the page
            out = style.width() - left - float(block.extent[0]) - GAP[0] - 0.15
            up = 0.38 if style.narrow() else 0.11
            head_at = np.array([low[1] + out / block.inch, high[2] + up / block.inch])
            draw_key(panels[AHEAD], head_at, fastest, scale)
    style.key_of(figure, flat, "lower center")
    return figure


def fit(extent: Point, room: float, tallest: float, corner: float) -> Block:
    """Return sizes and scale of three views of a window (m) in a width and a height (inches)."""
    wide, deep, high = extent
    room, tallest, low = room - GAP[0], tallest - GAP[1], 0.8 * corner
    across = min((room - corner) / wide, room / (wide + deep))
    inch = min(across, (tallest - low) / high, tallest / (high + deep))
    size = np.asarray(extent * inch)
    return Block(size, (room - float(size[0]), max(float(size[1]), low)), float(inch))


def frame(axes: Axes, view: View, low: Point, high: Point, inch: float, about: str = "") -> None:
    """Set the window of a panel, at a scale in inches per m, and the labels of its own axes.

    The view from above shares x with that from the side below it, that from ahead shares its z.
    """
    (left, bottom), (right, top) = view.paper(low), view.paper(high)
    axes.set(xlim=(left, right), ylim=(bottom, top), aspect="equal")
    axes.locator_params(axis="x", nbins=max(3, int((right - left) * inch / 0.6)))
    axes.locator_params(axis="y", nbins=max(3, int((top - bottom) * inch / 0.45)))
    axes.tick_params(labelbottom=view is not ABOVE, labelleft=view is not AHEAD)
    across, up = measured_from(view, about)
    axes.set_xlabel("" if view is ABOVE else across)
    axes.set_ylabel("" if view is AHEAD else up)
    axes.set_title(view.name, loc="left", fontsize=style.small(), pad=4)


def window(
    inside: np.ndarray, currents: dict[View, list[CurrentArrows]], scale: float
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
