"""A cantilever across a current, locked in to its vortices: the arm, and a beam of three modes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from crinoid.scenario import Scenario
from crinoid.simulation import simulate

LENGTH, DIAMETER, DENSITY, GRAVITY = 0.5, 0.02, 1000.0, 9.81
DRAG, LIFT, CENTRE, RANGE = 1.2, 0.8, 0.18, 0.08
DISPLACED = DENSITY * np.pi / 4 * DIAMETER**2
"""Mass of displaced water per length, which is the added mass as well (kg/m)."""
NODES, STEP, DURATION, JUDGED = 13, 0.01, 25.0, 10.0
"""Of crinoid; amplitude and frequency are those of the last ``JUDGED`` seconds."""

_ROOTS = np.array(
    [brentq(lambda x: np.cos(x) + 1 / np.cosh(x), n - 0.5, n + 0.5) for n in (2.0, 4.5, 8.0)]
)
EI = float(2 * DISPLACED * (2 * np.pi) ** 2 * LENGTH**4 / _ROOTS[0] ** 4)
"""Such that an arm as heavy as water has a lowest natural frequency of 1 Hz in water (N m2)."""


class LockIn(NamedTuple):
    """Motion of the tip across the current, and along it."""

    time: Float[np.ndarray, " t"]
    across: Float[np.ndarray, " t"]
    """m."""
    drift: float
    """Mean shift along the current (m)."""

    @property
    def amplitude(self) -> float:
        """Root of two times the standard deviation, over the diameter."""
        return float(np.sqrt(2) * self.across.std() / DIAMETER)

    @property
    def rises(self) -> Float[np.ndarray, " cycle"]:
        """Times at which the tip passes 0 (s)."""
        y, at = self.across, np.flatnonzero((self.across[:-1] < 0) & (self.across[1:] >= 0))
        return self.time[at] - y[at] * (self.time[at + 1] - self.time[at]) / (y[at + 1] - y[at])

    @property
    def frequency(self) -> float:
        """Frequency by the first and the last rise (Hz)."""
        rises = self.rises
        return float((rises.size - 1) / (rises[-1] - rises[0]))


def scenario(speed: float, heaviness: float = 1.0) -> Scenario:
    """Return the arm that hangs in a current along x; its density over that of water."""
    return Scenario().with_values(
        {
            "arm.dimension": 3,
            "arm.length": LENGTH,
            "arm.nodes": NODES,
            "arm.radius": DIAMETER / 2,
            "arm.density": heaviness * DENSITY,
            "arm.youngs_modulus": EI / (np.pi * DIAMETER**4 / 64),
            "arm.damping_time": 0.0,
            "base.tilt_deg": -90.0,
            "water.density": DENSITY,
            "water.drag_normal": DRAG,
            "water.gravity": GRAVITY,
            "water.vortices": {"lift": LIFT, "centre": CENTRE, "range": RANGE, "in_line": 0.0},
            "flow": [{"kind": "uniform", "velocity": [speed, 0.0, 0.0]}],
            "simulation.start": "rest",
            "simulation.time_step": STEP,
            "simulation.duration": DURATION,
            "output.interval": STEP,
        }
    )


def simulated(arm: Scenario) -> LockIn:
    """Return the vibration of the arm by crinoid."""
    late = simulate(arm).dataset.sel(time=slice(DURATION - JUDGED, None))
    x, y = (late["tip_position"].sel(axis=axis).values for axis in ("x", "y"))
    return LockIn(late["time"].values, y, float(x.mean()))


def integrated(
    speed: float, heaviness: float = 1.0, *, lifted: float = 1.0, memory: float | None = None
) -> LockIn:
    """Return the vibration of a linear beam of three modes along and across the current.

    Vortices of synchronisation act at Gauss points (Thorsen, Saevik and Larsen 2014, eq. 12, 13).
    The state holds the modes' coordinates x, y with their rates, and at each point the phase of
    the lift and running mean squares of the motion across the flow. DOP853, to 1e-9.

    Parameters
    ----------
    speed
        Of the current (m/s).
    heaviness
        Density of the beam over that of water; its weight pulls it straight.
    lifted
        Share of the length, from the clamp, on which lift acts.
    memory
        Time over which the squares are averaged (s); five shedding periods by default.
    """
    points, weights = np.polynomial.legendre.leggauss(12)
    places = np.concatenate([lifted * (points + 1) / 2, lifted + (1 - lifted) * (points + 1) / 2])
    shares = 0.5 * np.concatenate([lifted * weights, (1 - lifted) * weights])
    lift_at = LIFT * np.repeat([1.0, 0.0], points.size)
    mass = (heaviness + 1.0) * DISPLACED
    modes = _shapes(places)
    onto = shares * modes / mass
    stiffness = _stiffness(heaviness) / mass
    pressure, tiny = 0.5 * DENSITY * DIAMETER, 1e-20

    def rates(_: float, state: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        x, x_rate, y, y_rate = state[:12].reshape(4, 3)
        phase, mean_velocity, mean_acceleration = state[12:].reshape(3, -1)
        along, across = x_rate @ modes, y_rate @ modes
        w_x, w_y = speed - along, -across
        flow = np.hypot(w_x, w_y)
        lift = lift_at * np.cos(phase)
        x_force = onto @ (pressure * flow * (DRAG * w_x + lift * w_y)) - stiffness @ x
        y_force = onto @ (pressure * flow * (DRAG * w_y - lift * w_x)) - stiffness @ y
        # the motion along the lift, whose direction is (w_y, -w_x) / flow
        velocity = (w_y * along - w_x * across) / flow
        acceleration = (w_y * (x_force @ modes) - w_x * (y_force @ modes)) / flow
        moved = np.arctan2(
            -acceleration / np.sqrt(np.maximum(mean_acceleration, tiny)),
            velocity / np.sqrt(np.maximum(mean_velocity, tiny)),
        )
        turned = 2 * np.pi * flow / DIAMETER * (CENTRE + RANGE * np.sin(moved - phase))
        fading = CENTRE * flow / DIAMETER / 5 if memory is None else 1 / memory
        means = fading * np.stack(
            [velocity**2 - mean_velocity, acceleration**2 - mean_acceleration]
        )
        return np.concatenate([x_rate, x_force, y_rate, y_force, turned, means.ravel()])

    start = np.zeros(12 + 3 * places.size)
    start[12 : 12 + places.size] = np.random.default_rng(0).uniform(0, 2 * np.pi, places.size)
    time = np.arange(DURATION - JUDGED, DURATION, STEP)
    close = {"rtol": 1e-9, "atol": 1e-10, "max_step": 0.05}
    found = solve_ivp(rates, (0, DURATION), start, "DOP853", t_eval=time, **close).y
    tip = _shapes(np.ones(1))[:, 0]
    return LockIn(time, tip @ found[6:9], float(np.mean(tip @ found[:3])))


def _shapes(s: Float[np.ndarray, " place"]) -> Float[np.ndarray, "mode place"]:
    """Return the modes of a cantilever at arc lengths over its own, with mean squares of 1."""
    x = _ROOTS[:, None] * s
    ratio = (np.cosh(_ROOTS) + np.cos(_ROOTS)) / (np.sinh(_ROOTS) + np.sin(_ROOTS))
    return np.cosh(x) - np.cos(x) - ratio[:, None] * (np.sinh(x) - np.sin(x))


def _stiffness(heaviness: float) -> Float[np.ndarray, "mode mode"]:
    """Return the stiffness per length by bending and by the pull of the weight (N/m2)."""
    points, weights = np.polynomial.legendre.leggauss(16)
    s = (points + 1) / 2
    step = 1e-6
    slopes = (_shapes(s + step) - _shapes(s - step)) / (2 * step * LENGTH)
    pull = (heaviness - 1.0) * DISPLACED * GRAVITY * LENGTH * (1 - s)
    return np.diag(_ROOTS**4 * EI / LENGTH**4) + 0.5 * (weights * pull * slopes) @ slopes.T
