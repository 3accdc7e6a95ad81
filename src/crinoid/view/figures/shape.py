"""Shape of the arm over time, its bending, cycles and tension, and the path of its tip close up."""

from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle
from matplotlib.ticker import LogLocator, NullFormatter
from matplotlib.transforms import Bbox

from crinoid.results.errors import judged_or_all
from crinoid.results.loads import BendingCycles, bending_cycles
from crinoid.results.result import Result
from crinoid.results.scene.data import arc_length, arm_length, in_space, is_spatial, target_word
from crinoid.results.scene.mesh import AROUND, arm_facets
from crinoid.results.scene.projection import ABOVE, AHEAD, SIDE, PaperPoint, View
from crinoid.results.units import largest, length_unit
from crinoid.view.figures import style
from crinoid.view.figures.arm import chosen_records, draw_arm, mount_points, points_of
from crinoid.view.figures.charts.chart import MEMBER_ROLES
from crinoid.view.figures.charts.spectra import miss, spectrum_panel
from crinoid.view.figures.painter import Surface
from crinoid.view.figures.paper import colour, draw_panel
from crinoid.view.figures.perspective import draw_end
from crinoid.view.figures.sheet import LEFT, box_around, in_best_frame, measured_from
from crinoid.view.figures.surroundings import CurrentArrows, draw_key, find_current, tool_facets

ROWS = {
    "curvature": "curvature\n(1/m)",
    "kappa_1": "curvature $\\kappa_1$\n(1/m)",
    "kappa_2": "curvature $\\kappa_2$\n(1/m)",
    "twist": "twist\n(rad/m)",
    "tension": "tension\n(N)",
}
"""Quantities along the arm, and how they are labelled."""
_KAPPAS = ("kappa_1", "kappa_2")
_STRAIGHT = 1e-9  # N: less is nothing


def quantities_along(data: xr.Dataset) -> list[str]:
    """Return those of `ROWS` that an arm has, in the plane or in space."""
    return [*_KAPPAS, "twist", "tension"] if is_spatial(data) else ["curvature", "tension"]


def draw_bending(run: Result) -> Figure:
    """Draw bending, tension and twist along the arm, in space below the arm at the end."""
    spatial, count = is_spatial(run.dataset), len(run.members)
    rows = quantities_along(run.dataset)
    rows = [name for name in rows if not _is_nothing(run, name)] or rows[:1]
    lines = style.scale() * (0.5 + 1.6 * len(rows))
    across = 1 if style.narrow() else count
    high = 2.3 if style.narrow() else 3.5 if count == 1 else 2.5
    arms = high * (count // across) if spatial else 0.15
    above = style.head_height(run.title, run.status) + (0.3 if spatial else 0.05)
    tall = lines + arms + above
    figure = Figure(figsize=(style.width(), tall), layout="constrained")
    style.head(figure, run.title, run.status)
    if spatial:
        style.lay_out_below(figure, lines)
    panels = figure.subplots(len(rows), count, sharex=True, sharey="row", squeeze=False)
    for column, (label, each) in enumerate(run.members):
        data = each.dataset
        if spatial:
            wide, (up, right) = (style.width() - LEFT - 0.4) / across, divmod(column, across)
            foot = lines + 0.5 + (count // across - 1 - up) * high
            arm = style.add_axes(figure, LEFT + right * wide, foot, wide - 0.75, high - 0.5)
            inside = [one.position[-1] for one in run.scene.members]
            inside.append(mount_points(run.scene))
            inside += [tool_facets(one).reshape(-1, 3) for one in run.scene.members if one.held[-1]]
            box = box_around(np.concatenate(inside))
            alone = replace(run.scene.members[column], obstacles=())
            draw_end(arm, run.scene, alone, box, arm=_halves(data))
            arm.set_title(f"{label}, at the end" if label else "arm at the end", loc="left")
        else:
            panels[0, column].set_title(label, loc="left")
        for axes, name in zip(panels[:, column], rows, strict=True):
            draw_lines(axes, data, name)
            if not column:
                axes.set_ylabel(ROWS[name])
    figure.supxlabel("distance from the root (m)")
    if _is_nothing(run, rows[0]):
        panels[0, 0].set_ylim(-1.0, 1.0)  # of all columns, which share it
    figure.align_ylabels(panels[:, 0])
    if "director" in run.dataset:
        sides = {"side of the director $m_1$": _DARK, "other side": style.PALE}
        look: Any = {"edgecolor": style.INK, "linewidth": 0.5}
        halves = [Patch(facecolor=ink, label=label, **look) for label, ink in sides.items()]
        below = (0.5, lines / tall)
        figure.legend(handles=halves, loc="lower center", bbox_to_anchor=below, ncols=2)
    style.time_bar(figure, run.dataset, ax=panels, label="time (s)", aspect=40, pad=0.015)
    return figure


def _is_nothing(run: Result, name: str) -> bool:
    """Whether one of `ROWS` is known, and is zero throughout but for round-off."""
    shown = [_values(each.dataset, name) for _, each in run.members]
    least = _STRAIGHT if name == "tension" else 1e-6 / arm_length(run.dataset)
    known = [values for values in shown if values is not None]
    return bool(known) and largest(*known) < least


_DARK = "#6F8591"  # the half of the arm that is on the side of its director m_1


def _halves(data: xr.Dataset) -> Surface | None:
    """Return the arm at the end, half of it dark where its director is known."""
    if "director" not in data or "diameter" not in data:
        return None
    position, director = in_space(data, "position")[-1], in_space(data, "director")[-1]
    facets = arm_facets(position, data["diameter"].values.astype(float), director)
    colours = np.tile(to_rgba(style.PALE), (len(facets), 1))
    around = np.arange(len(facets)) % AROUND
    colours[(around + AROUND // 4) % AROUND <= AROUND // 2] = to_rgba(_DARK)
    return Surface(facets, colours)


def draw_lines(axes: Axes, data: xr.Dataset, name: str) -> None:
    """Draw one of `ROWS` along the arm, over time."""
    axes.axhline(0.0, color=style.GREY, linewidth=0.7)
    values = _values(data, name)
    if values is None:
        style.note(axes, f"no {'curvature' if name in _KAPPAS else name} recorded")
        return
    nodes = arc_length(data)
    arc = nodes if values.shape[1] == nodes.size else (nodes[1:] + nodes[:-1]) / 2
    chosen = chosen_records(data.sizes["time"])
    lines = [np.column_stack([arc, values[record]]) for record in chosen]
    widths = np.where(chosen == chosen[-1], 1.8, 0.9)
    axes.add_collection(
        LineCollection(lines, linewidths=widths, **style.timed(data["time"].values, chosen))
    )
    axes.autoscale_view()
    axes.set_xlim(0.0, float(nodes[-1]))


def _values(data: xr.Dataset, name: str) -> Float[np.ndarray, "time place"] | None:
    if name in _KAPPAS:
        bent = "curvature" in data and "bending" in data.coords
        return np.asarray(data["curvature"].sel(bending=name).values) if bent else None
    return np.asarray(data[name].values) if name in data else None


def has_cycles(run: Result) -> bool:
    """Whether the arm bends to and fro."""
    return any(found.number > 0 for found in _cycles(run).values())


def draw_cycles(run: Result) -> Figure:
    """Draw the cumulative number of cycles over their range, where the range is largest."""
    figure = style.new_figure(3.4)
    axes = figure.subplots()
    for (who, found), role in zip(_cycles(run).items(), MEMBER_ROLES, strict=False):
        if not found.number:
            continue
        place = length_unit(run.known_scenario.arm.length).text(found.station)
        words = f"{found.number:g} cycles {place} from the root, equivalent range "
        words += f"{found.equivalent_range:.3g} 1/m"
        ranges, counts = np.append(found.ranges, 0.0), np.cumsum(found.counts)
        label = ": ".join(part for part in (who, words) if part)
        axes.stairs(counts[::-1], ranges[::-1], color=colour(role), label=label, baseline=None)
    axes.set(xlabel="range of curvature (1/m)", ylabel="cycles of at least this range")
    axes.set_yscale("log")
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.set_xlim(left=0.0)
    style.key(axes, 1)
    style.head(figure, run.title, run.status)
    return figure


def _cycles(run: Result) -> dict[str, BendingCycles]:
    found = {who: bending_cycles(each) for who, each in run.members}
    return {who: each for who, each in found.items() if each is not None}


_MARGIN = 0.04  # around everything, of the larger extent
_TALLEST = 5.2  # inches, of all panels
_KEY_WIDE = 1.9  # inches, of a key beside the panels
_KEY = 0.24  # inches kept clear at the top for the arrow that says how fast the water is


def draw_shape(run: Result) -> Figure:
    """Draw the arm over time, and the arm without control at the same scale where it exists."""
    run, about = in_best_frame(run)
    currents = [find_current(each, SIDE) for _, each in run.members]
    scale = max(current.scale for current in currents)
    low, high = _extent(run, currents, scale)
    figure, panels, beside = _panels(low, high, run, about)
    for index, (axes, current) in enumerate(zip(panels, currents, strict=True)):
        draw_arm(axes, run, index, (SIDE.lift(low), SIDE.lift(high)), SIDE)
        current.draw(axes, scale)
        axes.set_title(run.members[index][0], loc="left")
    if scale > 0.0:
        wide = float(panels[0].get_position().width) * style.width()  # inches
        clear = 0.5 * _KEY * (high - low)[0] / wide
        fastest = max(largest(current.instants) for current in currents)
        draw_key(panels[-1], high - np.array([clear, clear]), fastest, scale)
    style.key_of(figure, panels, "center right" if beside else "lower center")
    return figure


def _panels(
    low: PaperPoint, high: PaperPoint, run: Result, about: str
) -> tuple[Figure, list[Axes], bool]:
    """Return axes of equal size with the limits of a window, and whether a legend fits at right.

    `about` is the origin of positions, other than that of the world. Equal axes leave a layout
    engine gaps, so the figure is cut to the panels instead; everything here is in inches.
    """
    window, count = high - low, len(run.members)
    columns = count if window[1] > 0.75 * window[0] else 1
    rows = count // columns
    left, right, gap = 0.85 * style.scale(), 1.0, (0.25, 0.32)
    below = 0.5 * style.scale()
    if style.narrow():
        right, below = 0.12, below + (style.BAR_BELOW if run.dataset.sizes["time"] > 1 else 0.0)
    inside = style.width() - left - right - gap[0] * (columns - 1)
    panel = window * min(inside / columns / window[0], _TALLEST * style.scale() / rows / window[1])
    # narrow panels leave room for the key beside them
    free = inside - columns * panel[0]
    beside = bool(free > _KEY_WIDE)
    left += 0.0 if beside else free / 2
    inner = rows * panel[1] + (rows - 1) * gap[1]

    above = style.head_height(run.title, run.status) + (0.3 if count > 1 else 0.22)
    tall = below + inner + above
    figure = Figure(figsize=(style.width(), tall))
    style.head(figure, run.title, run.status)
    panels = []
    for place in range(count):
        row, column = divmod(place, columns)
        x = left + column * (panel[0] + gap[0])
        z = below + inner - panel[1] - row * (panel[1] + gap[1])
        axes = style.add_axes(figure, x, z, *map(float, panel))
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
        axes.locator_params(axis="x", nbins=max(3, int(panel[0] / 0.7)))
        axes.locator_params(axis="y", nbins=max(3, int(panel[1] / 0.45)))
        axes.tick_params(labelbottom=row == rows - 1, labelleft=column == 0)
        across, up = measured_from(SIDE, about)
        axes.set_xlabel(across if row == rows - 1 else "")
        axes.set_ylabel(up if column == 0 else "")
        panels.append(axes)
    across = columns * panel[0] + (columns - 1) * gap[0]
    style.time_bar_at(figure, run.dataset, Bbox.from_bounds(left, below, across, inner))
    return figure, panels, beside


def _extent(
    run: Result, currents: list[CurrentArrows], scale: float
) -> tuple[PaperPoint, PaperPoint]:
    """Corners (m) of a window that contains everything drawn in any panel."""
    points = [current.corners(scale) for current in currents]
    everything = np.concatenate([*points, SIDE.paper(points_of(run.scene))])
    low, high = np.nanmin(everything, axis=0), np.nanmax(everything, axis=0)
    margin = _MARGIN * float((high - low).max())
    low, high = low - margin, high + margin
    # A straight arm in still water has hardly any width; the panel must have some.
    lacking = np.maximum(np.array([0.4, 0.2]) * (high - low).max() - (high - low), 0.0)
    low, high = low - lacking / 2, high + lacking / 2
    if scale > 0.0:
        high[1] += _KEY / (2.0 if style.narrow() else 5.0) * float((high - low).max())
    return low, high


def draw_close_up(run: Result) -> Figure:
    """Draw the tip's path about its target, each run at its own scale, and the error's spectrum."""
    views = (ABOVE, SIDE, AHEAD) if is_spatial(run.dataset) else (SIDE,)
    members = [(label, each.dataset) for label, each in run.members]
    # planar runs are drawn next to each other, those in space below each other
    shape = len(members), len(views)
    turned = style.narrow() or len(views) == 1
    down, across = shape[::-1] if turned else shape
    high = 2.5 * down if max(shape) > 1 else 4.2
    high = 1.2 + 2.2 * down if style.narrow() else high
    figure = style.new_figure(3.7 + high)
    rows = figure.add_gridspec(2, 1, height_ratios=[high, 2.6])
    panels = rows[0].subgridspec(down, across).subplots(squeeze=False)
    panels = panels.T if turned else panels
    misses = [miss(run, data) for _, data in members]
    # each at its own scale, and the smaller window shown in the larger one
    halves = [1.1 * (largest(each) or 5e-4) for each in misses]
    for some, (label, each), off, half in zip(panels, run.members, misses, halves, strict=True):
        data = each.dataset
        for axes, view in zip(some, views, strict=True):
            _path(axes, data, view, off, half)
            if half > halves[0]:
                unit = length_unit(half)
                corner, wide = -halves[0] * unit.factor, 2 * halves[0] * unit.factor
                window = Rectangle((corner, corner), wide, wide, fill=False, edgecolor=style.INK)
                window.set(zorder=4, label="window with control")
                axes.add_patch(window)
        rms = float(np.sqrt(np.nanmean(np.sum(off[judged_or_all(each)] ** 2, axis=1))))
        words = [f"{label}:"] if label else []
        between = "\n" if style.narrow() else " "
        words.append(f"RMS {length_unit(half).text(rms)}")
        some[0].set_title(between.join(words), loc="left")
    side = {"location": "bottom"} if style.narrow() else {}
    style.time_bar(figure, run.dataset, ax=panels, label="time (s)", aspect=25, **side)
    spectrum = figure.add_subplot(rows[1])
    draw_panel(spectrum, spectrum_panel(run))
    spectrum.set_xlabel("frequency (Hz)")
    style.key_of(figure, panels.flat)
    style.head(figure, run.title, run.status)
    return figure


def _path(
    axes: Axes, data: xr.Dataset, view: View, off: Float[np.ndarray, "time axis=3"], half: float
) -> None:
    unit = length_unit(half)
    points = view.paper(off) * unit.factor
    axes.axhline(0.0, color=style.GREY, linewidth=0.7)
    axes.axvline(0.0, color=style.GREY, linewidth=0.7)
    pieces = np.stack([points[:-1], points[1:]], axis=1)
    later = np.arange(1, len(points))
    line = LineCollection(list(pieces), linewidths=0.9, **style.timed(data["time"].values, later))
    axes.add_collection(line, autolim=False)
    axes.plot(
        *points[-1], "o", color=style.VERMILLION, markersize=4, zorder=5, label="tip at the end"
    )
    word = target_word(Result(data))
    (ring,) = axes.plot(0.0, 0.0, "o", markersize=8.5, mfc="none", mec=style.INK, mew=1.2)
    ring.set(zorder=5, label=word)
    limit = half * unit.factor
    axes.set(xlim=(-limit, limit), ylim=(-limit, limit), aspect="equal")
    across, up = (label.split()[0] for label in view.labels)
    axes.set_xlabel(f"{across} \N{MINUS SIGN} {word} ({unit.name})")
    axes.set_ylabel(f"{up} \N{MINUS SIGN} {word} ({unit.name})")
