"""Damping of a cantilever: Kelvin-Voigt ratios, and creep of a relaxing material."""

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from scipy.linalg import expm
from scipy.optimize import brentq

from crinoid.analysis.vibrations import modes
from crinoid.simulation import simulate
from crinoid.validation.case import Case, Check, Evidence
from crinoid.validation.slender import order_of, slender_arm
from crinoid.view.figures.style import BLUE, INK, key

_DAMPING, _RATIO, _TIME, _DRAG, _FORCE = 0.01, 0.5, 0.8, 3.0, 1e-3
_STEPS = np.array([2e-2, 1e-2, 5e-3])
_NODES, _DURATION = 11, 2.0
_ROOTS = np.array(
    [
        brentq(lambda x: np.cos(x) + 1 / np.cosh(x), (n - 0.6) * np.pi, (n - 0.4) * np.pi)
        for n in range(1, 9)
    ]
)
"""Roots of cos x cosh x = -1: omega = x^2 of EI = m = L = 1."""


def _drop(times: Float[np.ndarray, " t"]) -> Float[np.ndarray, " t"]:
    """Return the deflection (m) of the tip under a force from t = 0, by modes and exponentials.

    Of a mode: q'' + c q' + omega^2 (q + T q' + b) = 2 F phi(L), b' = ratio q' - b/time.
    """
    tip = np.zeros(times.size)
    for root in _ROOTS:
        rate = root**4
        # every mode of mass 1 has a squared amplitude of 4 at the tip
        matrix = np.array(
            [
                [0.0, 1.0, 0.0, 0.0],
                [-rate, -_DRAG - rate * _DAMPING, -rate, 4 * _FORCE],
                [0.0, _RATIO, -1 / _TIME, 0.0],
                [0.0, 0.0, 0.0, 0.0],
            ]
        )
        step = expm(matrix * (times[1] - times[0]))
        state = np.array([0.0, 0.0, 0.0, 1.0])
        for index in range(times.size):
            tip[index] += state[0]
            state = step @ state
    return tip


def _run() -> Evidence:
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
        key(axes)

    return Evidence(checks, order, scenarios, draw)


CASE = Case(
    name="damping-ratio",
    title="A cantilever with Kelvin-Voigt damping, and one whose material also relaxes: it creeps "
    "under a force at its tip.",
    source="Viscoelastic Euler-Bernoulli beam: damping ratio damping_time omega_n/2; creep by a "
    "sum of modes, each with a Maxwell branch, integrated by a matrix exponential.",
    method=f"Damped modes about the straight arm, and a creep of {_DURATION:g} s in steps of 20, "
    f"10 and 5 ms, with {_NODES} nodes; the order is from changes between steps.",
    reason="The frequencies of this mesh are within 1e-4. Steps of 5 ms follow the first mode to "
    "(omega h)^2/12 = 3e-5, the second, 2 % of the deflection, to 1e-3; the jump of the force adds "
    "as much.",
    kind="exact",
    run=_run,
)
