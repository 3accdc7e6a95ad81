"""Over which frequencies the fluctuations of a sampled current spread."""

from __future__ import annotations

import numpy as np
import xarray as xr
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from crinoid.report.flow import COLOURS, differ, title
from crinoid.report.style import GREY, INK, SKY, WIDTH, head, key, note

_NOTHING = 1e-14  # of the square of a metre a second, a second: round-off
_DECADES = 7


def draw_spectrum(flow: xr.Dataset) -> Figure:
    """Draw the spectral density of each component, and that of turbulence where it was random."""
    figure = Figure(figsize=(WIDTH, 4.4), layout="constrained")
    panels = list(figure.subplots(1, 2, sharey=True))
    frequency = flow["frequency"].values
    density = flow["flow_spectrum"].values
    shown = density[density > _NOTHING]
    model = flow.get("model_spectrum")
    for index, (axes, axis) in enumerate(zip(panels, "xz", strict=True)):
        _component(axes, flow, axis, frequency, density[..., index])
        if model is not None and density[:, 1, index].max() > _NOTHING:
            _turbulence(axes, frequency, model.values[:, index], str(model.attrs["long_name"]))
        axes.set_xlabel("frequency (Hz)")
        key(axes, columns=1)
    if shown.size:
        top = 3 * shown.max()
        panels[0].set_ylim(max(0.3 * shown.min(), top / 10**_DECADES), top)
    panels[0].set_ylabel("spectral density (m²/s)")
    head(figure, title(flow), "ok")
    return figure


def _component(
    axes: Axes,
    flow: xr.Dataset,
    axis: str,
    frequency: Float[np.ndarray, " frequency"],
    density: Float[np.ndarray, "frequency place"],
) -> None:
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlim(frequency[0], frequency[-1])
    if density[:, 1].max() <= _NOTHING:
        note(axes, f"velocity {axis} is steady")
        return
    if differ(flow) and density[:, 0].max() > _NOTHING:
        axes.plot(frequency, density[:, 0], color=GREY, linewidth=0.9, label="root")
        label = f"velocity {axis} at the tip"
    else:
        label = f"velocity {axis}"
    axes.plot(frequency, density[:, 1], color=COLOURS[axis], linewidth=1.1, label=label)


def _turbulence(
    axes: Axes,
    frequency: Float[np.ndarray, " frequency"],
    model: Float[np.ndarray, " frequency"],
    words: str,
) -> None:
    if not np.isfinite(model).all():
        return
    lines = words.replace(" of the same", "\nof the same").replace(", as", ",\nas")
    axes.plot(frequency, model, color=INK, linestyle=(0, (4, 2)), linewidth=1.1, label=lines)
    # beside the model, where it has come down to its own slope
    where = frequency > np.sqrt(frequency[0] * frequency[-1])
    slope = 4 * model[-1] * (frequency[where] / frequency[-1]) ** (-5 / 3)
    axes.plot(frequency[where], slope, color=SKY, linewidth=1.1, label="slope \N{MINUS SIGN}5/3")
