"""Order of Newmark's method on a large swing."""

from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes

from crinoid.simulation import simulate
from crinoid.validation.case import Case, Check, Evidence
from crinoid.validation.slender import MESHES, order_of, slender_arm
from crinoid.view.figures.style import BLUE, INK, key

_STEPS = np.array([8e-3, 4e-3, 2e-3, 1e-3])
_DURATION = 0.8


def _run() -> Evidence:
    ends = []
    for step in _STEPS:
        scenario = slender_arm(
            MESHES[0],
            {
                "arm.damping_time": 0.02,
                "arm.section.EA": 1e3,
                "water.gravity": 10.0,
                "simulation.time_step": float(step),
                "simulation.duration": _DURATION,
                "simulation.tolerance": 1e-12,
                "simulation.start": "rest",
                "output.interval": _DURATION,
            },
        )
        ends.append(simulate(scenario).dataset["position"].values[-1])
    # of successive steps: no run without error of the time step is needed
    changes = [float(np.abs(one - other).max()) for one, other in pairwise(ends)]
    order = order_of(changes)
    checks = [
        Check("order of convergence", 2.0, order, 0.05),
        Check("change, 2 to 1 ms", 0.0, changes[-1], 3e-4, "m"),
    ]

    def draw(axes: Axes) -> None:
        axes.loglog(1e3 * _STEPS[1:], changes, "o-", color=BLUE, label="crinoid")
        slope = changes[-1] * (_STEPS[1:] / _STEPS[-1]) ** 2
        axes.loglog(1e3 * _STEPS[1:], slope, "--", color=INK, label="order 2")
        axes.set(xlabel="time step (ms)", ylabel="change from twice the step (m)")
        axes.xaxis.set_major_formatter("{x:g}")
        axes.xaxis.set_minor_formatter("{x:g}")
        key(axes)

    return Evidence(checks, order, {"": scenario}, draw)


CASE = Case(
    name="newmark-order",
    title="A heavy arm falls from level; Newmark's method converges with order 2 in the time step.",
    source="Newmark 1959, J. Eng. Mech. Div. ASCE 85(3), 67-94: order 2 with gamma = 1/2.",
    method=f"w L^3/EI = 10 and EA L^2/EI = 1000, {MESHES[0]} nodes, {_DURATION:g} s in steps of "
    "8, 4, 2 and 1 ms; the order is from the changes between the last three.",
    reason="Terms of order 4 shift the measured order by less than 0.05 at these steps.",
    kind="exact",
    run=_run,
)
