"""The water's velocity as arrows beside the arm."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import xarray as xr
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection

from crinoid.report.style import BLUE, GREY, SKY
from crinoid.report.units import largest
from crinoid.report.view import View, arm_length, in_space, left_of

_PLACES = 6
_INSTANTS = 12
_REACH = 0.20  # length of the longest arrow, of the arm's length
_SPACING = 0.07  # arrows closer than this, of the arm's length, are left out


@dataclass(frozen=True)
class Current:
    """Arrows on paper: where they start (m), the mean and some instants of the velocity (m/s)."""

    start: Float[np.ndarray, "place axis=2"]
    mean: Float[np.ndarray, "place axis=2"]
    instants: Float[np.ndarray, "instant place axis=2"]
    scale: float  # m/s of water per m of arrow that suits this run; 0: still water

    def corners(self, scale: float) -> Float[np.ndarray, "point axis=2"]:
        """Points that a window must hold so that no arrow is cut."""
        if self.scale == 0.0:
            return self.start
        heads = self.start + self.instants / scale
        return np.concatenate([self.start, heads.reshape(-1, 2)])

    def draw(self, axes: Axes, scale: float) -> None:
        """Draw the arrows on paper, at a scale in m/s per m that runs drawn side by side share."""
        if self.scale == 0.0:
            axes.set_title("still water", loc="right", color=GREY, fontsize=8.5)
            return
        if not np.allclose(self.instants, self.mean, atol=2e-2 * largest(self.instants)):
            start = np.broadcast_to(self.start, self.instants.shape)
            threads = np.stack([start, start + self.instants / scale], axis=-2).reshape(-1, 2, 2)
            lines = LineCollection(list(threads), colors=SKY, alpha=0.6, linewidths=0.8)
            lines.set_label("water, instants")
            axes.add_collection(lines, autolim=False)
        _arrows(axes, self.start, self.mean, scale)
        axes.plot([], [], color=BLUE, linewidth=1.8, label="water, mean")


def draw_key(axes: Axes, corner: Float[np.ndarray, "axis=2"], fastest: float, scale: float) -> None:
    """Draw the arrow that says how fast the water is, its head at a corner given in m."""
    speed = _round_down(0.85 * fastest)
    tail = corner - np.array([speed / scale, 0.0])
    _arrows(axes, tail[None], np.array([[speed, 0.0]]), scale)
    axes.annotate(
        f"water {speed:g} m/s",
        (float(tail[0]), float(tail[1])),
        xytext=(-5, 0),
        textcoords="offset points",
        ha="right",
        va="center",
        fontsize=8.5,
        annotation_clip=False,
    )


def find_current(data: xr.Dataset, view: View) -> Current:
    """Choose where along the arm to show the flow, and how long the arrows are.

    The arrows start beside everything the arm sweeps, on the side the water comes from if it comes
    from a side, so that they neither hide the arm nor are hidden.
    """
    nothing = Current(np.empty((0, 2)), np.empty((0, 2)), np.empty((0, 0, 2)), 0.0)
    if "flow_velocity" not in data:
        return nothing
    flow = view.project(data, "flow_velocity")
    records, nodes = flow.shape[:2]
    shapes = view.project(data, "position")
    mean_shape = shapes.mean(axis=0)
    length = arm_length(data)

    chosen: list[int] = []
    for node in np.linspace(0, nodes - 1, min(_PLACES, nodes)).round().astype(int):
        apart = [np.linalg.norm(mean_shape[node] - mean_shape[other]) for other in chosen]
        if not apart or min(apart) > _SPACING * length:
            chosen.append(int(node))
    times = np.linspace(0, records - 1, min(_INSTANTS, records)).round().astype(int)
    mean, instants = flow[:, chosen].mean(axis=0), flow[times][:, chosen]
    # of all places and in space, so that all views have one scale
    speed = np.linalg.norm(in_space(data, "flow_velocity")[times], axis=-1)
    fastest = float(speed.max(initial=0.0))
    if not math.isfinite(fastest) or fastest < 1e-9:
        return nothing

    chord = mean_shape[-1] - mean_shape[0]
    if np.linalg.norm(chord) < 0.05 * length:
        chord = mean_shape[1] - mean_shape[0]
    if np.linalg.norm(chord) < 1e-3 * length / nodes:  # seen from its end
        chord = np.array([1.0, 0.0])
    aside = left_of(chord)
    swept = np.concatenate([shapes.reshape(-1, 2), view.project(data, "tip_target")])
    heights = (swept - mean_shape[0]) @ aside
    across = float(mean.mean(axis=0) @ aside)
    if abs(across) > 0.2 * float(np.linalg.norm(mean.mean(axis=0))):
        side = -np.sign(across)
    else:
        side = 1.0 if heights.max() <= -heights.min() + 1e-9 else -1.0
    clear = float((side * heights).max()) + (0.06 + _REACH) * length
    along = (mean_shape[chosen] - mean_shape[0]) @ aside
    start = mean_shape[chosen] + (side * clear - along)[:, None] * aside
    return Current(start, mean, instants, fastest / (_REACH * length))


def _arrows(
    axes: Axes,
    start: Float[np.ndarray, "place 2"],
    flow: Float[np.ndarray, "place 2"],
    scale: float,
) -> None:
    axes.quiver(
        *start.T,
        *flow.T,
        angles="xy",
        scale_units="xy",
        scale=scale,
        units="inches",
        width=0.022,
        color=BLUE,
        zorder=4,
        clip_on=False,
    )


def _round_down(value: float) -> float:
    """Largest of 1, 2, 5 times a power of ten that is not above the value."""
    power = 10.0 ** math.floor(math.log10(value))
    return float(f"{max(m for m in (1, 2, 5) if m * power <= value * (1 + 1e-12)) * power:.3g}")
