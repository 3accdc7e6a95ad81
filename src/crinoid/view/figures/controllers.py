"""Figures of controllers and of linear models: a comparison, Bode and Nyquist plots, responses."""

import math
from typing import Any

import numpy as np
import xarray as xr
from jaxtyping import Complex, Float
from matplotlib import ticker
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from crinoid.results.measure_labels import head_of, main_measures, unit_for
from crinoid.results.metrics import MEASURES
from crinoid.results.units import DEGREES, Unit, largest, si_unit
from crinoid.studies.comparison import best_controller, compared_measures
from crinoid.studies.statistics import row_means
from crinoid.view.figures import style

_LEAST, _OF_RESPONSES = 1.6, 2
"""Least width of a panel of a comparison (inches); panels of responses side by side."""
_DRAWN = ("rms_error", "max_error", "within_tolerance", "rms_angle_error", "work", "max_base_force")
"""Measures that a figure shows, besides those of packages."""
_WIDE = (8.0, 1e4)
"""Ratios of the largest to the smallest value between which an axis is logarithmic."""
_SPREAD = 0.22
"""Half-width over which the runs of a controller are spread, of the distance between two."""


def draw_comparison(data: xr.Dataset) -> Figure:
    """Draw errors and efforts: a point for each run, a line with its number for each mean."""
    panels = _panels(data)
    across = style.columns(_LEAST, 3)
    rows = math.ceil(len(panels) / across)
    figure = style.new_figure(0.5 + 2.5 * rows)
    style.head_of(figure, data)
    words = "points: runs; lines, bars and numbers: means and 95 % intervals; speeds are RMS"
    figure.supxlabel(style.wrap(words), fontsize=style.small(), color=style.GREY)
    grid = list(figure.subplots(rows, across, squeeze=False).flat)
    for axes, (words, values, unit) in zip(grid, panels, strict=False):
        _points(axes, [str(kind) for kind in data["controller"].values], values * unit.factor)
        axes.set_title(style.wrap(words, across), loc="left")
    for axes in grid[len(panels) :]:
        axes.set_axis_off()
    return figure


def _panels(data: xr.Dataset) -> list[tuple[str, Float[np.ndarray, "controller seed"], Unit]]:
    """Return title, values (SI) and unit of each panel."""
    found = [
        (head_of(name, unit_for(data[name])), data[name].values, unit_for(data[name]))
        for name in main_measures(compared_measures(data))
        if name in _DRAWN or name not in MEASURES
    ]
    for index, name in enumerate(data["input"].values):
        speed = data["effort"].values[..., index]
        unit = speed_unit(str(data["input_unit"].values[index]), largest(speed))
        found.append((f"speed of {name} ({unit.name})", speed, unit))
    if data.sizes["controller"] > 1:
        rms, best = data["rms_error"].values, best_controller(data)
        words, unit = f"less that of {data['controller'].values[best]}", unit_for(data["rms_error"])
        found.insert(1, (f"RMS error {words} ({unit.name})", rms - rms[best], unit))
    return found


def speed_unit(unit: str, most: float) -> Unit:
    """Return a readable unit for speeds of up to ``most``, from a unit of CF."""
    if unit == "rad s-1":
        return Unit(DEGREES.factor, "deg/s")
    if unit == "s-1":
        return Unit(100.0, "%/s")
    return si_unit(most, unit.replace(" s-1", "/s"))


def _points(axes: Axes, kinds: list[str], values: Float[np.ndarray, "controller seed"]) -> None:
    count = values.shape[1]
    shift = np.linspace(-_SPREAD, _SPREAD, count) if count > 1 else np.zeros(1)
    found = values[np.isfinite(values)]
    positive = bool(found.size and found.min() > 0)
    logarithmic = positive and bool(_WIDE[0] < found.max() / found.min() < _WIDE[1])
    means = row_means(values)
    for place, row in enumerate(values):
        there = np.isfinite(row)
        if not there.any():
            axes.annotate("no run", (place, 0.5), xycoords=("data", "axes fraction"), ha="center")
            continue
        colour = style.SERIES[place % len(style.SERIES)]
        mean, half, high = (each[place] for each in (means.value, means.half, means.high))
        axes.scatter(place + shift[there], row[there], s=14, color=colour, alpha=0.6, linewidth=0)
        axes.hlines(mean, place - 0.34, place + 0.34, color=style.INK, linewidth=1.2, zorder=3)
        if half > 0:
            axes.errorbar(place, mean, half, color=style.INK, linewidth=1.0, capsize=5)
        top = place, float(max(high if half > 0 else mean, row[there].max()))
        look: Any = {"textcoords": "offset points", "ha": "center", "fontsize": 8.0}
        axes.annotate(f"{mean:.3g}", top, (0, 4), **look)
    axes.set_xticks(range(len(kinds)), kinds, parse_math=False)
    axes.set_xlim(-0.6, len(kinds) - 0.4)
    axes.grid(visible=False, axis="x")
    axes.tick_params(axis="x", length=0)
    if logarithmic:
        axes.set_yscale("log")
        axes.yaxis.set_major_locator(ticker.LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.yaxis.set_major_formatter(ticker.ScalarFormatter())
        axes.yaxis.set_minor_formatter(ticker.NullFormatter())
        axes.set_ylim(0.8 * found.min(), 1.5 * found.max())
    elif found.size:
        low, high = axes.get_ylim()
        axes.set_ylim(min(0.0, low), max(0.0, 1.12 * high))


_FAINT, _HUGE = 1e-3, 300.0  # sizes between which an eigenvalue is drawn over the frequency
_NEAR = 2.0  # distance from 0 up to which the curves are drawn


def draw_bode(data: xr.Dataset) -> Figure:
    """Draw size and phase of each eigenvalue of the open loop over the frequency."""
    figure = style.new_figure(5.6)
    _head(figure, data)
    size, phase = figure.subplots(2, 1, sharex=True)
    loci = data["locus_real"].values + 1j * data["locus_imaginary"].values
    frequency = data["frequency"].values
    large = (np.abs(loci) > _FAINT) & (np.abs(loci) < _HUGE)
    for index in range(loci.shape[1]):
        shown = large[:, index]
        if not shown.any():
            continue
        curve, at = loci[shown, index], frequency[shown]
        name, line = _line(data, index)
        size.plot(at, 20 * np.log10(np.abs(curve)), label=name, **line)
        phase.plot(at, np.rad2deg(np.unwrap(np.angle(curve))), **line)
    size.axhline(0.0, color=style.INK, linewidth=0.8)
    low, high = phase.get_ylim()
    for turn in np.arange(np.ceil((low - 180) / 360), np.floor((high - 180) / 360) + 1):
        phase.axhline(180 + 360 * turn, color=style.INK, linewidth=0.8)
    gain, phase_margin, delay = (float(data[name]) for name in _DASHES)
    margins = {
        "gain_margin": f"gain margin {gain:.3g} ({20 * np.log10(gain):.3g} dB)",
        "phase_margin": f"phase margin {np.rad2deg(phase_margin):.3g} deg",
        "delay_margin": f"delay margin {si_unit(delay, 's').text(delay)}",
    }
    for name, words in margins.items():
        where = float(data[f"{name}_frequency"])
        if np.isfinite(where) and where > 0:
            look: Any = {"color": style.INK, "linewidth": 1.0, "linestyle": _DASHES[name]}
            size.axvline(where, label=f"{words} at {where:.3g} Hz", **look)
            phase.axvline(where, **look)
    shown = frequency[large.any(axis=1)]
    size.set(xscale="log", xlim=(shown.min(), shown.max()), ylabel="size (dB)")
    step = 90 if high - low < 800 else 180 if high - low < 1600 else 360
    phase.yaxis.set_major_locator(ticker.MultipleLocator(step))
    phase.set(xlabel="frequency (Hz)", ylabel="phase (deg)")
    style.key(size, columns=2)
    return figure


def draw_nyquist(data: xr.Dataset) -> Figure:
    """Draw each eigenvalue of the open loop as a curve, near -1."""
    figure = Figure(figsize=(style.width(), style.width()), layout="constrained")
    _head(figure, data)
    axes = figure.subplots()
    modulus = float(data["modulus_margin"])
    about = f"modulus margin {modulus:.3g}"
    axes.add_patch(
        Circle((-1, 0), modulus, facecolor=style.PALE, edgecolor=style.GREY, label=about)
    )
    axes.add_patch(Circle((0, 0), 1.0, fill=False, edgecolor=style.GREY, linestyle=(0, (4, 2))))
    loci = data["locus_real"].values + 1j * data["locus_imaginary"].values
    for index in range(loci.shape[1]):
        curve, (name, line) = loci[:, index], _line(data, index)
        axes.plot(curve.real, curve.imag, label=name, zorder=3, **line)
        axes.plot(curve.real, -curve.imag, linewidth=0.6, alpha=0.6, zorder=2, **line)
        _arrow(axes, curve, line["color"])
    axes.plot(
        -1, 0, marker="+", markersize=11, markeredgewidth=1.6, color=style.VERMILLION, zorder=4
    )
    axes.set(xlim=(-_NEAR, _NEAR), ylim=(-_NEAR, _NEAR), aspect="equal")
    axes.set(xlabel="real part", ylabel="imaginary part")
    style.key(axes, columns=2)
    return figure


_DASHES = {
    "gain_margin": (0, (4, 2)),
    "phase_margin": (0, (1, 1.5)),
    "delay_margin": (0, (5, 1.5, 1, 1.5)),
}


def _head(figure: Figure, data: xr.Dataset) -> None:
    unstable = not int(data["stable"])
    status = f"unstable: {data.attrs['notes']}" if unstable else "ok"
    style.head(figure, str(data.attrs.get("title", "")), status)


def _line(data: xr.Dataset, index: int) -> tuple[str, dict[str, Any]]:
    """Return the name and the style of an eigenvalue: dashed in the second of two waters."""
    waters = data["water"].values.tolist() if "water" in data else [""] * data.sizes["locus"]
    number = waters[:index].count(waters[index])
    name = f"eigenvalue {number + 1}"
    if len(set(waters)) > 1:
        name += f" in {waters[index]}"
    dashed = waters[index] != waters[0]
    colour = style.SERIES[number % len(style.SERIES)]
    return name, {"color": colour, "linestyle": (0, (3, 1.5)) if dashed else "-"}


def _arrow(axes: Axes, curve: Complex[np.ndarray, " frequency"], colour: str) -> None:
    """Draw an arrow in the direction of growing frequency."""
    inside = np.flatnonzero((np.abs(curve.real) < 0.9 * _NEAR) & (np.abs(curve.imag) < 0.9 * _NEAR))
    inside = inside[np.abs(curve[inside]) > 0.4]
    if inside.size < 2:
        return
    at = inside[0]
    ahead = curve[min(at + 1, curve.size - 1)] - curve[at]
    if abs(ahead) > 0:
        tip, tail = curve[at] + 0.12 * ahead / abs(ahead), curve[at]
        look = {"arrowstyle": "-|>", "color": colour, "linewidth": 1.0}
        axes.annotate("", (tip.real, tip.imag), (tail.real, tail.imag), arrowprops=look)


_UNSEEN = 1e-4  # size of a response, over the largest of its input, below which it is not drawn


def draw_response(data: xr.Dataset) -> Figure:
    """Draw size and phase of the response of the tip's coordinates to commands and current."""
    response = data["response_real"] + 1j * data["response_imaginary"]
    names = [str(name) for name in data["input"].values if "acceleration" not in str(name)]
    across = style.columns(3.0, _OF_RESPONSES)
    rows = math.ceil(len(names) / across)
    figure = style.new_figure(0.6 + 3.2 * rows)
    style.head_of(figure, data)
    ratios = [2.0, 1.3] * rows
    grid = figure.subplots(2 * rows, across, sharex=True, squeeze=False, height_ratios=ratios)
    pairs = [pair for row in range(rows) for pair in grid[2 * row : 2 * row + 2].T]
    frequency = data["frequency"].values
    for (axes, phase), name in zip(pairs, names, strict=False):
        to_it = response.sel(input=name)
        most = float(abs(to_it).max())
        for output in data["output"].values:
            curve = to_it.sel(output=output).values
            if np.abs(curve).max() > _UNSEEN * most:
                look = {"color": style.AXIS_COLOURS[str(output).removeprefix("tip_")]}
                axes.plot(frequency, np.abs(curve), **look, label=str(output).replace("_", " "))
                phase.plot(frequency, np.rad2deg(np.unwrap(np.angle(curve))), **look)
        unit = str(to_it["input_unit"].values).replace(" s-1", "/s")
        per = "m" if unit == "1" else f"m per {unit}"
        axes.set(xscale="log", yscale="log", xlim=frequency[[0, -1]])
        axes.set_ylabel(f"{name.replace('_', ' ')}\n({per})")
        phase.set_ylabel("phase (deg)")
        phase.yaxis.set_major_locator(ticker.MaxNLocator(4, steps=[1, 1.8, 3.6, 4.5, 9, 10]))
        if most > 0:
            axes.set_ylim(_UNSEEN * most, 2 * most)
        style.key(axes)
    for pair in pairs[len(names) :]:
        for axes in pair:
            axes.set_axis_off()
    figure.align_ylabels()
    figure.supxlabel("frequency (Hz)")
    return figure
