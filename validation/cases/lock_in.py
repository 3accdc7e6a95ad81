"""A cantilever across a current, locked in to its vortices: arm, beam of modes, MoorDyn."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from scipy.integrate import solve_ivp

from crinoid.scenario import Scenario
from crinoid.simulation import simulate
from crinoid.view.figures.style import BLUE, INK, VERMILLION
from validation.case import Check, Evidence, case
from validation.slender import cantilever_roots

_LENGTH, _DIAMETER, _DENSITY, _GRAVITY = 0.5, 0.02, 1000.0, 9.81
_DRAG, _LIFT, _CENTRE, _RANGE = 1.2, 0.8, 0.18, 0.08
_DISPLACED = _DENSITY * np.pi / 4 * _DIAMETER**2
"""Mass of displaced water per length, which is the added mass as well (kg/m)."""
_NODES, _STEP, _DURATION, _JUDGED = 13, 0.01, 25.0, 10.0
"""Of crinoid; amplitude and frequency are those of the last ``_JUDGED`` seconds."""

_ROOTS = cantilever_roots(3)
_EI = float(2 * _DISPLACED * (2 * np.pi) ** 2 * _LENGTH**4 / _ROOTS[0] ** 4)
"""Such that an arm as heavy as water has a lowest natural frequency of 1 Hz in water (N m2)."""


class _LockIn(NamedTuple):
    """Motion of the tip across the current, and along it."""

    time: Float[np.ndarray, " t"]
    across: Float[np.ndarray, " t"]
    """m."""
    drift: float
    """Mean shift along the current (m)."""

    @property
    def amplitude(self) -> float:
        """Root of two times the standard deviation, over the diameter."""
        return float(np.sqrt(2) * self.across.std() / _DIAMETER)

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


def _scenario(speed: float, heaviness: float = 1.0) -> Scenario:
    """Return the arm that hangs in a current along x; its density over that of water."""
    vortices = {"lift": _LIFT, "centre": _CENTRE, "range": _RANGE, "in_line": 0.0}
    return Scenario(
        arm={"dimension": 3, "length": _LENGTH, "nodes": _NODES, "radius": _DIAMETER / 2}
        | {"density": heaviness * _DENSITY, "damping_time": 0.0}
        | {"youngs_modulus": _EI / (np.pi * _DIAMETER**4 / 64)},
        base={"tilt_deg": -90.0},
        water={"density": _DENSITY, "drag_normal": _DRAG, "gravity": _GRAVITY}
        | {"vortices": vortices},
        flow=[{"kind": "uniform", "velocity": [speed, 0.0, 0.0]}],
        simulation={"start": "rest", "time_step": _STEP, "duration": _DURATION},
        output={"interval": _STEP},
    )


def _simulated(arm: Scenario) -> _LockIn:
    """Return the vibration of the arm by crinoid."""
    late = simulate(arm).dataset.sel(time=slice(_DURATION - _JUDGED, None))
    x, y = (late["tip_position"].sel(axis=axis).values for axis in ("x", "y"))
    return _LockIn(late["time"].values, y, float(x.mean()))


def _integrated(
    speed: float, heaviness: float = 1.0, *, lifted: float = 1.0, memory: float | None = None
) -> _LockIn:
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
    lift_at = _LIFT * np.repeat([1.0, 0.0], points.size)
    mass = (heaviness + 1.0) * _DISPLACED
    modes = _shapes(places)
    onto = shares * modes / mass
    stiffness = _stiffness(heaviness) / mass
    pressure, tiny = 0.5 * _DENSITY * _DIAMETER, 1e-20

    def rates(_: float, state: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        x, x_rate, y, y_rate = state[:12].reshape(4, 3)
        phase, mean_velocity, mean_acceleration = state[12:].reshape(3, -1)
        along, across = x_rate @ modes, y_rate @ modes
        w_x, w_y = speed - along, -across
        flow = np.hypot(w_x, w_y)
        lift = lift_at * np.cos(phase)
        x_force = onto @ (pressure * flow * (_DRAG * w_x + lift * w_y)) - stiffness @ x
        y_force = onto @ (pressure * flow * (_DRAG * w_y - lift * w_x)) - stiffness @ y
        # the motion along the lift, whose direction is (w_y, -w_x) / flow
        velocity = (w_y * along - w_x * across) / flow
        acceleration = (w_y * (x_force @ modes) - w_x * (y_force @ modes)) / flow
        moved = np.arctan2(
            -acceleration / np.sqrt(np.maximum(mean_acceleration, tiny)),
            velocity / np.sqrt(np.maximum(mean_velocity, tiny)),
        )
        turned = 2 * np.pi * flow / _DIAMETER * (_CENTRE + _RANGE * np.sin(moved - phase))
        fading = _CENTRE * flow / _DIAMETER / 5 if memory is None else 1 / memory
        means = fading * np.stack(
            [velocity**2 - mean_velocity, acceleration**2 - mean_acceleration]
        )
        return np.concatenate([x_rate, x_force, y_rate, y_force, turned, means.ravel()])

    start = np.zeros(12 + 3 * places.size)
    start[12 : 12 + places.size] = np.random.default_rng(0).uniform(0, 2 * np.pi, places.size)
    time = np.arange(_DURATION - _JUDGED, _DURATION, _STEP)
    close = {"rtol": 1e-9, "atol": 1e-10, "max_step": 0.05}
    found = solve_ivp(rates, (0, _DURATION), start, "DOP853", t_eval=time, **close).y
    tip = _shapes(np.ones(1))[:, 0]
    return _LockIn(time, tip @ found[6:9], float(np.mean(tip @ found[:3])))


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
    slopes = (_shapes(s + step) - _shapes(s - step)) / (2 * step * _LENGTH)
    pull = (heaviness - 1.0) * _DISPLACED * _GRAVITY * _LENGTH * (1 - s)
    return np.diag(_ROOTS**4 * _EI / _LENGTH**4) + 0.5 * (weights * pull * slopes) @ slopes.T


def _draw(speed: float, curves: Iterable[tuple[str, _LockIn, str, str]], axes: Axes) -> None:
    """Draw motions by name, colour and line."""
    for name, motion, colour, line in curves:
        y = motion.across / _DIAMETER
        axes.plot(motion.time - motion.rises[0], y, line, color=colour, label=name)
    axes.set(xlabel=f"time (s), at {speed:.3f} m/s", ylabel="tip across the current, y/D")
    axes.set_xlim(0.0, 6.0)


_SHARES = (0.22, 0.14)
"""Natural frequency, 1 Hz, times D/U."""


@case(
    kind="exact",
    title="A neutral cantilever in a current locks in to its vortices, by synchronisation.",
    source="Thorsen, Saevik and Larsen 2014, J. Fluids Struct. 51, eq. 12 and 13, the phase of "
    "the lift; three modes of a linear beam by DOP853 to 1e-9.",
    method=f"{_NODES} nodes in space, time step {_STEP:g} s, 25 diameters long, at natural "
    f"frequencies of {' and '.join(f'{share:g}' for share in _SHARES)} U/D; the last {_JUDGED:g} s "
    f"of {_DURATION:g} s.",
    reason="Random phases at the start change the amplitude by up to 1 %, slopes of the arm of up "
    "to 0.07 by 0.5 %. Mesh and step add about 1 % each.",
)
def vortex_lock_in() -> Evidence:
    checks, scenarios, pairs = [], {}, []
    for share in _SHARES:
        speed = _DIAMETER / share
        scenarios[f"{share:g}"] = _scenario(speed)
        exact, found = _integrated(speed), _simulated(scenarios[f"{share:g}"])
        pairs.append((speed, exact, found))
        text = f"{speed:.4f} m/s"
        checks += [
            Check(f"A/D, {text}", exact.amplitude, found.amplitude, 0.05, relative=True),
            Check(f"frequency, {text}", exact.frequency, found.frequency, 0.01, "Hz", True),
            Check(f"mean drift, {text}", exact.drift, found.drift, 0.05, "m", True),
        ]

    speed, exact, found = pairs[0]
    curves = (("crinoid", found, BLUE, "-"), ("three modes", exact, INK, "--"))
    return Evidence(checks, None, scenarios, partial(_draw, speed, curves))


_HEAVINESS = 2.0
"""Density over that of water: MoorDyn's lines do not resist compression."""
_HEAVY_SPEEDS = (_DIAMETER / 0.14, _DIAMETER / 0.12)
_EDGES, _TIME_STEP = 12, 2e-3
_MEMORY = 500 * _TIME_STEP
"""MoorDyn averages the motion over 500 of its steps (s)."""
_LIFTED = 1 - 0.5 / _EDGES
"""MoorDyn has no lift on the half segment at the tip."""


def _moordyn(arm: Scenario) -> _LockIn:
    from validation.peers.moordyn import prepare

    line = arm.with_values({"arm.nodes": _EDGES + 1})
    # a stiffer line needs shorter steps, and so has a shorter memory
    swing = prepare(line, _TIME_STEP, _STEP, round(_DURATION / _STEP), damping=-0.5, EA=100.0)
    late = swing()[0][-round(_JUDGED / _STEP) :]
    return _LockIn(_STEP * np.arange(late.shape[0]), late[:, 1], float(late[:, 0].mean()))


@case(
    kind="peer",
    title="A heavy cylinder hangs in a current and locks in to its vortices, as in MoorDyn.",
    source="MoorDyn 2.7.2, run in the case, with its model of Thorsen, Saevik and Larsen.",
    method=f"{_NODES} nodes in space, time step {_STEP:g} s; MoorDyn with {_EDGES} segments and a "
    f"step of {_TIME_STEP:g} s. Of both the last {_JUDGED:g} s of {_DURATION:g} s.",
    reason="MoorDyn, with its memory, lift and 12 segments, is up to 1.6 % in amplitude and 1.2 % "
    "in frequency from the beam of three modes; phases at the start add 1 %.",
    needs=("moordyn",),
)
def moordyn_vortices() -> Evidence:
    checks, scenarios, pairs = [], {}, []
    for speed in _HEAVY_SPEEDS:
        text = f"{speed:.4f} m/s"
        scenarios[text.split()[0]] = arm = _scenario(speed, _HEAVINESS)
        theirs, ours = _moordyn(arm), _simulated(arm)
        full = _integrated(speed, _HEAVINESS)
        cut = _integrated(speed, _HEAVINESS, lifted=_LIFTED, memory=_MEMORY)
        amplitude = ours.amplitude * cut.amplitude / full.amplitude
        frequency = ours.frequency * cut.frequency / full.frequency
        pairs.append((speed, theirs, ours))
        checks += [
            Check(f"A/D, {text}", theirs.amplitude, amplitude, 0.03, relative=True),
            Check(f"frequency, {text}", theirs.frequency, frequency, 0.02, "Hz", True),
        ]

    lost = 100 * (1 - cut.amplitude / full.amplitude)
    remarks = (
        "MoorDyn has no lift on the last half segment and averages the motion over 500 of its "
        f"steps. By a beam of three modes this lowers A/D by {lost:.1f} % at {text}; crinoid's "
        "numbers are scaled by such shares.",
        f"Without that, crinoid has {ours.amplitude:.3f} D and {ours.frequency:.4f} Hz at {text}, "
        f"MoorDyn {theirs.amplitude:.3f} D and {theirs.frequency:.4f} Hz.",
    )
    first, theirs, ours = pairs[0]
    names = ("crinoid, as it is", ours, BLUE, "-"), ("MoorDyn, as it is", theirs, VERMILLION, "-")
    return Evidence(checks, None, scenarios, partial(_draw, first, names), remarks)
