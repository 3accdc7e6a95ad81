"""Figure of a record of the sea: velocity over time, profile, spectrum and histogram."""

import numpy as np
import xarray as xr
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from crinoid.view.figures import style
from crinoid.view.figures.analyses import banded

_COLOURS = dict(zip(("east", "north", "up"), style.AXIS_COLOURS.values(), strict=True))
_COLOURS |= dict(zip(("along", "across"), (style.BLUE, style.VERMILLION), strict=True))
_COLOURS |= style.AXIS_COLOURS
_SPANS = ((2 * 86400.0, 86400.0, "days"), (2 * 3600.0, 3600.0, "h"), (0.0, 1.0, "s"))
"""Shortest record (s) that is drawn over a unit of time, the unit (s), and its name."""
_DRAWN = 20_000  # samples that are drawn at most: more lie on each other
_DECADES = 6  # powers of ten on the axis of a spectrum


def draw_record(data: xr.Dataset) -> Figure:
    """Draw the velocity over time, the mean profile, the spectrum and the histogram of speed."""
    profile = data.sizes.get("height", 1) > 1
    down = 1 if style.columns(2.2, 3) == 3 else 2 + profile
    figure = style.new_figure(3.5 + 2.9 * down)
    above, below = figure.subfigures(2, 1, height_ratios=(1.2, down))
    series = list(above.subplots(2, 1, sharex=True))
    _series(series, data)
    spectrum, share, *rest = below.subplots(down, (2 + profile) // down).flat
    _spectrum(spectrum, data)
    _histogram(share, data)
    if profile:
        _profile(rest[0], data)
    style.head_of(figure, data, "record")
    return figure


def _series(panels: list[Axes], data: xr.Dataset) -> None:
    time, filled = data["time"].values, data["filled"].values > 0
    _, unit, name = next(span for span in _SPANS if time[-1] - time[0] >= span[0])
    velocity = np.where(filled[:, None], np.nan, data["velocity"].values)
    every = -(-time.size // _DRAWN)
    for index, axis in enumerate(map(str, data["axis"].values)):
        colour = _COLOURS[axis]
        panels[0].plot(
            time[::every] / unit, velocity[::every, index], color=colour, linewidth=0.7, label=axis
        )
    speed = np.linalg.norm(velocity, axis=1)
    label = f"speed: mean {np.nanmean(speed):.3g}, largest {np.nanmax(speed):.3g} m/s"
    panels[1].plot(time[::every] / unit, speed[::every], color=style.INK, linewidth=0.7)
    panels[1].plot([], [], color=style.INK, label=label)
    panels[1].set_ylim(bottom=0.0)
    panels[1].set_xlim(time[0] / unit, time[-1] / unit)
    panels[0].set_ylabel("velocity (m/s)")
    panels[1].set_ylabel("speed (m/s)")
    panels[1].set_xlabel(f"time ({name})")
    for axes in panels:
        style.key(axes)


def _spectrum(axes: Axes, data: xr.Dataset) -> None:
    frequency, density = banded(data["frequency"].values, data["spectrum"].values)
    axes.set(xscale="log", yscale="log", xlabel="frequency (Hz)")
    axes.set_ylabel("spectral density (m²/s)")
    for index, part in enumerate(map(str, data["part"].values)):
        if density[:, index].any():
            axes.plot(frequency, density[:, index], color=_COLOURS[part], linewidth=1.0, label=part)
    if "model_spectrum" in data:
        model: Float[np.ndarray, " frequency"] = data["model_spectrum"].values
        words = str(data["model_spectrum"].attrs["long_name"]).partition(" of the")[0]
        axes.plot(data["frequency"], model, "--", color=style.INK, linewidth=1.0, label=words)
    top = 3 * float(density.max(initial=1e-12))
    axes.set_ylim(max(0.3 * float(density[density > 0].min(initial=top)), top / 10**_DECADES), top)
    style.key(axes, columns=2)


def _histogram(axes: Axes, data: xr.Dataset) -> None:
    speed, share = data["speed"].values, data["share"].values
    axes.bar(speed, 100 * share, width=2 * speed[0], color=style.SKY, edgecolor="white")
    axes.set(xlabel="speed (m/s)", ylabel="share of time (%)", xlim=(0.0, speed[-1] + speed[0]))


def _profile(axes: Axes, data: xr.Dataset) -> None:
    height, low, high = (data[name].values for name in ("height", "speed_low", "speed_high"))
    axes.fill_betweenx(height, low, high, color=style.PALE, label="5 to 95 % of time")
    axes.plot(data["speed_mean"], height, ".-", color=style.BLUE, label="mean")
    axes.axhline(
        data.attrs["height"], color=style.GREY, linewidth=0.8, label="level shown elsewhere"
    )
    axes.set(xlabel="speed (m/s)", ylabel="z (m)")
    axes.set_xlim(left=0.0)
    style.key(axes, columns=1)
