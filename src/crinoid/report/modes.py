"""The small vibrations that `crinoid modes` found, drawn on the arm."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import xarray as xr
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from crinoid.report.run import load_as
from crinoid.report.style import (
    BLUE,
    GREY,
    INK,
    SKY,
    VERMILLION,
    WIDTH,
    add_axes,
    head,
    head_height,
)
from crinoid.report.units import largest
from crinoid.report.view import OBLIQUE, SIDE, View, in_space, is_spatial
from crinoid.status import Status

MODES = "modes.nc"

_REQUIRED = {
    "frequency": ("medium", "mode"),
    "damping_ratio": ("medium", "mode"),
    "shape": ("medium", "mode", "node", "axis"),
    "shape_quadrature": ("medium", "mode", "node", "axis"),
    "position": ("medium", "node", "axis"),
}
_ACROSS = 6  # modes beside each other
_SWING = 0.22  # how far a mode is drawn to swing, of the arm's length
_PHASES = np.linspace(0.0, 2 * np.pi, 16, endpoint=False)
_STILL = 0.02  # largest movement of a mode that is one of spins
_NOTHING = 1e-6  # damping ratio that is none
_GAP = (0.12, 0.4)  # inches, that above a panel for its title
_LEFT, _BELOW, _HEADING, _HIGHEST = 0.12, 0.42, 0.28, 2.3  # inches


def open_modes(path: Path) -> xr.Dataset:
    """Read modes into memory."""
    return load_as(path, "modes", _REQUIRED)


def draw_modes(modes: xr.Dataset) -> Figure:
    """Draw each mode on the arm at rest, a medium below the other, all at one scale."""
    view = OBLIQUE if is_spatial(modes) else SIDE
    media = [modes.isel(medium=[index]) for index in range(modes.sizes["medium"])]
    across = min(_ACROSS, modes.sizes["mode"])
    rows = -(-modes.sizes["mode"] // across)
    windows = [_window(here, view) for here in media]
    room = (WIDTH - 2 * _LEFT - (across - 1) * _GAP[0]) / across
    extents = np.array([high - low for low, high in windows])
    inch = min(room / extents[:, 0].max(), _HIGHEST / extents[:, 1].max())

    title = str(modes.attrs.get("title", "")).strip() or "modes"
    status = str(modes.attrs.get("status", "")) or Status.OK.value
    blocks = [_HEADING + rows * (float(extent[1]) * inch + _GAP[1]) for extent in extents]
    top = head_height(title, status, WIDTH) + sum(blocks) + _BELOW
    figure = Figure(figsize=(WIDTH, top))
    head(figure, title, status)
    top -= head_height(title, status, WIDTH)
    for here, (low, high), block in zip(media, windows, blocks, strict=True):
        medium = str(here["medium"].item())
        place = (_LEFT / WIDTH, (top - 0.22) / float(figure.get_size_inches()[1]))
        figure.text(*place, medium, fontweight="bold")
        wide, tall = (high - low) * inch
        for index in range(modes.sizes["mode"]):
            row, column = divmod(index, across)
            left = _LEFT + column * (room + _GAP[0]) + (room - wide) / 2
            foot = top - _HEADING - row * (tall + _GAP[1]) - _GAP[1] - tall
            axes = add_axes(figure, left, foot, wide, tall)
            axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
            axes.set_axis_off()
            _draw(axes, here.isel(mode=index), view)
        top -= block
    lines = {"at rest": GREY, "swung out": BLUE, "half a period later": VERMILLION}
    handles = [Line2D([], [], color=colour, label=label) for label, colour in lines.items()]
    handles.append(Line2D([], [], color=SKY, linewidth=0.6, label="in between"))
    figure.legend(handles=handles, loc="lower center", ncols=4, borderaxespad=0.3)
    return figure


def _draw(axes: Axes, mode: xr.Dataset, view: View) -> None:
    frequency, ratio = float(mode["frequency"].item()), float(mode["damping_ratio"].item())
    if np.isnan(frequency):
        return
    told = f"{frequency:.3g} Hz" if frequency > 0 else "no swing"
    told += "" if np.isnan(ratio) else f"\n$\\zeta$ = {0.0 if abs(ratio) < _NOTHING else ratio:.2g}"
    axes.set_title(f"{int(mode['mode'])}: {told}", fontsize=8.0, pad=3)
    rest, swings = _swings(mode, view)
    drawn = LineCollection(list(swings), colors=SKY, linewidths=0.5, alpha=0.7)
    axes.add_collection(drawn, autolim=False)
    axes.plot(*rest.T, color=GREY)
    for swing, colour in ((swings[0], BLUE), (swings[len(swings) // 2], VERMILLION)):
        axes.plot(*swing.T, color=colour, marker=".", markersize=2.5)
    axes.plot(*rest[0], color=INK, marker="s", markersize=4.0)
    if largest(in_space(mode, "shape")) < _STILL:
        x, z = map(float, rest[len(rest) // 2])
        axes.text(x, z, " twists", color=INK, fontsize=8.0)


def _swings(
    mode: xr.Dataset, view: View
) -> tuple[Float[np.ndarray, "node 2"], Float[np.ndarray, "phase node 2"]]:
    """Return the arm at rest on paper, and as it swings."""
    rest = in_space(mode, "position")
    length = np.linalg.norm(np.diff(rest.squeeze(), axis=0), axis=1).sum()
    cosine, sine = (wave(_PHASES)[:, None, None] for wave in (np.cos, np.sin))
    moved = cosine * in_space(mode, "shape") + sine * in_space(mode, "shape_quadrature")
    moved *= _SWING * length / max(largest(moved), _STILL)
    return view.paper(rest.squeeze()), view.paper(rest.squeeze() + moved)


def _window(
    here: xr.Dataset, view: View
) -> tuple[Float[np.ndarray, "axis=2"], Float[np.ndarray, "axis=2"]]:
    """Return corners (m) of a window that holds all modes of a medium."""
    points = np.concatenate(
        [
            points.reshape(-1, 2)
            for index in range(here.sizes["mode"])
            for points in _swings(here.isel(mode=index), view)
        ]
    )
    low, high = np.nanmin(points, axis=0), np.nanmax(points, axis=0)
    margin = 0.03 * float((high - low).max())
    return low - margin, high + margin
