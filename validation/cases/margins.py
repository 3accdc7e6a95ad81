"""Stability margins of loops that python-control tests its own margins on."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Complex, Float
from matplotlib.axes import Axes

from crinoid.simulation.loop_margin import Margin, OpenLoop
from crinoid.view.figures.style import BLUE, GREEN, INK, PURPLE
from validation.case import Check, Evidence, case

_FREQUENCY = np.geomspace(1e-2, 1e2, 40_001)
"""rad/s."""


class _Reference(NamedTuple):
    """Margins of a loop, each with its frequency (rad/s); NaN where it has none."""

    gain: tuple[float, float]
    phase: tuple[float, float]
    """In degrees."""
    modulus: tuple[float, float]
    tolerance: float = 1.5e-3


def _loops(s: Complex[np.ndarray, " f"]) -> dict[str, Complex[np.ndarray, " f"]]:
    bent = 8.75 * (4 * s**2 + 0.4 * s + 1) / ((100 * s + 1) * (s**2 + 0.22 * s + 1))
    return {
        "third order": 1 / (s**3 + 2 * s**2 + 3 * s + 4),
        "two resonances": bent / (s**2 / 100 + 0.008 * s + 1),
        "zero on the right": 0.01 * (10 - s) / ((2 + s) * (1 + s)),
        "triple pole": 2 / (s + 1) ** 3,
    }


_NONE = (np.nan, np.nan)
_REFERENCES = {
    "third order": _Reference((2.0, 1.7321), _NONE, (0.4170, 1.6620)),
    "two resonances": _Reference((2.2716, 10.0053), (97.5941, 0.0850), (0.5591, 9.9918)),
    "zero on the right": _Reference((300.0, 5.6569), _NONE, (0.9917, 2.3171)),
    "triple pole": _Reference((4.000, 1.7322), (67.6058, 0.7663), _NONE, 1e-2),
}


def _checks(name: str, reference: _Reference, found: Margin) -> Iterator[Check]:
    within = reference.tolerance
    for margin, expected, value, frequency, unit in (
        ("gain", reference.gain, found.gain, found.gain_frequency, "1"),
        ("phase", reference.phase, np.rad2deg(found.phase), found.phase_frequency, "deg"),
        ("modulus", reference.modulus, found.modulus, found.frequency, "1"),
    ):
        if not np.isnan(expected[0]):
            turned = 2 * np.pi * frequency
            yield Check(f"{margin}, {name}", expected[0], value, within, unit)
            yield Check(f"where {margin}, {name}", expected[1], turned, within, "rad/s")


@case(
    kind="published",
    title="Four loops have the gain, phase and modulus margins that python-control finds.",
    source="python-control, control/tests/margin_test.py: numbers of test_stability_margins, and "
    "of type0 with K = 2 in test_zmore_margin.",
    method=f"The margins of `crinoid margins`, from {_FREQUENCY.size} frequencies between 0.01 and "
    "100 rad/s.",
    reason="Absolute tolerances of python-control's own tests: 1.5e-3, and 0.01 for the triple "
    "pole. The grid leaves 1.2e-3 rad/s near 10 rad/s. Margins that a loop lacks or the source "
    "omits are left out.",
)
def margins() -> Evidence:
    loops = _loops(1j * _FREQUENCY)
    checks: list[Check] = []
    for name, loop in loops.items():
        opened = OpenLoop(_FREQUENCY / (2 * np.pi), loop[:, None, None], np.zeros((1, 1)))
        checks += _checks(name, _REFERENCES[name], opened.margin())

    def draw(axes: Axes) -> None:
        around: Float[np.ndarray, " angle"] = np.linspace(0.0, 2 * np.pi, 200)
        axes.plot(np.cos(around), np.sin(around), color=INK, linewidth=0.5)
        drawn = {
            "third order": (BLUE, (-1.1, -0.7)),
            "two resonances": (GREEN, (0.6, 0.55)),
            "triple pole": (PURPLE, (1.5, -1.6)),
        }
        for name, (colour, place) in drawn.items():
            axes.plot(loops[name].real, loops[name].imag, color=colour)
            axes.text(*place, name, color=colour, ha="center")
            at = loops[name][np.argmin(np.abs(1 + loops[name]))]
            axes.plot([-1, at.real], [0, at.imag], "--", color=colour, linewidth=0.9)
        axes.plot(-1, 0, "+", color=INK, markersize=10)
        axes.set(xlabel="real part", ylabel="imaginary part", aspect="equal")
        axes.set(xlim=(-1.6, 2.4), ylim=(-1.9, 1.1))

    return Evidence(checks, draw=draw)
