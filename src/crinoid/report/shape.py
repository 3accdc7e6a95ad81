"""The arm in the water: its shape over time, its tip's path, target, obstacles and flow."""

from __future__ import annotations

import numpy as np
import xarray as xr
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from crinoid.report.arm import draw_arm, hull_outline, points_of
from crinoid.report.current import Current, draw_key, find_current
from crinoid.report.frame import in_best_frame, measured_from
from crinoid.report.run import Run
from crinoid.report.solids import find_bodies
from crinoid.report.style import WIDTH, add_axes, colour_bar, head, head_height, key_below
from crinoid.report.units import largest
from crinoid.report.view import SIDE

_MARGIN = 0.04  # around everything, of the larger extent
_KEY = 0.24  # inches kept clear at the top for the arrow that says how fast the water is


def draw_shape(run: Run) -> Figure:
    """Draw the arm over time, beside the uncontrolled arm at the same scale where there is one."""
    run, about = in_best_frame(run)
    members = run.members
    currents = [find_current(data, SIDE) for _, data in members]
    scale = max(current.scale for current in currents)
    low, high = _extent([data for _, data in members], currents, scale)
    figure, panels = _panels(low, high, len(members), run, about)
    for axes, (label, data), current in zip(panels, members, currents, strict=True):
        draw_arm(axes, data, SIDE.lift(low), SIDE.lift(high), SIDE)
        current.draw(axes, scale)
        axes.set_title(label, loc="left")
    if scale > 0.0:
        clear = 0.5 * _KEY * (high - low)[0] / _width_inches(panels[0])
        fastest = max(largest(current.instants) for current in currents)
        draw_key(panels[-1], high - np.array([clear, clear]), fastest, scale)
    key_below(figure, panels)
    return figure


def _panels(
    low: Float[np.ndarray, "axis=2"],
    high: Float[np.ndarray, "axis=2"],
    count: int,
    run: Run,
    about: str,
) -> tuple[Figure, list[Axes]]:
    """Make equal panels that show a window, and the title and colour bar around them.

    `about` says from where positions are measured, other than from the origin.

    Equal axes leave a layout engine no freedom but to leave gaps, so the figure is cut to the
    panels instead; everything here is in inches.
    """
    window = high - low
    columns = count if window[1] > 0.75 * window[0] else 1
    rows = count // columns
    left, right, gap = 0.85, 1.0, (0.25, 0.32)
    room = (WIDTH - left - right - gap[0] * (columns - 1)) / columns, 6.8 / rows
    panel = window * min(room / window)
    # What a narrow panel leaves over goes to both sides alike.
    left += (WIDTH - left - right - gap[0] * (columns - 1) - columns * panel[0]) / 2
    below = 1.13 if any(find_bodies(data) for _, data in run.members) else 0.95  # a longer key
    inner = rows * panel[1] + (rows - 1) * gap[1]

    above = head_height(run.title, run.status, WIDTH) + (0.3 if count > 1 else 0.22)
    tall = below + inner + above
    figure = Figure(figsize=(WIDTH, tall))
    head(figure, run.title, run.status)
    panels = []
    for place in range(count):
        row, column = divmod(place, columns)
        x = left + column * (panel[0] + gap[0])
        z = below + inner - panel[1] - row * (panel[1] + gap[1])
        axes = add_axes(figure, x, z, *map(float, panel))
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
        axes.locator_params(axis="x", nbins=max(3, int(panel[0] / 0.7)))
        axes.locator_params(axis="y", nbins=max(3, int(panel[1] / 0.45)))
        axes.tick_params(labelbottom=row == rows - 1, labelleft=column == 0)
        across, up = measured_from(SIDE, about)
        axes.set_xlabel(across if row == rows - 1 else "")
        axes.set_ylabel(up if column == 0 else "")
        panels.append(axes)
    beside = left + columns * panel[0] + (columns - 1) * gap[0] + 0.15
    colour_bar(figure, run.result, beside, below, inner)
    return figure, panels


def _width_inches(axes: Axes) -> float:
    return float(axes.get_position().width) * WIDTH


def _extent(
    members: list[xr.Dataset], currents: list[Current], scale: float
) -> tuple[Float[np.ndarray, "axis=2"], Float[np.ndarray, "axis=2"]]:
    """Corners, in m, of a window that holds everything drawn in any panel."""
    points = [current.corners(scale) for current in currents]
    points += [SIDE.paper(points_of(data)) for data in members]
    points += [hull_outline(data, SIDE) for data in members]
    everything = np.concatenate(points)
    low, high = np.nanmin(everything, axis=0), np.nanmax(everything, axis=0)
    margin = _MARGIN * float((high - low).max())
    low, high = low - margin, high + margin
    # A straight arm in still water has hardly any width; the panel must have some.
    lacking = np.maximum(np.array([0.4, 0.2]) * (high - low).max() - (high - low), 0.0)
    low, high = low - lacking / 2, high + lacking / 2
    if scale > 0.0:
        high[1] += _KEY / 5.0 * float((high - low).max())
    return low, high
