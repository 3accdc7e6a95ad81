"""Over which frequencies the fluctuations of a sampled current spread."""

from __future__ import annotations

import numpy as np
import xarray as xr
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from crinoid.report.flow import axes_of, differ, title
from crinoid.report.style import AXIS_COLOURS, GREY, INK, SKY, WIDTH, head, key, note

_NOTHING = 1e-14  # of the square of a metre a second, a second: round-off
_DECADES = 5
_BANDS = 8  # to a decade: wide enough for each to hold some of the modes of random turbulence


def draw_spectrum(flow: xr.Dataset) -> Figure:
    """Draw the spectral density of each component, and that of turbulence where it was random."""
    names = axes_of(flow)
    figure = Figure(figsize=(WIDTH, 4.8), layout="constrained")
    panels = list(figure.subplots(1, len(names), sharey=True))
    frequency, density = _bands(flow["frequency"].values, flow["flow_spectrum"].values)
    shown = density[density > _NOTHING]
    model = flow.get("model_spectrum")
    for index, (axes, axis) in enumerate(zip(panels, names, strict=True)):
        _component(axes, flow, axis, frequency, density[..., index])
        if model is not None and density[:, 1, index].max() > _NOTHING:
            finest = flow["frequency"].values
            _turbulence(axes, finest, model.values[:, index], str(model.attrs.get("comment", "")))
        rate = flow["flow_spectrum"].attrs.get("record_rate_hz")
        if rate is not None and rate / 2 < frequency[-1]:
            axes.axvline(rate / 2, color=INK, linewidth=0.8, label="half the record's rate")
        axes.set_xlabel("frequency (Hz)")
        key(axes, columns=1)
    if shown.size:
        top = 3 * shown.max()
        panels[0].set_ylim(max(0.3 * shown.min(), top / 10**_DECADES), top)
    panels[0].set_ylabel("spectral density (m²/s)")
    head(figure, title(flow), "ok")
    return figure


def _bands(
    frequency: Float[np.ndarray, " frequency"], density: Float[np.ndarray, "frequency place axis"]
) -> tuple[Float[np.ndarray, " band"], Float[np.ndarray, "band place axis"]]:
    """Average over bands as wide as they are far up: a line of even roughness in a log plot."""
    band = np.floor(_BANDS * np.log10(frequency / frequency[0]) + 1e-9)
    starts = np.flatnonzero(np.diff(band, prepend=-1.0))
    count = np.diff(starts, append=frequency.size)
    middle = np.add.reduceat(frequency, starts) / count
    return middle, np.add.reduceat(density, starts, axis=0) / count[:, None, None]


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
    axes.plot(frequency, density[:, 1], color=AXIS_COLOURS[axis], linewidth=1.1, label=label)


def _turbulence(
    axes: Axes,
    frequency: Float[np.ndarray, " frequency"],
    model: Float[np.ndarray, " frequency"],
    words: str,
) -> None:
    if not np.isfinite(model).all():
        return
    label = f"von Karman, {words}".removesuffix(", ")
    axes.plot(frequency, model, color=INK, linestyle=(0, (4, 2)), linewidth=1.1, label=label)
    # beside the model, where it has come down to its own slope
    where = frequency > np.sqrt(frequency[0] * frequency[-1])
    slope = 4 * model[-1] * (frequency[where] / frequency[-1]) ** (-5 / 3)
    axes.plot(frequency[where], slope, color=SKY, linewidth=1.1, label="slope \N{MINUS SIGN}5/3")
