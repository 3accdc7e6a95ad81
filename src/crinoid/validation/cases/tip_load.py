"""A cantilever under a dead load at its tip."""

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from scipy.optimize import brentq
from scipy.special import ellipe, ellipeinc, ellipk, ellipkinc

from crinoid.simulation import equilibrium
from crinoid.validation.case import Case, Check, Evidence
from crinoid.validation.slender import MESHES, order_of, slender_arm, tip_of
from crinoid.view.figures.style import BLUE, INK, key

_EDGE = 1.0 / (MESHES[-1] - 1)
_LOADS = (1.0, 2.0, 5.0, 10.0)


def _modulus(angle: float) -> tuple[float, float]:
    """Return parameter m = k^2 and amplitude at the clamp, for a slope at the tip (rad)."""
    m = (1.0 + np.sin(angle)) / 2.0
    return m, float(np.arcsin(np.sqrt(0.5 / m)))


def exact(load: float) -> Float[np.ndarray, "3"]:
    """Return angle (rad), drop and shortening over L for a load P L^2 / EI."""

    def excess(angle: float) -> float:
        m, start = _modulus(angle)
        return float((ellipk(m) - ellipkinc(start, m)) ** 2 - load)

    angle = brentq(excess, 1e-6, np.pi / 2 - 1e-9, xtol=1e-14)
    m, start = _modulus(angle)
    drop = 1.0 - 2.0 * (ellipe(m) - ellipeinc(start, m)) / np.sqrt(load)
    return np.array([angle, drop, 1.0 - np.sqrt(2.0 * np.sin(angle) / load)])


def _run() -> Evidence:
    checks, errors, scenarios, shapes = [], np.zeros(len(MESHES)), {}, []
    for load in _LOADS:
        reference = exact(load)
        for mesh, nodes in enumerate(MESHES):
            scenario = slender_arm(nodes, {"load.0.force": [0.0, -load]})
            result = equilibrium(scenario)
            x, z = tip_of(result)
            errors[mesh] += np.hypot(-z - reference[1], 1.0 - x - reference[2])
        angle = -float(result.dataset["tip_angle"].values[-1])
        checks += [
            Check(f"angle, P = {load:g}", reference[0], angle, _EDGE**2, "rad"),
            Check(f"drop, P = {load:g}", reference[1], -z, _EDGE**2 / 3, "m"),
            Check(f"shortening, P = {load:g}", reference[2], 1.0 - x, _EDGE**2 / 3, "m"),
        ]
        scenarios[f"{load:g}"] = scenario
        shapes.append(result.dataset["position"].values[-1])
    order = order_of(errors.tolist())
    checks.append(Check("order of convergence", 2.0, order, 0.25))

    def draw(axes: Axes) -> None:
        for load, shape in zip(_LOADS, shapes, strict=True):
            axes.plot(*shape.T, color=BLUE, label="crinoid")
            _, drop, shortening = exact(load)
            axes.plot(1.0 - shortening, -drop, "o", mfc="none", color=INK, label="exact tip")
            axes.annotate(
                f"{load:g}", (1.0 - shortening, -drop), (6, 0), textcoords="offset points"
            )
        axes.set(xlabel="x/L", ylabel="z/L", aspect="equal")
        key(axes)

    return Evidence(checks, order, scenarios, draw)


CASE = Case(
    name="tip-load",
    title="A horizontal cantilever bends far under a dead load P at its tip, P L^2/EI = 1 to 10.",
    source="Mattiasson 1981, Int. J. Numer. Methods Eng. 17, 145-153: elliptic integrals, which "
    "the case evaluates by SciPy.",
    method=f"Static equilibrium with {MESHES[-1]} nodes; the order is from {MESHES[0]} and "
    f"{MESHES[-1]} nodes.",
    reason="The error of the mesh has order 2 in the length of an edge, L/40. The tip is within a "
    "third of an edge squared; its angle, which continues that of the last edges, within an "
    "edge squared. The ends of the arm add a term of order 3, hence 0.25 on the order.",
    kind="exact",
    run=_run,
)
