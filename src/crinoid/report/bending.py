"""How an arm is bent, pulled and, in space, twisted, along it and over time."""

from __future__ import annotations

import numpy as np
import xarray as xr
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from crinoid.report.arm import chosen_records, hull
from crinoid.report.run import Run
from crinoid.report.scene import DARK, add_arm
from crinoid.report.sheet import LEFT, box_around, fit_scene
from crinoid.report.style import (
    GREY,
    INK,
    PALE,
    WIDTH,
    add_axes,
    head,
    head_height,
    lay_out_below,
    note,
    time_map,
    time_norm,
)
from crinoid.report.units import largest
from crinoid.report.view import in_space, is_spatial

ROWS = {
    "curvature": "curvature\n(1/m)",
    "kappa_1": "curvature $\\kappa_1$\n(1/m)",
    "kappa_2": "curvature $\\kappa_2$\n(1/m)",
    "twist": "twist\n(rad/m)",
    "tension": "tension\n(N)",
}
"""Quantities along the arm, and how they are labelled."""
_KAPPAS = ("kappa_1", "kappa_2")
_STRAIGHT = 1e-9  # 1/m, rad/m or N: less is nothing


def draw_bending(run: Run) -> Figure:
    """Draw bending, tension and twist along the arm, in space below the arm at the end."""
    spatial, count = is_spatial(run.result), len(run.members)
    rows = ["kappa_1", "kappa_2", "twist", "tension"] if spatial else ["curvature", "tension"]
    lines = 0.5 + 1.6 * len(rows)
    arms = (3.5 if count == 1 else 2.5) if spatial else 0.15
    above = head_height(run.title, run.status, WIDTH) + (0.3 if spatial else 0.05)
    tall = lines + arms + above
    figure = Figure(figsize=(WIDTH, tall), layout="constrained")
    head(figure, run.title, run.status)
    if spatial:
        lay_out_below(figure, lines)
    panels = figure.subplots(len(rows), count, sharex=True, sharey="row", squeeze=False)
    for column, (label, data) in enumerate(run.members):
        if spatial:
            wide = (WIDTH - LEFT - 0.4) / count
            arm = add_axes(figure, LEFT + column * wide, lines + 0.5, wide - 0.75, arms - 0.5)
            _draw_frame(arm, run, data)
            arm.set_title(f"{label}, at the end" if label else "arm at the end", loc="left")
        else:
            panels[0, column].set_title(label, loc="left")
        for axes, name in zip(panels[:, column], rows, strict=True):
            draw_lines(axes, data, name)
            if not column:
                axes.set_ylabel(ROWS[name])
        panels[-1, column].set_xlabel("distance from the root (m)")
    for (axes, *_), name in zip(panels, rows, strict=True):
        shown = [_values(data, name) for _, data in run.members]
        if largest(*(values for values in shown if values is not None)) < _STRAIGHT:
            axes.set_ylim(-1.0, 1.0)  # of all columns, which share it
    figure.align_ylabels(panels[:, 0])
    if "director" in run.result:
        halves = [
            Patch(facecolor=DARK, edgecolor=INK, linewidth=0.5, label="side of the director $m_1$"),
            Patch(facecolor=PALE, edgecolor=INK, linewidth=0.5, label="other side"),
        ]
        below = (0.5, lines / tall)
        figure.legend(handles=halves, loc="lower center", bbox_to_anchor=below, ncols=2)
    time = run.result["time"].values
    if time[-1] > time[0]:
        mapped = ScalarMappable(time_norm(run.result), time_map())
        bar = figure.colorbar(mapped, ax=panels, label="time (s)", aspect=40, pad=0.015)
        bar.ax.grid(visible=False)
    return figure


def _draw_frame(axes: Axes, run: Run, data: xr.Dataset) -> None:
    """Draw the arm with the half on its director's side dark, in a box that all runs share."""
    inside = np.concatenate(
        [
            np.concatenate([in_space(member, "position")[-1], hull(member).reshape(-1, 3)])
            for _, member in run.members
        ]
    )
    scene = fit_scene(axes, *box_around(inside))
    add_arm(scene, data)
    if "diameter" not in data:
        scene.add_line(in_space(data, "position")[-1], INK)
    scene.draw()


def draw_lines(axes: Axes, data: xr.Dataset, name: str) -> None:
    """Draw one of `ROWS` along the arm, over time."""
    axes.axhline(0.0, color=GREY, linewidth=0.7)
    values = _values(data, name)
    if values is None:
        note(axes, f"no {'curvature' if name in _KAPPAS else name} recorded")
        return
    if "arc_length" in data:
        nodes = np.asarray(data["arc_length"].values, dtype=float)
    else:
        steps = np.linalg.norm(np.diff(in_space(data, "position")[0], axis=0), axis=1)
        nodes = np.concatenate([[0.0], np.cumsum(steps)])
    arc = nodes if values.shape[1] == nodes.size else (nodes[1:] + nodes[:-1]) / 2
    chosen = chosen_records(data)
    lines = [np.column_stack([arc, values[record]]) for record in chosen]
    widths = np.where(chosen == chosen[-1], 1.8, 0.9)
    axes.add_collection(
        LineCollection(
            lines,
            array=data["time"].values[chosen],
            cmap=time_map(),
            norm=time_norm(data),
            linewidths=widths,
        )
    )
    axes.autoscale_view()
    axes.set_xlim(0.0, float(nodes[-1]))


def _values(data: xr.Dataset, name: str) -> Float[np.ndarray, "time place"] | None:
    if name in _KAPPAS:
        bent = "curvature" in data and "bending" in data.coords
        return np.asarray(data["curvature"].sel(bending=name).values) if bent else None
    return np.asarray(data[name].values) if name in data else None
