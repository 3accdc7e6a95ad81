"""A standing arm that buckles under a load at its tip, and under its own weight."""

from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from scipy.optimize import brentq
from scipy.special import ellipe, ellipk, jv

from crinoid.scenario import Scenario
from crinoid.simulation import equilibrium
from crinoid.view.figures.style import BLUE, INK, VERMILLION
from validation.case import Check, Evidence, case
from validation.slender import EDGE, MESHES, order_of, slender_arm, tip_of

_EULER = np.pi**2 / 4
_LEANS = np.radians([40.0, 80.0, 120.0, 160.0])
"""Angles of the tip from the vertical."""
Loads = Float[np.ndarray, " load"]


def _standing(nodes: int, values: dict[str, Any]) -> Scenario:
    return slender_arm(nodes, {"base.tilt_deg": 90.0, **values})


def _column(nodes: int, load: float) -> Scenario:
    return _standing(nodes, {"load.0.force": [0.0, -float(load)]})


def _heavy(nodes: int, weight: float) -> Scenario:
    return _standing(nodes, {"water.gravity": weight})


def _critical(arm: Callable[[int, float], Scenario], nodes: int, loads: Loads) -> tuple[Any, float]:
    """Return the squared lowest frequency at loads, a smooth function, and where it is 0."""
    results = [equilibrium(arm(nodes, load)) for load in loads]
    squares = [each.dataset["natural_frequency"].values[0] ** 2 for each in results]
    return squares, float(np.polyval(np.polyfit(squares, loads, loads.size - 1), 0.0))


def _elastica_at(m: float) -> tuple[float, float, float]:
    """Return the load, and how far aside and how high the tip is, for m = sin^2(lean/2)."""
    k = ellipk(m)
    return float(k**2), float(2.0 * np.sqrt(m) / k), float(2.0 * ellipe(m) / k - 1.0)


@case(
    kind="exact",
    title="A column buckles under Euler's load pi^2 EI/(4 L^2) at its tip, and leans beyond it.",
    source="Euler's load, and the elastica beyond it in elliptic integrals: Timoshenko and Gere "
    "1961, Theory of Elastic Stability, section 2.7.",
    method="The load at which the square of the lowest natural frequency is 0, by a polynomial "
    f"through five standing equilibria with {MESHES[-1]} nodes. Static equilibria at four loads "
    f"beyond it. The order is from {MESHES[0]} and {MESHES[-1]} nodes.",
    reason="A thrust P softens the bend of an edge l, and lowers the buckling load, by the share "
    "P l^2/(12 EI); a tenth is for the polynomial. Beyond it the tip moves as from so much more "
    "load; corners add a twelfth of curvature times l^2.",
)
def euler_buckling() -> Evidence:
    below = np.array([0.4, 0.6, 0.8, 0.9, 0.96]) * _EULER
    critical = [_critical(_column, nodes, below)[1] for nodes in MESHES]
    order = order_of([abs(each - _EULER) for each in critical])
    share = _EULER / 12.0 * EDGE**2
    checks = [
        Check("P L^2/EI that buckles", _EULER, critical[-1], 1.1 * share, relative=True),
        Check("order of convergence", 2.0, order, 0.1),
    ]
    scenarios, shapes = {}, []
    for lean in _LEANS:
        m = np.sin(lean / 2.0) ** 2
        load, aside, height = _elastica_at(m)
        # the tip of a column that bears a load more by the share that the mesh is softer
        heavier = load * (1.0 + load * EDGE**2 / 12.0)
        softer = _elastica_at(brentq(lambda m, p=heavier: _elastica_at(m)[0] - p, m, 1.0 - 1e-9))
        within = np.hypot(softer[1] - aside, softer[2] - height)
        within += 2.0 * np.sqrt(m * load) * EDGE**2 / 12.0
        text = f"{np.degrees(lean):.0f}"
        scenarios[f"{text}-deg"] = scenario = _column(MESHES[-1], load)
        result = equilibrium(scenario)
        x, z = tip_of(result)
        checks += [
            Check(f"aside, tip at {text} deg", aside, abs(x), within, "m"),
            Check(f"height, tip at {text} deg", height, z, within, "m"),
        ]
        shapes.append((load / _EULER, result.dataset["position"].values[-1], (aside, height)))

    def draw(axes: Axes) -> None:
        for ratio, shape, end in shapes:
            axes.plot(np.abs(shape[:, 0]), shape[:, 1], color=BLUE, label="crinoid")
            axes.plot(*end, "o", mfc="none", color=INK, label="exact tip")
            text = f"{ratio:.3f} times Euler's load"
            axes.annotate(text, end, (7, -3), textcoords="offset points")
        axes.set(xlabel="x/L", ylabel="z/L", aspect="equal", xlim=(-0.1, 1.6))

    return Evidence(checks, order, scenarios, draw)


@case(
    kind="exact",
    title="A standing arm buckles under its own weight w per length.",
    source="Greenhill 1881, Proc. Camb. Phil. Soc. 4: w L^3/EI is 9/4 of the square of the first "
    "zero of the Bessel function J_(-1/3).",
    method=f"As for euler-buckling, with {MESHES[-1]} nodes; the order is from {MESHES[0]} and "
    f"{MESHES[-1]} nodes.",
    reason="A thrust softens the bend of an edge: the load is low by a share of 0.516/N^2, 3.2e-4 "
    "with N = 40 edges.",
)
def greenhill_buckling() -> Evidence:
    weights = np.array([3.0, 4.5, 6.0, 7.0, 7.5])
    exact = 2.25 * brentq(lambda x: jv(-1 / 3, x), 1.0, 2.5, xtol=1e-14) ** 2
    found = [_critical(_heavy, nodes, weights) for nodes in MESHES]
    order = order_of([abs(each - exact) for _, each in found])
    squares, critical = found[-1]

    def draw(axes: Axes) -> None:
        axes.plot(weights, squares, "o", color=BLUE, label="crinoid")
        line = np.linspace(0.0, max(squares), 50)
        along = np.polyval(np.polyfit(squares, weights, weights.size - 1), line)
        axes.plot(along, line, color=BLUE, linewidth=0.8, label="polynomial")
        axes.axvline(exact, color=VERMILLION, linestyle="--", label="exact buckling load")
        axes.axhline(0.0, color=INK, linewidth=0.7)
        axes.set(xlabel="w L$^3$/EI", ylabel="squared frequency (Hz$^2$)")

    load = Check("w L^3/EI that buckles", exact, critical, 5e-4, relative=True)
    checks = [load, Check("order of convergence", 2.0, order, 0.1)]
    scenarios = {f"{nodes}-nodes": _heavy(nodes, weights[-1]) for nodes in MESHES}
    return Evidence(checks, order, scenarios, draw)
