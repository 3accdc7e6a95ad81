"""A standing column under a dead load at its tip, up to and past buckling."""

import numpy as np
from matplotlib.axes import Axes
from scipy.optimize import brentq
from scipy.special import ellipe, ellipk

from crinoid.scenario import Scenario
from crinoid.simulation import equilibrium
from crinoid.validation.case import Case, Check, Evidence
from crinoid.validation.slender import MESHES, order_of, slender_arm, tip_of
from crinoid.view.figures.style import BLUE, INK, key

_EULER = np.pi**2 / 4
_BELOW = np.array([0.4, 0.6, 0.8, 0.9, 0.96]) * _EULER
_LEANS = np.radians([40.0, 80.0, 120.0, 160.0])
"""Angles of the tip from the vertical."""


def column(nodes: int, load: float) -> Scenario:
    """Return an upright column with a dead load at its tip."""
    return slender_arm(nodes, {"base.tilt_deg": 90.0, "load.0.force": [0.0, -float(load)]})


def elastica_at(m: float) -> tuple[float, float, float]:
    """Return the load, and how far aside and how high the tip is, for m = sin^2(lean/2)."""
    k = ellipk(m)
    return float(k**2), float(2.0 * np.sqrt(m) / k), float(2.0 * ellipe(m) / k - 1.0)


def _critical(nodes: int) -> float:
    """Return the load at which the squared lowest frequency, a smooth function of it, is 0."""
    results = [equilibrium(column(nodes, load)) for load in _BELOW]
    squares = [each.dataset["natural_frequency"].values[0] ** 2 for each in results]
    return float(np.polyval(np.polyfit(squares, _BELOW, _BELOW.size - 1), 0.0))


def _run() -> Evidence:
    critical = [_critical(nodes) for nodes in MESHES]
    order = order_of([abs(each - _EULER) for each in critical])
    edge = 1.0 / (MESHES[-1] - 1)
    share = _EULER / 12.0 * edge**2
    checks = [
        Check("P L^2/EI that buckles", _EULER, critical[-1], 1.1 * share, relative=True),
        Check("order of convergence", 2.0, order, 0.1),
    ]
    scenarios, shapes = {}, []
    for lean in _LEANS:
        m = np.sin(lean / 2.0) ** 2
        load, aside, height = elastica_at(m)
        # the tip of a column that bears a load more by the share that the mesh is softer
        heavier = load * (1.0 + load * edge**2 / 12.0)
        softer = elastica_at(brentq(lambda m, p=heavier: elastica_at(m)[0] - p, m, 1.0 - 1e-9))
        within = np.hypot(softer[1] - aside, softer[2] - height)
        within += 2.0 * np.sqrt(m * load) * edge**2 / 12.0
        scenario = column(MESHES[-1], load)
        result = equilibrium(scenario)
        x, z = tip_of(result)
        text = f"tip at {np.degrees(lean):.0f} deg"
        checks += [
            Check(f"aside, {text}", aside, abs(x), float(within), "m"),
            Check(f"height, {text}", height, z, float(within), "m"),
        ]
        scenarios[f"{np.degrees(lean):.0f}-deg"] = scenario
        shapes.append((load / _EULER, result.dataset["position"].values[-1], (aside, height)))

    def draw(axes: Axes) -> None:
        for ratio, shape, end in shapes:
            axes.plot(np.abs(shape[:, 0]), shape[:, 1], color=BLUE, label="crinoid")
            axes.plot(*end, "o", mfc="none", color=INK, label="exact tip")
            text = f"{ratio:.3f} times Euler's load"
            axes.annotate(text, end, (7, -3), textcoords="offset points")
        axes.set(xlabel="x/L", ylabel="z/L", aspect="equal", xlim=(-0.1, 1.6))
        key(axes)

    return Evidence(checks, order, scenarios, draw)


CASE = Case(
    name="euler-buckling",
    title="A column buckles under Euler's load pi^2 EI/(4 L^2) at its tip, and leans beyond it.",
    source="Euler's load, and the elastica beyond it in elliptic integrals: Timoshenko and Gere "
    "1961, Theory of Elastic Stability, section 2.7.",
    method=f"The lowest natural frequency about five standing equilibria, with {MESHES[-1]} "
    "nodes; the load at which its square is 0, by a polynomial. Static equilibria at four loads "
    f"beyond it. The order is from {MESHES[0]} and {MESHES[-1]} nodes.",
    reason="A thrust P softens the bend of an edge l by the share P l^2/(12 EI): so much is the "
    "buckling load low, and a tenth is for the polynomial. Beyond it the tip moves as from so "
    "much more load; the corners of the arm add a twelfth of curvature times l^2.",
    kind="exact",
    run=_run,
)
