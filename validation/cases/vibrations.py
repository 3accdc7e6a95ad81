"""Vibrations of a cantilever, their damping, and the swing of a rigid pendulum."""

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from scipy.interpolate import CubicSpline
from scipy.linalg import expm
from scipy.special import ellipk

from crinoid.analysis.vibrations import modes
from crinoid.scenario import Scenario
from crinoid.simulation import equilibrium, simulate
from crinoid.view.figures.style import BLUE, INK, VERMILLION
from validation.case import Check, Evidence, case
from validation.slender import MESHES, cantilever_roots, order_of, slender_arm

_DRY = {"arm.section.EA": 1e4}
"""Soft enough that round-off of the stretching forces is below the error of the mesh."""
_WATER = {
    "water.density": 1000.0,
    "water.drag_normal": 0.0,
    "water.drag_tangential": 0.0,
    "water.added_mass_normal": 1.5,
    "arm.section.displaced_area": 6e-4,
}
"""Added mass Ca rho A = 0.9 kg/m, for an arm of 1 kg/m."""
_MODES = (1, 2, 3)


def _frequencies(scenario: Scenario) -> Float[np.ndarray, " mode"]:
    """Return the circular frequencies of the slowest modes (rad/s)."""
    found = equilibrium(scenario).dataset["natural_frequency"].values
    return np.asarray(2 * np.pi * found[: len(_MODES)])


@case(
    kind="exact",
    title="A cantilever vibrates at the frequencies of a beam; added mass lowers all alike.",
    source="Blevins 1979, Formulas for Natural Frequency and Mode Shape, table 8-1: roots of cos x "
    "cosh x = -1, omega = x^2 sqrt(EI/m)/L^2. In water m becomes m + Ca rho A.",
    method=f"Modes about the straight arm, with {MESHES[-1]} nodes; the order is the least of "
    f"three modes, from {MESHES[0]} and {MESHES[-1]} nodes.",
    reason="The error has order 4 in the edge L/40 and is below (beta L/40)^4/1000; higher orders "
    "add 0.3 to the order. Added mass is spread like mass: the ratio has no error of the mesh.",
)
def cantilever_frequencies() -> Evidence:
    exact = cantilever_roots(len(_MODES))
    scenarios = {
        "vacuum": slender_arm(MESHES[-1], _DRY),
        "water": slender_arm(MESHES[-1], _DRY | _WATER),
    }
    coarse = _frequencies(slender_arm(MESHES[0], _DRY))
    dry, wet = map(_frequencies, scenarios.values())
    fall, within = np.sqrt(1.0 / 1.9), (exact / (MESHES[-1] - 1)) ** 4 / 1000
    errors = np.abs(np.sqrt([coarse, dry]) - exact)
    order = min(order_of(each.tolist()) for each in errors.T)
    checks = [
        Check(f"beta L of mode {mode}", *numbers, relative=True)
        for mode, *numbers in zip(_MODES, exact, np.sqrt(dry), within, strict=True)
    ]
    checks += [
        Check(f"wet over dry, mode {mode}", fall, ratio, 1e-9, relative=True)
        for mode, ratio in zip(_MODES, wet / dry, strict=True)
    ]
    checks.append(Check("order of convergence", 4.0, order, 0.3))

    def draw(axes: Axes) -> None:
        axes.plot(_MODES, dry, "o", color=VERMILLION, label="vacuum")
        axes.plot(_MODES, wet, "o", color=BLUE, label="water")
        for factor in (1.0, fall):
            axes.plot(_MODES, factor * exact**2, "_", color=INK, markersize=22, label="exact")
        axes.set(xlabel="mode", ylabel="frequency (rad/s)", yscale="log", xticks=_MODES)

    return Evidence(checks, order, scenarios, draw)


_DAMPING, _RATIO, _TIME, _DRAG, _FORCE = 0.01, 0.5, 0.8, 3.0, 1e-3
_STEPS = np.array([2e-2, 1e-2, 5e-3])
_NODES, _DURATION = 11, 2.0
_ROOTS = cantilever_roots(8)


def _drop(times: Float[np.ndarray, " t"]) -> Float[np.ndarray, " t"]:
    """Return the deflection (m) of the tip under a force from t = 0, by modes and exponentials.

    Of a mode: q'' + c q' + omega^2 (q + T q' + b) = 2 F phi(L), b' = ratio q' - b/time.
    """
    tip = np.zeros(times.size)
    for rate in _ROOTS**4:
        # every mode of mass 1 has a squared amplitude of 4 at the tip
        matrix = np.zeros((4, 4))
        matrix[:3] = [
            [0.0, 1.0, 0.0, 0.0],
            [-rate, -_DRAG - rate * _DAMPING, -rate, 4 * _FORCE],
            [0.0, _RATIO, -1 / _TIME, 0.0],
        ]
        step = expm(matrix * (times[1] - times[0]))
        state = np.array([0.0, 0.0, 0.0, 1.0])
        for index in range(times.size):
            tip[index] += state[0]
            state = step @ state
    return tip


@case(
    kind="exact",
    title="A cantilever with Kelvin-Voigt damping, and one whose material also relaxes: it creeps "
    "under a force at its tip.",
    source="Viscoelastic Euler-Bernoulli beam: damping ratio damping_time omega_n/2; creep by a "
    "sum of modes, each with a Maxwell branch, integrated by a matrix exponential.",
    method=f"Damped modes about the straight arm, and a creep of {_DURATION:g} s in steps of 20, "
    f"10 and 5 ms, with {_NODES} nodes; the order is from changes between steps.",
    reason="The mesh errs by 1e-4. Steps of 5 ms err by (omega h)^2/12: 3e-5 of the first mode "
    "and 1e-3 of the second, 2 % of the deflection; the jump of the force adds as much.",
)
def damping_ratio() -> Evidence:
    arm = {"arm.damping_time": _DAMPING}
    elastic = slender_arm(_NODES, arm)
    ratios = modes(elastic, in_air=True)["damping_ratio"].values[0]
    checks = [
        Check(f"ratio of mode {n + 1}", _DAMPING * _ROOTS[n] ** 2 / 2, ratios[n], 5e-4, "1", True)
        for n in range(2)
    ]
    creep = {
        "arm.relaxation": [{"ratio": _RATIO, "time": _TIME}],
        "arm.section.EA": 1e4,
        "water.linear_drag": _DRAG,
        "load.0.force": [0.0, _FORCE],
        "simulation.duration": _DURATION,
        "simulation.start": "rest",
        "simulation.tolerance": 1e-12,
        "output.interval": float(_STEPS[0]),
    }
    moved, scenarios = [], {"modes": elastic}
    for step in _STEPS:
        scenario = slender_arm(_NODES, arm | creep | {"simulation.time_step": float(step)})
        data = simulate(scenario).dataset
        moved.append(data["tip_position"].values[:, 1])
    scenarios["creep"] = scenario
    times = data["time"].values
    exact = _drop(times)
    largest = np.abs(exact).max()
    changes = [np.abs(moved[i] - moved[i + 1]).max() for i in range(2)]
    order = order_of(changes)
    error = np.abs(moved[-1] - exact).max() / largest
    checks += [
        Check("largest error of the tip over its deflection", 0.0, error, 1e-3),
        Check("deflection after 2 s", exact[-1], moved[-1][-1], 1e-3, "m", True),
        Check("order in the time step", 2.0, order, 0.2),
    ]

    def draw(axes: Axes) -> None:
        axes.plot(times, 1e3 * moved[-1], color=BLUE, label="crinoid")
        axes.plot(times[::4], 1e3 * exact[::4], "o", mfc="none", color=INK, label="exact")
        axes.axhline(1e3 * _FORCE / 3, color=INK, lw=0.7, ls="--", label="relaxed, F L$^3$/(3 EI)")
        axes.set(xlabel="time (s)", ylabel="deflection of the tip (mm)")

    return Evidence(checks, order, scenarios, draw)


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


@case(
    kind="published",
    title="A rigid cylinder on a pin swings in water of its own density: double inertia.",
    source="Example of ONSAS: T = 2 pi sqrt(2/g (d^2/(8 l) + 2 l/3)) with l = 3.0443 m, section "
    "0.1 m2, Ca = 1, weight as in air. Large swings: T K(sin^2(angle/2)) 2/pi.",
    method="The slowest mode about the hanging arm, with 6 nodes; a swing of 5 s, steps of 2.5 ms.",
    reason="The rotary inertia, which crinoid leaves out, is a share of 1.3e-3 of the period. "
    "Without it small swings are exact on any mesh. Steps of h lengthen a swing by about (omega "
    "h)^2/12 = 1.3e-6.",
)
def pendulum_added_mass() -> Evidence:
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

    checks = [
        Check("period of small swings, published", published, small, 1.5e-3, "s", True),
        Check("the same without rotary inertia", thin, small, 1e-6, "s", True),
        Check("period from 60 degrees, without rotary inertia", exact, large, 1e-5, "s", True),
    ]
    return Evidence(checks, None, {"small": hanging, "large": swung}, draw)
