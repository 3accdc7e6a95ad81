"""Surface waves: dispersion, decay with depth, Doppler shift."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from matplotlib.axes import Axes
from scipy.optimize import brentq

from crinoid.assembly.prepared import system
from crinoid.flow import Water
from crinoid.flow.flow import Current
from crinoid.scenario import Scenario
from crinoid.view.figures.style import INK, SERIES
from validation.case import Check, Evidence, case

_HEIGHT, _PERIOD, _GRAVITY = 0.8, 5.0, 9.81
_RATE = 2 * np.pi / _PERIOD
_DEPTHS = (1.0, 6.0, 100.0)
_CURRENTS = (-0.6, 1.1)
_SPAN = 1e-4
"""Step of the central differences (m, s)."""


def _scenario(depth: float, current: float = 0.0) -> Scenario:
    return Scenario(
        arm={"nodes": 3, "length": 0.3},
        base={"position": [0.0, -0.5 * min(depth, 4.0)]},
        water={"depth": depth},
        flow=[
            {"kind": "uniform", "velocity": [current, 0.0]},
            {"kind": "regular-wave", "height": _HEIGHT, "period": _PERIOD},
        ],
    )


@eqx.filter_jit
def _current(water: Water, point: Array, time: Array) -> Current:
    return water.current(point, time)


class _Tank:
    """Water of a scenario, and its wave in closed form (Airy)."""

    def __init__(self, depth: float, current: float = 0.0) -> None:
        self.depth, self.drift = depth, current
        self.water = system(_scenario(depth, current)).forces.water
        self.number = brentq(self._dispersion, 1e-4, 20.0, xtol=1e-15, rtol=1e-14)

    def _dispersion(self, number: float) -> float:
        own = np.sqrt(_GRAVITY * number * np.tanh(number * self.depth))
        return float(own + number * self.drift - _RATE)

    def at(self, x: float, z: float, time: float) -> Current:
        """Return the current of crinoid."""
        return _current(self.water, jnp.array([x, z]), jnp.asarray(time))

    def amplitudes(self, z: float) -> Float[np.ndarray, "2"]:
        """Return amplitudes of the velocity, level and upward (m/s), by crinoid."""
        crest = np.asarray(self.at(0.0, z, 0.0).velocity)
        quarter = np.asarray(self.at(0.0, z, 0.75 * _PERIOD).velocity)
        return np.array([crest[0] - self.drift, quarter[1]])

    def exact(self, z: float) -> Float[np.ndarray, "2"]:
        own = _RATE - self.number * self.drift
        k, h = self.number, self.depth
        parts = np.cosh(k * (z + h)), np.sinh(k * (z + h))
        return np.array(parts) * 0.5 * _HEIGHT * own / np.sinh(k * h)

    def found_number(self) -> float:
        """Return the wave number from the phase of crinoid's velocity one metre further on."""
        z = -0.3 * min(self.depth, 4.0)
        (level, _), along = self.amplitudes(z), self.at(1.0, z, 0.0)
        return float(np.arccos((along.velocity[0] - self.drift) / level))

    def acceleration_error(self, x: float, z: float, time: float) -> float:
        """Return how far Du/Dt is from its differences along the way of the water (m/s2)."""
        now = self.at(x, z, time)
        u = np.asarray(now.velocity)
        ends = [
            np.asarray(self.at(x + s * u[0], z + s * u[1], time + s).velocity)
            for s in (-_SPAN, _SPAN)
        ]
        return float(np.abs((ends[1] - ends[0]) / (2 * _SPAN) - now.acceleration).max())


@case(
    kind="exact",
    title="A regular wave obeys the dispersion relation, decays with depth and is shifted by a "
    "current.",
    source="Dean and Dalrymple 1991, Water Wave Mechanics, chapter 3; Peregrine 1976, Adv. Appl. "
    "Mech. 16: omega = sqrt(g k tanh k h) + k U, solved by SciPy's brentq.",
    method=f"A wave of {_HEIGHT} m and {_PERIOD:g} s; its number from the phase of the velocity "
    "over 1 m; Du/Dt against differences over 0.1 ms along the way of the water.",
    reason="Closed forms, to round-off: 1e-16 through an arc cosine near 0.1. Differences leave "
    "1e-16/1e-4 of round-off and 1e-8 of the third derivative.",
)
def waves() -> Evidence:
    still = {f"h = {depth:g} m": _Tank(depth) for depth in _DEPTHS}
    drifting = {f"U = {speed:g} m/s": _Tank(6.0, speed) for speed in _CURRENTS}
    checks = [
        Check(f"wave number, {name}", each.number, each.found_number(), 1e-9, "1/m", True)
        for name, each in (still | drifting).items()
    ]
    for name, each in (still | drifting).items():
        heights = -each.depth * np.array([0.0, 0.1, 0.5, 0.9])
        errors = [each.amplitudes(z) - each.exact(z) for z in heights]
        error = np.abs(errors).max() / each.exact(0.0).max()
        checks.append(Check(f"velocity at four heights, {name}", 0.0, float(error), 1e-9))
        error = each.acceleration_error(3.0, -0.4 * min(each.depth, 5.0), 1.3)
        checks.append(Check(f"Du/Dt by differences, {name}", 0.0, error, 1e-7, "m/s2"))

    def draw(axes: Axes) -> None:
        shown = list((still | drifting).items())[1:]  # the first wave is twice as fast
        for (name, each), colour in zip(shown, SERIES, strict=False):
            heights = np.linspace(-min(each.depth, 8.0), 0.0, 9)
            axes.plot([each.amplitudes(z)[0] for z in heights], heights, color=colour, label=name)
            level = [each.exact(z)[0] for z in heights]
            axes.plot(level, heights, "o", mfc="none", color=INK, label="linear theory")
        axes.set(xlabel="level velocity (m/s)", ylabel="z (m)")

    return Evidence(checks, None, {"": _scenario(6.0, _CURRENTS[0])}, draw)
