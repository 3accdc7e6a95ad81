"""A rigid pendulum with added mass."""

import numpy as np
from matplotlib.axes import Axes
from scipy.interpolate import CubicSpline
from scipy.special import ellipk

from crinoid.simulation import equilibrium, simulate
from crinoid.validation.case import Case, Check, Evidence
from crinoid.validation.slender import slender_arm
from crinoid.view.figures.style import BLUE, INK, key

_LENGTH, _AREA, _GRAVITY, _DENSITY = 3.0443, 0.1, 9.81, 1000.0
_RELEASE = np.deg2rad(60.0)
"""Angle from the vertical at which it is let go."""
_WEIGHT = _DENSITY * _AREA * _GRAVITY
_PENDULUM = {
    "arm.length": _LENGTH,
    "arm.section.EA": 1e10,
    "arm.section.EI": 1e9,
    "arm.section.mass_per_length": _DENSITY * _AREA,
    "arm.section.displaced_area": _AREA,
    "arm.section.diameter": 2 * np.sqrt(_AREA / np.pi),
    "base.mount": "pinned",
    "base.tilt_deg": -90.0,
    "water.density": _DENSITY,
    "water.gravity": _GRAVITY,
    "water.drag_normal": 0.0,
    "water.drag_tangential": 0.0,
    "water.added_mass_normal": 1.0,
    # undoes the buoyancy: the source has the weight as if in air
    "load.1": {"kind": "distributed", "direction": [0.0, -1.0], "magnitude": _WEIGHT},
}


def _period(rotary: float) -> float:
    """Return the period (s) of small swings; ``rotary`` is the term of rotary inertia (m)."""
    return float(2 * np.pi * np.sqrt(2 / _GRAVITY * (rotary + 2 * _LENGTH / 3)))


def _run() -> Evidence:
    published = _period(4 * _AREA / np.pi / (8 * _LENGTH))
    thin = _period(0.0)
    hanging = slender_arm(6, _PENDULUM)
    small = 1 / float(equilibrium(hanging).dataset["natural_frequency"][0])
    released = {
        "base.tilt_deg": np.rad2deg(_RELEASE) - 90.0,
        "simulation.start": "rest",
        "simulation.duration": 5.0,
        "simulation.time_step": 0.0025,
        "output.interval": 0.0025,
    }
    swung = slender_arm(6, _PENDULUM | released)
    data = simulate(swung).dataset
    time, tip = data["time"].values, data["tip_position"].values[:, 0]
    crossings = CubicSpline(time, tip).roots(extrapolate=False)
    large = 2 * float(crossings[1] - crossings[0])
    exact = thin * 2 / np.pi * ellipk(np.sin(_RELEASE / 2) ** 2)

    def draw(axes: Axes) -> None:
        axes.plot(time, tip, color=BLUE, label="crinoid")
        ends = exact * np.array([0.25, 0.75])
        axes.plot(ends, np.zeros(2), "o", mfc="none", color=INK, label="exact crossings")
        axes.set(xlabel="time (s)", ylabel="x of the tip (m)")
        key(axes)

    checks = [
        Check("period of small swings, published", published, small, 1.5e-3, "s", True),
        Check("the same without rotary inertia", thin, small, 1e-6, "s", True),
        Check("period from 60 degrees, without rotary inertia", exact, large, 1e-5, "s", True),
    ]
    return Evidence(checks, None, {"small": hanging, "large": swung}, draw)


CASE = Case(
    name="pendulum-added-mass",
    title="A rigid cylinder on a pin swings in water of its own density: double inertia.",
    source="Example of ONSAS: T = 2 pi sqrt(2/g (d^2/(8 l) + 2 l/3)) with l = 3.0443 m, section "
    "0.1 m2, Ca = 1, weight as in air. Large swings: T K(sin^2(angle/2)) 2/pi.",
    method="The slowest mode about the hanging arm, with 6 nodes; a swing of 5 s, steps of 2.5 ms.",
    reason="crinoid leaves out the rotary inertia, a share 1.3e-3 of the period. Without it small "
    "swings are exact on any mesh. Steps of h lengthen a swing by the order of (omega h)^2/12, "
    "1.3e-6.",
    kind="published",
    run=_run,
)
