"""Figures of a sampled current and of vibration modes."""

import re
from dataclasses import replace

import numpy as np
import xarray as xr
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from crinoid.foundation.status import Status
from crinoid.results.scene.data import in_space, is_spatial
from crinoid.results.scene.projection import OBLIQUE, SIDE, PaperPoint, PaperPoints, View
from crinoid.results.units import SLOWEST, Unit, largest, no_swing
from crinoid.view.figures import style
from crinoid.view.figures.charts.chart import Chart, Level, Panel, Trace

_SPEED = Unit(1.0, "m/s")


def _axes_of(flow: xr.Dataset) -> list[str]:
    return [str(axis) for axis in flow["axis"].values]


def differ(flow: xr.Dataset) -> bool:
    """Whether the current at the tip differs from that at the root."""
    velocity = flow["flow_velocity"].values
    return not np.allclose(velocity[:, 0], velocity[:, 1], atol=1e-6 * np.abs(velocity).max())


def draw_profile(flow: xr.Dataset) -> Figure:
    """Draw mean and standard deviation of all components above and below the root."""
    names = _axes_of(flow)
    figure = style.new_figure(4.2 + 0.2 * len(names))
    panels = list(figure.subplots(1, len(names), sharey=True))
    height = flow["height"].values
    ends = flow["position"].sel(axis="z").values
    records = [name for name in flow.data_vars if re.fullmatch(r"record_\d+_mean", str(name))]
    for index, (axes, axis) in enumerate(zip(panels, names, strict=True)):
        mean = flow["profile_mean"].values[:, index]
        deviation = flow["profile_standard_deviation"].values[:, index]
        colour = style.AXIS_COLOURS[axis]
        band = axes.fill_betweenx(height, mean - deviation, mean + deviation, color=colour)
        band.set(alpha=0.25, linewidth=0, label="standard deviation")
        axes.plot(mean, height, color=colour, label="mean")
        for name in records:
            levels = flow[str(name).replace("_mean", "_height")].values
            measured = flow[name].values[:, index]
            axes.plot(measured, levels, "o", markersize=3.0, color=style.INK, label="as measured")
        thick = 0.004 * float(np.ptp(height))
        low, high = float(ends.min()) - thick, float(ends.max()) + thick
        axes.axhspan(low, high, color=style.PALE, zorder=0, label="the arm without loads")
        axes.set_xlabel(f"velocity {axis}\n(m/s)")
        axes.margins(x=0.3)
        axes.locator_params(axis="x", nbins=12 // len(names))
        if np.ptp(axes.get_xlim()) < 1e-3:  # round-off is no profile
            middle = float(mean.mean())
            axes.set_xlim(middle - 0.05, middle + 0.05)
    style.key_of(figure, panels)
    depth, low, high = flow.attrs.get("depth"), float(height.min()), float(height.max())
    panels[0].set_ylim(*((low, high) if depth is None else (-float(depth), max(0.0, high))))
    panels[0].set_ylabel("z (m)")
    style.head_of(figure, flow, "current")
    return figure


def series_chart(flow: xr.Dataset) -> Chart:
    """Return all components and the speed over time, at the tip and at the root."""
    time, velocity = flow["time"].values, flow["flow_velocity"].values
    after = time >= float(flow.attrs.get("settled", 0.0)) - 1e-9  # the last ramp
    parts = {axis: velocity[..., index] for index, axis in enumerate(_axes_of(flow))}
    panels = []
    for name, values in (parts | {"speed": np.linalg.norm(velocity, axis=2)}).items():
        steady, speed = values[after, 1], name == "speed"
        mean, role = float(steady.mean()), "ink" if speed else name
        words = f"mean {mean:.3g} (dashed), standard deviation {steady.std():.2g} m/s"
        traces = [Trace("root and tip", time, values[:, 1], role, summary=words)]
        if differ(flow):
            tip = Trace("tip", time, values[:, 1], role, summary=words)
            traces = [Trace("root", time, values[:, 0], "faint"), tip]
        label, levels = name if speed else f"velocity {name}", (Level(mean, role, "dashed"),)
        panel = Panel(name, label, _SPEED, tuple(traces), levels, tall=2.0)
        panels.append(replace(panel, low=0.0) if speed else panel)
    return Chart("flow", "current", tuple(panels))


Spectrum = Float[np.ndarray, "frequency ..."]
Banded = Float[np.ndarray, "band ..."]
_STEADY = 1e-14  # m2/s: round-off of a spectral density
_DECADES = 5
_BANDS = 8  # a decade: each is wide enough for several modes of random turbulence


def banded(frequency: Spectrum, density: Spectrum) -> tuple[Banded, Banded]:
    """Return means of frequencies and densities over bands of equal width on a logarithmic axis."""
    band = np.floor(_BANDS * np.log10(frequency / frequency[0]) + 1e-9)
    starts = np.flatnonzero(np.diff(band, prepend=-1.0))
    count = np.diff(starts, append=frequency.size)
    means = np.add.reduceat(density, starts, axis=0).T / count
    return np.add.reduceat(frequency, starts) / count, means.T


def draw_spectrum(flow: xr.Dataset) -> Figure:
    """Draw the spectral density of each component, and that of turbulence where it was random."""
    names = _axes_of(flow)
    across = style.columns(2.2, len(names))
    down = len(names) // across
    figure = style.new_figure(4.8 if down == 1 else 0.3 + 2.4 * down)
    panels = list(figure.subplots(down, across, sharey=True).flat)
    finest = flow["frequency"].values
    frequency, density = banded(finest, flow["flow_spectrum"].values)
    shown = density[density > _STEADY]
    model = flow.get("model_spectrum")
    for index, (axes, axis) in enumerate(zip(panels, names, strict=True)):
        _component(axes, flow, axis, frequency, density[..., index])
        if model is not None and density[:, 1, index].max() > _STEADY:
            _turbulence(axes, finest, model.values[:, index], str(model.attrs.get("comment", "")))
        rate = flow["flow_spectrum"].attrs.get("record_rate_hz")
        if rate is not None and rate / 2 < frequency[-1]:
            axes.axvline(rate / 2, color=style.INK, linewidth=0.8, label="half the record's rate")
        axes.set_xlabel("frequency (Hz)")
        style.key(axes, columns=1)
    if shown.size:
        top = 3 * shown.max()
        panels[0].set_ylim(max(0.3 * shown.min(), top / 10**_DECADES), top)
    panels[0].set_ylabel("spectral density (m²/s)")
    style.head_of(figure, flow, "current")
    return figure


def _component(
    axes: Axes, flow: xr.Dataset, axis: str, frequency: Spectrum, density: Spectrum
) -> None:
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlim(frequency[0], frequency[-1])
    if density[:, 1].max() <= _STEADY:
        style.note(axes, f"velocity {axis} is steady")
        return
    if differ(flow) and density[:, 0].max() > _STEADY:
        axes.plot(frequency, density[:, 0], color=style.GREY, linewidth=0.9, label="root")
        label = f"velocity {axis} at the tip"
    else:
        label = f"velocity {axis}"
    axes.plot(frequency, density[:, 1], color=style.AXIS_COLOURS[axis], linewidth=1.1, label=label)


def _turbulence(axes: Axes, frequency: Spectrum, model: Spectrum, words: str) -> None:
    if not np.isfinite(model).all():
        return
    label = f"von Karman, {words}".removesuffix(", ")
    axes.plot(frequency, model, color=style.INK, linestyle=(0, (4, 2)), linewidth=1.1, label=label)
    # next to the model, in the upper half of the frequencies
    where = frequency > np.sqrt(frequency[0] * frequency[-1])
    slope = 4 * model[-1] * (frequency[where] / frequency[-1]) ** (-5 / 3)
    axes.plot(
        frequency[where], slope, color=style.SKY, linewidth=1.1, label="slope \N{MINUS SIGN}5/3"
    )


_WIDE = 1.1  # inches that a mode has at least
_SWING = 0.22  # drawn amplitude of a mode, of the arm's length
_PHASES = np.linspace(0.0, 2 * np.pi, 16, endpoint=False)
_STILL = 0.02  # displacement below which a mode is one of torsion
_UNDAMPED = 1e-6  # damping ratio below which a mode is undamped
_GAP = (0.12, 0.4)  # inches, that above a panel for its title
_LEFT, _BELOW, _HEADING, _HIGHEST = 0.12, 0.1, 0.28, 2.3  # inches


def draw_modes(modes: xr.Dataset) -> Figure:
    """Draw each mode on the arm at rest, one medium below the other, at one scale."""
    view = OBLIQUE if is_spatial(modes) else SIDE
    media = [modes.isel(medium=[index]) for index in range(modes.sizes["medium"])]
    across = style.columns(_WIDE, modes.sizes["mode"])
    rows = -(-modes.sizes["mode"] // across)
    windows = [_window(here, view) for here in media]
    room = (style.width() - 2 * _LEFT - (across - 1) * _GAP[0]) / across
    extents = np.array([high - low for low, high in windows])
    inch = min(room / extents[:, 0].max(), _HIGHEST / extents[:, 1].max())

    title = str(modes.attrs.get("title", "")).strip() or "modes"
    status = str(modes.attrs.get("status", "")) or Status.OK.value
    blocks = [_HEADING + rows * (float(extent[1]) * inch + _GAP[1]) for extent in extents]
    top = style.head_height(title, status) + sum(blocks) + _BELOW
    figure = Figure(figsize=(style.width(), top))
    style.head(figure, title, status)
    top -= style.head_height(title, status)
    for here, (low, high), block in zip(media, windows, blocks, strict=True):
        medium = str(here["medium"].item())
        place = (_LEFT / style.width(), (top - 0.22) / float(figure.get_size_inches()[1]))
        figure.text(*place, medium)
        wide, tall = (high - low) * inch
        for index in range(modes.sizes["mode"]):
            row, column = divmod(index, across)
            left = _LEFT + column * (room + _GAP[0]) + (room - wide) / 2
            foot = top - _HEADING - row * (tall + _GAP[1]) - _GAP[1] - tall
            axes = style.add_axes(figure, left, foot, wide, tall)
            axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
            axes.set_axis_off()
            _draw(axes, here.isel(mode=index), view)
        top -= block
    lines = {
        "at rest": style.GREY,
        "swung out": style.BLUE,
        "half a period later": style.VERMILLION,
    }
    handles = [Line2D([], [], color=colour, label=label) for label, colour in lines.items()]
    handles.append(Line2D([], [], color=style.SKY, linewidth=0.6, label="in between"))
    style.key_with(figure, handles, "lower center")
    return figure


def _draw(axes: Axes, mode: xr.Dataset, view: View) -> None:
    frequency, ratio = float(mode["frequency"].item()), float(mode["damping_ratio"].item())
    if np.isnan(frequency):
        return
    label = f"{frequency:.3g} Hz" if frequency > SLOWEST else no_swing(ratio)
    if not np.isnan(ratio):
        label += f"\n$\\zeta$ = {0.0 if abs(ratio) < _UNDAMPED else ratio:.2g}"
    axes.set_title(f"{int(mode['mode'])}: {label}", fontsize=8.0, pad=3)
    rest, swings = _swings(mode, view)
    drawn = LineCollection(list(swings), colors=style.SKY, linewidths=0.5, alpha=0.7)
    axes.add_collection(drawn, autolim=False)
    axes.plot(*rest.T, color=style.GREY)
    for swing, colour in ((swings[0], style.BLUE), (swings[len(swings) // 2], style.VERMILLION)):
        axes.plot(*swing.T, color=colour, marker=".", markersize=2.5)
    axes.plot(*rest[0], color=style.INK, marker="s", markersize=4.0)
    if largest(in_space(mode, "shape")) < _STILL:
        x, z = map(float, rest[len(rest) // 2])
        axes.text(x, z, " twists", color=style.INK, fontsize=8.0)


def _swings(mode: xr.Dataset, view: View) -> tuple[PaperPoints, PaperPoints]:
    """Return the arm at rest and at phases of its mode, on paper."""
    rest = in_space(mode, "position")
    length = np.linalg.norm(np.diff(rest.squeeze(), axis=0), axis=1).sum()
    cosine, sine = (wave(_PHASES)[:, None, None] for wave in (np.cos, np.sin))
    moved = cosine * in_space(mode, "shape") + sine * in_space(mode, "shape_quadrature")
    moved *= _SWING * length / max(largest(moved), _STILL)
    return view.paper(rest.squeeze()), view.paper(rest.squeeze() + moved)


def _window(here: xr.Dataset, view: View) -> tuple[PaperPoint, PaperPoint]:
    modes = [_swings(here.isel(mode=index), view) for index in range(here.sizes["mode"])]
    points = np.concatenate([part.reshape(-1, 2) for mode in modes for part in mode])
    low, high = np.nanmin(points, axis=0), np.nanmax(points, axis=0)
    margin = 0.03 * float((high - low).max())
    return low - margin, high + margin
