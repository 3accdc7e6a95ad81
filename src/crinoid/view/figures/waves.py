"""Figure that compares a measured sea with the components that represent it."""

import re

import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from crinoid.view.figures import style

_PERIODS = 20.0  # of the peak that are drawn of an elevation


def seas(flow: xr.Dataset) -> list[str]:
    """Return the names of the seas in files, with which those of their variables begin."""
    found = (re.fullmatch(r"(sea_\d+)_statistics", str(name)) for name in flow.data_vars)
    return [each[1] for each in found if each]


def draw_waves(flow: xr.Dataset) -> Figure:
    """Draw the elevation at the gauge, or the spectrum, of each sea and of its components."""
    names = seas(flow)
    figure = style.new_figure(0.6 + 2.6 * len(names))
    for axes, name in zip(figure.subplots(len(names), 1, squeeze=False).flat, names, strict=True):
        file = str(flow[f"{name}_statistics"].attrs["long_name"])
        (_elevation if f"{name}_elevation" in flow else _spectrum)(axes, flow, name, file)
        style.key(axes)
    style.head_of(figure, flow, "waves")
    return figure


def _elevation(axes: Axes, flow: xr.Dataset, name: str, file: str) -> None:
    time = flow[f"{name}_time"].values
    record, components = flow[f"{name}_elevation"].values
    period = float(flow[f"{name}_statistics"].values[0, 1])
    shown = (time >= 0) & (time <= min(float(flow["time"][-1]), _PERIODS * period))
    axes.plot(time[shown], components[shown], color=style.BLUE, label="components")
    axes.plot(time[shown], record[shown], ".", color=style.INK, markersize=3.0, label=file)
    axes.set(xlabel="time (s)", ylabel="elevation at the gauge (m)")


def _spectrum(axes: Axes, flow: xr.Dataset, name: str, file: str) -> None:
    frequency = flow[f"{name}_frequency"].values
    of_file, components = flow[f"{name}_density"].values
    wide = 0.9 * (frequency[1] - frequency[0])
    axes.bar(frequency, components, wide, color=style.SKY, label="components, in bands")
    axes.plot(frequency, of_file, color=style.INK, drawstyle="steps-mid", label=file)
    axes.set(xlabel="frequency (Hz)", ylabel="density (m²/Hz)")
