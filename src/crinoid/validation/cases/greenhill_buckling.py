"""A standing arm that buckles under its own weight."""

import numpy as np
from matplotlib.axes import Axes
from scipy.optimize import brentq
from scipy.special import jv

from crinoid.simulation import equilibrium
from crinoid.validation.case import Case, Check, Evidence
from crinoid.validation.slender import MESHES, order_of, slender_arm
from crinoid.view.figures.style import BLUE, INK, VERMILLION, key

_WEIGHTS = np.array([3.0, 4.5, 6.0, 7.0, 7.5])
"""w L^3/EI, below the buckling load."""


def _run() -> Evidence:
    exact = 2.25 * brentq(lambda x: jv(-1 / 3, x), 1.0, 2.5, xtol=1e-14) ** 2
    critical, scenarios = [], {}
    for nodes in MESHES:
        squares = []
        for weight in _WEIGHTS:
            scenario = slender_arm(nodes, {"base.tilt_deg": 90.0, "water.gravity": weight})
            frequency = equilibrium(scenario).dataset["natural_frequency"].values[0]
            squares.append(frequency**2)
        # the square of the frequency is a smooth function of the load, and 0 at the buckling load
        critical.append(float(np.polyval(np.polyfit(squares, _WEIGHTS, _WEIGHTS.size - 1), 0.0)))
        scenarios[f"{nodes}-nodes"] = scenario
    order = order_of([abs(each - exact) for each in critical])

    def draw(axes: Axes) -> None:
        axes.plot(_WEIGHTS, squares, "o", color=BLUE, label="crinoid")
        line = np.linspace(0.0, max(squares), 50)
        weights = np.polyval(np.polyfit(squares, _WEIGHTS, _WEIGHTS.size - 1), line)
        axes.plot(weights, line, color=BLUE, linewidth=0.8, label="polynomial")
        axes.axvline(exact, color=VERMILLION, linestyle="--", label="exact buckling load")
        axes.axhline(0.0, color=INK, linewidth=0.7)
        axes.set(xlabel="w L$^3$/EI", ylabel="squared frequency (Hz$^2$)")
        key(axes)

    load = Check("w L^3/EI that buckles", exact, critical[-1], 5e-4, relative=True)
    checks = [load, Check("order of convergence", 2.0, order, 0.1)]
    return Evidence(checks, order, scenarios, draw)


CASE = Case(
    name="greenhill-buckling",
    title="A standing arm buckles under its own weight w per length.",
    source="Greenhill 1881, Proc. Camb. Phil. Soc. 4: w L^3/EI is 9/4 of the square of the first "
    "zero of the Bessel function J_(-1/3).",
    method=f"The lowest natural frequency about five standing equilibria, with {MESHES[-1]} nodes; "
    f"the load at which its square is 0, by a polynomial. The order is from {MESHES[0]} and "
    f"{MESHES[-1]} nodes.",
    reason="A thrust softens the bend of an edge: the load is low by 0.516/N^2 of itself with N "
    "edges, 3.2e-4 with 40.",
    kind="exact",
    run=_run,
)
