"""Natural frequencies of a cantilever in a vacuum and in water."""

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from scipy.optimize import brentq

from crinoid.scenario import Scenario
from crinoid.simulation import equilibrium
from crinoid.validation.case import Case, Check, Evidence
from crinoid.validation.slender import MESHES, order_of, slender_arm
from crinoid.view.figures.style import BLUE, INK, VERMILLION, key

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


def frequencies(scenario: Scenario) -> Float[np.ndarray, " mode"]:
    """Return the circular frequencies of the slowest modes (rad/s)."""
    found = equilibrium(scenario).dataset["natural_frequency"].values
    return np.asarray(2 * np.pi * found[: len(_MODES)])


def _run() -> Evidence:
    exact = np.array(
        [brentq(lambda x: np.cos(x) + 1 / np.cosh(x), n - 0.5, n + 0.5) for n in (2.0, 4.5, 8.0)]
    )
    dry, scenarios = [], {}
    for nodes in MESHES:
        scenarios["vacuum"] = slender_arm(nodes, _DRY)
        frequency = (
            equilibrium(scenarios["vacuum"]).dataset["natural_frequency"].values[: len(_MODES)]
        )
        dry.append(2 * np.pi * frequency)
    scenarios["water"] = slender_arm(MESHES[-1], _DRY | _WATER)
    wet = (
        2
        * np.pi
        * equilibrium(scenarios["water"]).dataset["natural_frequency"].values[: len(_MODES)]
    )
    fall, within = np.sqrt(1.0 / 1.9), (exact / (MESHES[-1] - 1)) ** 4 / 1000
    errors = np.abs(np.sqrt(dry) - exact)
    order = min(order_of(each.tolist()) for each in errors.T)
    checks = [
        Check(f"beta L of mode {mode}", *numbers, relative=True)
        for mode, *numbers in zip(_MODES, exact, np.sqrt(dry[-1]), within, strict=True)
    ]
    checks += [
        Check(f"wet over dry, mode {mode}", fall, ratio, 1e-9, relative=True)
        for mode, ratio in zip(_MODES, wet / dry[-1], strict=True)
    ]
    checks.append(Check("order of convergence", 4.0, order, 0.3))

    def draw(axes: Axes) -> None:
        axes.plot(_MODES, dry[-1], "o", color=VERMILLION, label="vacuum")
        axes.plot(_MODES, wet, "o", color=BLUE, label="water")
        for factor in (1.0, fall):
            axes.plot(_MODES, factor * exact**2, "_", color=INK, markersize=22, label="exact")
        axes.set(xlabel="mode", ylabel="frequency (rad/s)", yscale="log", xticks=_MODES)
        key(axes)

    return Evidence(checks, order, scenarios, draw)


CASE = Case(
    name="cantilever-frequencies",
    title="A cantilever vibrates at the frequencies of a beam; added mass lowers all alike.",
    source="Blevins 1979, Formulas for Natural Frequency and Mode Shape, table 8-1: roots of cos x "
    "cosh x = -1, omega = x^2 sqrt(EI/m)/L^2. In water m becomes m + Ca rho A.",
    method=f"Modes about the straight arm, with {MESHES[-1]} nodes; the order is the least of "
    f"three modes, from {MESHES[0]} and {MESHES[-1]} nodes.",
    reason="The error has order 4 in the length of an edge, L/40, and is below (beta L/40)^4 / "
    "1000. Terms of higher order make it fall faster, hence 0.3 on the order. Added mass is "
    "spread like mass, so the ratio has no error of the mesh.",
    kind="exact",
    run=_run,
)
