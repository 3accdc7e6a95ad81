"""The tip close up: its path about the target, at the scale of its error, and how fast it errs."""

from __future__ import annotations

import numpy as np
import xarray as xr
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

from crinoid.current.spectrum import spectrum
from crinoid.report.run import Run
from crinoid.report.style import (
    BLUE,
    GREY,
    INK,
    VERMILLION,
    WIDTH,
    head,
    key,
    key_below,
    note,
    time_map,
    time_norm,
)
from crinoid.report.units import Unit, largest, length_unit
from crinoid.report.view import ABOVE, AHEAD, SIDE, View, in_space, is_spatial

_LEAST_RECORDS = 16
_DECADES = 6  # of the spectral density, from its top


def draw_close_up(run: Run) -> Figure:
    """Draw the tip's path about its target, each run at its own scale, and the error's spectrum."""
    views = (ABOVE, SIDE, AHEAD) if is_spatial(run.result) else (SIDE,)
    members = run.members
    # planar runs beside each other, those in space below each other
    shape = (len(members), len(views)) if len(views) > 1 else (1, len(members))
    high = 2.5 * shape[0] if max(shape) > 1 else 4.2
    figure = Figure(figsize=(WIDTH, 3.7 + high), layout="constrained")
    rows = figure.add_gridspec(2, 1, height_ratios=[high, 2.6])
    panels = rows[0].subgridspec(*shape).subplots(squeeze=False).reshape(len(members), len(views))
    misses = [miss(data) for _, data in members]
    # each at its own scale, and the smaller window shown in the larger one
    halves = [1.1 * (largest(each) or 5e-4) for each in misses]
    for some, (label, data), off, half in zip(panels, members, misses, halves, strict=True):
        for axes, view in zip(some, views, strict=True):
            _path(axes, data, view, off, half)
            if half > halves[0]:
                unit = length_unit(half)
                corner, wide = -halves[0] * unit.factor, 2 * halves[0] * unit.factor
                window = Rectangle((corner, corner), wide, wide, fill=False, edgecolor=INK)
                window.set(zorder=4, label="window with control")
                axes.add_patch(window)
        words = f"{label}: RMS {_rms_text(off, half)}" if label else f"RMS {_rms_text(off, half)}"
        some[0].set_title(words, loc="left")
    time = run.result["time"].values
    if time[-1] > time[0]:
        times = ScalarMappable(time_norm(run.result), time_map())
        bar = figure.colorbar(times, ax=panels, label="time (s)", aspect=25)
        bar.ax.grid(visible=False)
    _spectra(figure.add_subplot(rows[1]), run, misses)
    key_below(figure, panels.flat, "outside lower center")
    head(figure, run.title, run.status)
    return figure


def miss(data: xr.Dataset) -> Float[np.ndarray, "time axis=3"]:
    """Return where the tip is, from where it should be (m)."""
    return in_space(data, "tip_position") - in_space(data, "tip_target")


def error_spectrum(
    time: Float[np.ndarray, " time"], off: Float[np.ndarray, "time axis=3"]
) -> tuple[Float[np.ndarray, " frequency"], Float[np.ndarray, " frequency"]] | None:
    """Return frequencies (Hz) and the one-sided density (m2/Hz) of the error's fluctuation.

    That of all its parts together, by Welch's method; none where the run is too short. The last
    instant is left out where it does not lie at the interval of the others.
    """
    if time.size < _LEAST_RECORDS:
        return None
    interval = float(time[1] - time[0])
    even = np.isclose(np.diff(time), interval, rtol=1e-3)
    count = time.size if even.all() else int(np.argmin(even)) + 1
    if count < _LEAST_RECORDS or not np.isfinite(off[:count]).all():
        return None
    found = spectrum(off[:count, None, :], interval)
    return found.frequency, np.asarray(found.density.sum(axis=(1, 2)))


def _rms_text(off: Float[np.ndarray, "time axis=3"], half: float) -> str:
    return length_unit(half).text(float(np.sqrt(np.nanmean(np.sum(off**2, axis=1)))))


def _path(
    axes: Axes, data: xr.Dataset, view: View, off: Float[np.ndarray, "time axis=3"], half: float
) -> None:
    unit = length_unit(half)
    points, time = view.paper(off) * unit.factor, data["time"].values
    axes.axhline(0.0, color=GREY, linewidth=0.7)
    axes.axvline(0.0, color=GREY, linewidth=0.7)
    pieces = np.stack([points[:-1], points[1:]], axis=1)
    line = LineCollection(
        list(pieces), array=time[1:], cmap=time_map(), norm=time_norm(data), linewidths=0.9
    )
    axes.add_collection(line, autolim=False)
    axes.plot(*points[-1], "o", color=VERMILLION, markersize=4, zorder=5, label="tip at the end")
    axes.plot(0.0, 0.0, "o", markersize=8.5, mfc="none", mec=INK, mew=1.2, zorder=5, label="target")
    limit = half * unit.factor
    axes.set(xlim=(-limit, limit), ylim=(-limit, limit), aspect="equal")
    across, up = (label.split()[0] for label in view.labels)
    axes.set_xlabel(f"{across} \N{MINUS SIGN} target ({unit.name})")
    axes.set_ylabel(f"{up} \N{MINUS SIGN} target ({unit.name})")


def _spectra(axes: Axes, run: Run, misses: list[Float[np.ndarray, "time axis=3"]]) -> None:
    """Draw the error's spectral density, with control before without."""
    axes.set_xlabel("frequency (Hz)")
    found = [
        error_spectrum(data["time"].values, off)
        for (_, data), off in zip(run.members, misses, strict=True)
    ]
    known = [each for each in found if each is not None]
    top = largest(*(density for _, density in known))
    if not known or top == 0.0:
        note(axes, "too short for a spectrum" if not known else "the tip never errs")
        axes.set_ylabel("density of\nthe tip's error")
        return
    squares = length_unit(top**0.5)
    unit = Unit(squares.factor**2, f"{squares.name}²/Hz")
    axes.set(xscale="log", yscale="log")
    # plain numbers, wide enough apart over one decade and over four
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0), numticks=20))
    axes.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())
    for order, ((label, _), each, colour) in enumerate(
        zip(run.members, found, (BLUE, VERMILLION), strict=False)
    ):
        if each is not None:
            frequency, density = each
            values = np.where(density > 0.0, density, np.nan) * unit.factor
            name = label or "tip error"
            axes.plot(frequency, values, color=colour, zorder=3 - order, label=name)
    axes.set_ylim(top * unit.factor / 10**_DECADES, 3 * top * unit.factor)
    seen = [f[density > top / 10**_DECADES] for f, density in known]
    axes.set_xlim(min(f[0] for f, _ in known), 1.3 * max(f[-1] for f in seen if f.size))
    axes.set_ylabel(f"density of\nthe tip's error ({unit.name})")
    key(axes)
