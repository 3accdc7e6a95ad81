"""Natural frequencies of a cantilever in a vacuum and in water."""

import numpy as np
from matplotlib.axes import Axes
from scipy.optimize import brentq

from crinoid.simulation import equilibrium
from crinoid.validation.case import Case, Check, Evidence
from crinoid.validation.slender import MESHES, order_of, slender_arm
from crinoid.view.figures.style import BLUE, INK, VERMILLION, key

_WATER = {
    "water.density": 1000.0,
    "water.drag_normal": 0.0,
    "water.drag_tangential": 0.0,
    "water.added_mass_normal": 1.5,
    "arm.section.displaced_area": 6e-4,
}
"""Added mass Ca rho A = 0.9 kg/m, for an arm of 1 kg/m."""
_MODES = 3


def _run() -> Evidence:
    exact = np.array(
        [brentq(lambda x: np.cos(x) + 1 / np.cosh(x), n - 0.5, n + 0.5) for n in (2.0, 4.5, 8.0)]
    )
    dry, scenarios = [], {}
    for nodes in MESHES:
        scenarios["vacuum"] = slender_arm(nodes, {})
        frequency = equilibrium(scenarios["vacuum"]).dataset["natural_frequency"].values[:_MODES]
        dry.append(2 * np.pi * frequency)
    scenarios["water"] = slender_arm(MESHES[-1], _WATER)
    wet = 2 * np.pi * equilibrium(scenarios["water"]).dataset["natural_frequency"].values[:_MODES]
    fall = np.sqrt(1.0 / 1.9)
    order = order_of([abs(np.sqrt(each[-1]) - exact[-1]) for each in dry])
    checks = [
        Check(f"beta L of mode {mode + 1}", exact[mode], np.sqrt(dry[-1][mode]), 2e-6, "1", True)
        for mode in range(_MODES)
    ]
    checks += [
        Check(f"water over vacuum, mode {mode + 1}", fall, ratio, 1e-6, "1", True)
        for mode, ratio in enumerate(wet / dry[-1])
    ]
    checks.append(Check("order of mode 3", 4.0, order, 0.3))

    def draw(axes: Axes) -> None:
        modes = np.arange(1, _MODES + 1)
        axes.plot(modes, dry[-1], "o", color=VERMILLION, label="vacuum")
        axes.plot(modes, wet, "o", color=BLUE, label="water")
        for factor in (1.0, fall):
            axes.plot(modes, factor * exact**2, "_", color=INK, markersize=22, label="exact")
        axes.set(xlabel="mode", ylabel="frequency (rad/s)", yscale="log", xticks=modes)
        key(axes)

    return Evidence(checks, order, scenarios, draw)


CASE = Case(
    name="cantilever-frequencies",
    title="A cantilever vibrates at the frequencies of a beam; added mass lowers all alike.",
    source="Blevins 1979, Formulas for Natural Frequency and Mode Shape, table 8-1: roots of cos x "
    "cosh x = -1, omega = x^2 sqrt(EI/m)/L^2. In water m becomes m + Ca rho A.",
    method=f"Modes about the straight arm, with {MESHES[-1]} nodes; the order is from {MESHES[0]} "
    f"and {MESHES[-1]} nodes.",
    reason="The frequencies converge with order 4: 1e-6 is left of mode 3. Round-off of the "
    "stretching forces leaves 1e-7 of mode 1.",
    kind="exact",
    run=_run,
)
