"""Stability of a control loop: its eigenvalues over frequency (Bode) and as curves (Nyquist)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from jaxtyping import Complex
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from matplotlib.ticker import MultipleLocator

from crinoid.report.run import load_as
from crinoid.report.style import GREY, INK, PALE, SERIES, VERMILLION, WIDTH, head, key
from crinoid.report.units import si_unit

MARGINS = "margins.nc"

_REQUIRED = {
    "locus_real": ("frequency", "locus"),
    "locus_imaginary": ("frequency", "locus"),
    "gain_margin": (),
    "phase_margin": (),
    "delay_margin": (),
    "modulus_margin": (),
}
_FAINT, _HUGE = 1e-3, 300.0
"""Sizes between which an eigenvalue is drawn over the frequency."""
_NEAR = 2.0
"""How far from 0 the curves are drawn."""


def open_margins(path: Path) -> xr.Dataset:
    """Read margins into memory."""
    return load_as(path, "margins", _REQUIRED)


def draw_bode(data: xr.Dataset) -> Figure:
    """Draw size and phase of each eigenvalue of the open loop over the frequency."""
    figure = Figure(figsize=(WIDTH, 5.6), layout="constrained")
    _head(figure, data)
    size, phase = figure.subplots(2, 1, sharex=True)
    frequency, loci = data["frequency"].values, _loci(data)
    large = (np.abs(loci) > _FAINT) & (np.abs(loci) < _HUGE)
    for index in range(loci.shape[1]):
        shown = large[:, index]
        if not shown.any():
            continue
        curve, at = loci[shown, index], frequency[shown]
        name, line = _line(data, index)
        size.plot(at, 20 * np.log10(np.abs(curve)), label=name, **line)
        phase.plot(at, np.rad2deg(np.unwrap(np.angle(curve))), **line)
    size.axhline(0.0, color=INK, linewidth=0.8)
    low, high = phase.get_ylim()
    for turn in np.arange(np.ceil((low - 180) / 360), np.floor((high - 180) / 360) + 1):
        phase.axhline(180 + 360 * turn, color=INK, linewidth=0.8)
    for name, words in _words(data).items():
        where = float(data[f"{name}_frequency"])
        if np.isfinite(where) and where > 0:
            style: Any = {"color": INK, "linewidth": 1.0, "linestyle": _DASHES[name]}
            size.axvline(where, label=f"{words} at {where:.3g} Hz", **style)
            phase.axvline(where, **style)
    shown = frequency[large.any(axis=1)]
    size.set_xscale("log")
    size.set_xlim(shown.min(), shown.max())
    size.set_ylabel("size (dB)")
    phase.set_ylabel("phase (deg)")
    step = 90 if high - low < 800 else 180 if high - low < 1600 else 360
    phase.yaxis.set_major_locator(MultipleLocator(step))
    phase.set_xlabel("frequency (Hz)")
    key(size, columns=2)
    return figure


def draw_nyquist(data: xr.Dataset) -> Figure:
    """Draw each eigenvalue of the open loop as a curve, near -1."""
    figure = Figure(figsize=(WIDTH, WIDTH), layout="constrained")
    _head(figure, data)
    axes = figure.subplots()
    modulus = float(data["modulus_margin"])
    about = f"modulus margin {modulus:.3g}"
    axes.add_patch(Circle((-1, 0), modulus, facecolor=PALE, edgecolor=GREY, label=about))
    axes.add_patch(Circle((0, 0), 1.0, fill=False, edgecolor=GREY, linestyle=(0, (4, 2))))
    loci = _loci(data)
    for index in range(loci.shape[1]):
        curve, (name, line) = loci[:, index], _line(data, index)
        axes.plot(curve.real, curve.imag, label=name, zorder=3, **line)
        axes.plot(curve.real, -curve.imag, linewidth=0.6, alpha=0.6, zorder=2, **line)
        _arrow(axes, curve, line["color"])
    axes.plot(-1, 0, marker="+", markersize=11, markeredgewidth=1.6, color=VERMILLION, zorder=4)
    axes.set_xlim(-_NEAR, _NEAR)
    axes.set_ylim(-_NEAR, _NEAR)
    axes.set_aspect("equal")
    axes.set_xlabel("real part")
    axes.set_ylabel("imaginary part")
    key(axes, columns=2)
    return figure


_DASHES = {
    "gain_margin": (0, (4, 2)),
    "phase_margin": (0, (1, 1.5)),
    "delay_margin": (0, (5, 1.5, 1, 1.5)),
}


def _words(data: xr.Dataset) -> dict[str, str]:
    """Return the margins in words."""
    gain, phase, delay = (float(data[name]) for name in _DASHES)
    return {
        "gain_margin": f"gain margin {gain:.3g} ({20 * np.log10(gain):.3g} dB)",
        "phase_margin": f"phase margin {np.rad2deg(phase):.3g} deg",
        "delay_margin": f"delay margin {si_unit(delay, 's').text(delay)}",
    }


def _head(figure: Figure, data: xr.Dataset) -> None:
    """Write the title, and what is wrong with the loop."""
    unstable = not int(data["stable"])
    status = f"unstable: {data.attrs['notes']}" if unstable else "ok"
    head(figure, str(data.attrs.get("title", "")), status)


def _line(data: xr.Dataset, index: int) -> tuple[str, dict[str, Any]]:
    """Return the name and the style of an eigenvalue: dashed in the second of two waters."""
    waters = data["water"].values.tolist() if "water" in data else [""] * data.sizes["locus"]
    number = waters[:index].count(waters[index])
    name = f"eigenvalue {number + 1}"
    if len(set(waters)) > 1:
        name += f" in {waters[index]}"
    dashed = waters[index] != waters[0]
    colour = SERIES[number % len(SERIES)]
    return name, {"color": colour, "linestyle": (0, (3, 1.5)) if dashed else "-"}


def _loci(data: xr.Dataset) -> Complex[np.ndarray, "frequency locus"]:
    return np.asarray(data["locus_real"].values + 1j * data["locus_imaginary"].values)


def _arrow(axes: Axes, curve: Complex[np.ndarray, " frequency"], colour: str) -> None:
    """Show which way the frequency grows, where the curve passes."""
    inside = np.flatnonzero((np.abs(curve.real) < 0.9 * _NEAR) & (np.abs(curve.imag) < 0.9 * _NEAR))
    inside = inside[np.abs(curve[inside]) > 0.4]
    if inside.size < 2:
        return
    at = inside[0]
    ahead = curve[min(at + 1, curve.size - 1)] - curve[at]
    if abs(ahead) > 0:
        tip = curve[at] + 0.12 * ahead / abs(ahead)
        axes.annotate(
            "",
            xy=(tip.real, tip.imag),
            xytext=(curve[at].real, curve[at].imag),
            arrowprops={"arrowstyle": "-|>", "color": colour, "linewidth": 1.0},
        )
