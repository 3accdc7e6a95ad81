"""Figure of equilibria over a number of a scenario: bending curves and their hysteresis."""

from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from crinoid.results.scene.data import even_indices, in_space, is_spatial
from crinoid.results.scene.projection import OBLIQUE, SIDE
from crinoid.results.units import Unit, largest
from crinoid.view.figures import style

_SHAPES = 60  # most shapes of a branch
_LOOKS: dict[str, Any] = {"forward": "-", "backward": (0, (3, 1.5))}
_COLOURS = {"forward": style.BLUE, "backward": style.VERMILLION}


def draw_curve(data: xr.Dataset) -> Figure:
    """Draw turn and position of the tip and the largest curvature over the key, and the shapes."""
    key = str(data.attrs["varied"])
    unit = _unit(data[key])
    name = f"{key} ({unit.name})" if unit.name else key
    across = style.columns(3.0, 2)
    figure = style.new_figure(6.0 if across == 2 else 9.0)
    turn, shapes, tip, curvature = figure.subplots(4 // across, across).flat
    x = data[key].values * unit.factor
    two = data.sizes["branch"] > 1
    for branch in map(str, data["branch"].values):
        here = data.sel(branch=branch)
        look: Any = {"linestyle": _LOOKS[branch], "marker": ".", "markersize": 3.0}
        for axes, values in (
            (turn, np.rad2deg(here["tip_turn"])),
            (curvature, here["max_curvature"]),
        ):
            axes.plot(x, values, color=_COLOURS[branch], label=branch if two else None, **look)
        away = here["tip_position"] - here["position"].isel(node=0)
        for axis in map(str, data["axis"].values):
            label = f"{axis} {branch}" if two else axis
            tip.plot(x, away.sel(axis=axis), color=style.AXIS_COLOURS[axis], label=label, **look)
    for axes in (turn, tip, curvature):
        axes.set_xlabel(name)
        style.key(axes, columns=2)
    turn.set_ylabel("turn of the tip (deg)")
    tip.set_ylabel("tip from the root (m)")
    curvature.set_ylabel("largest curvature (1/m)")
    _draw_shapes(figure, shapes, data, name, x)
    style.head_of(figure, data, "equilibria")
    return figure


def _draw_shapes(figure: Figure, axes: Axes, data: xr.Dataset, label: str, x: np.ndarray) -> None:
    view = OBLIQUE if is_spatial(data) else SIDE
    points = view.paper(in_space(data, "position"))
    chosen = even_indices(x.size, _SHAPES)
    for branch, shapes in zip(data["branch"].values, points, strict=True):
        look = {"linestyles": _LOOKS[str(branch)], "linewidths": 0.9}
        lines = LineCollection(shapes[chosen], **style.timed(x, chosen), **look)
        axes.add_collection(lines)
    axes.plot(*points[0, :1, 0].T, color=style.INK, marker="s", markersize=4.0)
    axes.autoscale_view()
    axes.set_aspect("equal", adjustable="datalim")
    if view is SIDE:
        across, up = view.labels
        axes.set(xlabel=across, ylabel=up)
    else:
        axes.set_axis_off()
    figure.colorbar(lines, ax=axes, label=label).ax.grid(visible=False)


def _unit(values: xr.DataArray) -> Unit:
    """Return the unit of a key's values; large pressures are in kPa."""
    name = str(values.attrs.get("units", ""))
    large = name == "Pa" and largest(values.values) >= 1e4
    return Unit(1e-3, "kPa") if large else Unit(1.0, name)
