"""The arm in the water: its shape over time, its tip's path, target, obstacles and flow."""

from __future__ import annotations

import numpy as np
import xarray as xr
from jaxtyping import Float
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from matplotlib.ticker import MaxNLocator

from crinoid.report import plane
from crinoid.report.current import Current, arm_length, draw_key, find_current
from crinoid.report.obstacles import corners, draw_bodies, find_bodies
from crinoid.report.run import Run, base_direction
from crinoid.report.style import GREY, INK, PALE, VERMILLION, WIDTH, head, head_height, time_map
from crinoid.report.units import largest

_SHAPES = 25  # more would merge into a smear
_HULL = 0.16  # length of the hull drawn behind the base, of the arm's length
_MARGIN = 0.04  # around everything, of the larger extent
_KEY = 0.24  # inches kept clear at the top for the arrow that says how fast the water is


def draw_shape(run: Run) -> Figure:
    """Draw the arm over time, beside the uncontrolled arm at the same scale where there is one."""
    members = run.members
    currents = [find_current(data) for _, data in members]
    scale = max(current.scale for current in currents)
    low, high = _extent([data for _, data in members], currents, scale)
    figure, panels = _panels(low, high, len(members), run)
    for axes, (label, data), current in zip(panels, members, currents, strict=True):
        _draw_member(axes, data, low, high)
        current.draw(axes, scale)
        axes.set_title(label, loc="left")
    if scale > 0.0:
        clear = 0.5 * _KEY * (high - low)[0] / _width_inches(panels[0])
        fastest = max(largest(current.instants) for current in currents)
        draw_key(panels[-1], high - np.array([clear, clear]), fastest, scale)
    entries: dict[str, Artist] = {}
    for axes in panels:
        entries |= {
            label: handle for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)
        }
    figure.legend(
        list(entries.values()), list(entries), loc="lower center", ncols=4, borderaxespad=0.3
    )
    return figure


def _panels(
    low: Float[np.ndarray, "axis=2"], high: Float[np.ndarray, "axis=2"], count: int, run: Run
) -> tuple[Figure, list[Axes]]:
    """Make equal panels that show a window, and the title and colour bar around them.

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
        axes = figure.add_axes((x / WIDTH, z / tall, panel[0] / WIDTH, panel[1] / tall))
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
        axes.locator_params(axis="x", nbins=max(3, int(panel[0] / 0.7)))
        axes.locator_params(axis="y", nbins=max(3, int(panel[1] / 0.45)))
        axes.tick_params(labelbottom=row == rows - 1, labelleft=column == 0)
        axes.set_xlabel(plane.LABELS[0] if row == rows - 1 else "")
        axes.set_ylabel(plane.LABELS[1] if column == 0 else "")
        panels.append(axes)

    time = run.result["time"].values
    if time[-1] > time[0]:
        x = left + columns * panel[0] + (columns - 1) * gap[0] + 0.15
        bar = figure.add_axes((x / WIDTH, below / tall, 0.13 / WIDTH, inner / tall))
        norm = Normalize(float(time[0]), float(time[-1]))
        ticks = MaxNLocator(max(2, min(6, int(inner / 0.4))))
        figure.colorbar(ScalarMappable(norm, time_map()), cax=bar, ticks=ticks, label="time (s)")
        bar.grid(visible=False)
    return figure, panels


def _width_inches(axes: Axes) -> float:
    return float(axes.get_position().width) * WIDTH


def _draw_member(
    axes: Axes,
    data: xr.Dataset,
    low: Float[np.ndarray, "axis=2"],
    high: Float[np.ndarray, "axis=2"],
) -> None:
    shapes = plane.project(data, "position")
    time = data["time"].values
    chosen = np.unique(np.linspace(0, len(time) - 1, min(_SHAPES, len(time))).round().astype(int))

    draw_bodies(axes, find_bodies(data), time, chosen, low, high)
    hull = Polygon(_hull(data), closed=True, facecolor=GREY, edgecolor=INK, linewidth=0.8, zorder=3)
    hull.set_label("submarine's bow")
    axes.add_patch(hull)
    base = shapes[:, 0]
    if np.ptp(base, axis=0).max() > 1e-6:
        axes.plot(*base.T, color=INK, linewidth=0.8, zorder=3.5, label="path of the base")
    if "diameter" in data:
        band = plane.outline(shapes[-1], np.asarray(data["diameter"].values, dtype=float))
        body = Polygon(band, closed=True, facecolor=PALE, edgecolor="#B4BDC2", linewidth=0.6)
        body.set_label("arm at the end")
        axes.add_patch(body)

    lines = LineCollection(
        list(shapes[chosen]),
        array=time[chosen],
        cmap=time_map(),
        norm=Normalize(float(time[0]), float(max(time[-1], time[0] + 1e-12))),
        linewidths=1.0,
        zorder=2,
    )
    axes.add_collection(lines)
    if len(chosen) > 1:
        axes.plot([], [], color=time_map()(0.5), linewidth=1.0, label="arm over time")
    else:
        axes.plot([], [], color=time_map()(0.0), linewidth=1.0, label="arm")
    _draw_tip(axes, data)


def _draw_tip(axes: Axes, data: xr.Dataset) -> None:
    path, target = plane.project(data, "tip_position"), plane.project(data, "tip_target")
    if len(path) > 1:
        axes.plot(*path.T, color=VERMILLION, linewidth=0.8, label="path of the tip", zorder=4)
    moves = np.ptp(target, axis=0).max() > 1e-6
    if moves:
        axes.plot(*target.T, color=INK, linewidth=1.0, linestyle=(0, (4, 2)), zorder=4.5)
    axes.plot(
        *target[-1],
        marker="o",
        markersize=8.5,
        markerfacecolor="none",
        markeredgecolor=INK,
        markeredgewidth=1.2,
        linestyle=(0, (4, 2)) if moves else "none",
        linewidth=1.0,
        color=INK,
        label="target" + (" (ring: at the end)" if moves else ""),
        zorder=5,
    )


def _hull(data: xr.Dataset) -> Float[np.ndarray, "corner axis=2"]:
    """Half an ellipse behind the base, its nose where the arm is held."""
    ahead = plane.direction(base_direction(data, -1))
    aside = plane.left_of(ahead)
    long = _HULL * arm_length(data)
    turn = np.linspace(-np.pi / 2, np.pi / 2, 41)
    nose = plane.project(data, "position")[-1, 0]
    along, across = long * (np.cos(turn) - 1.0), 0.45 * long * np.sin(turn)
    return nose + along[:, None] * ahead + across[:, None] * aside


def _extent(
    members: list[xr.Dataset], currents: list[Current], scale: float
) -> tuple[Float[np.ndarray, "axis=2"], Float[np.ndarray, "axis=2"]]:
    """Corners, in m, of a window that holds everything drawn in any panel."""
    points = [current.corners(scale) for current in currents]
    for data in members:
        thick = float(np.max(data["diameter"].values)) if "diameter" in data else 0.0
        shapes = plane.project(data, "position").reshape(-1, 2)
        points += [shapes - thick / 2, shapes + thick / 2, _hull(data)]
        points += [plane.project(data, "tip_target")]
        points += [corners(find_bodies(data), shapes, arm_length(data))]
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
