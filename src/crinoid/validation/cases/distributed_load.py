"""A cantilever under a load along its length, dead or following it."""

from collections.abc import Callable
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from crinoid.simulation import equilibrium
from crinoid.validation.case import Case, Check, Evidence
from crinoid.validation.elastica import Vector, elastica
from crinoid.validation.slender import MESHES, order_of, slender_arm, tip_of
from crinoid.view.figures.style import BLUE, INK, VERMILLION, key

_EDGE = 1.0 / (MESHES[-1] - 1)
_LOADS = {"dead": (1.0, 5.0, 9.0, 15.0, 25.0), "follower": (1.0, 3.0, 5.0, 9.0, 13.0, 25.0)}
"""w L^3/EI."""
_DIRECTION: dict[str, Any] = {"dead": [0.0, 1.0], "follower": "normal"}


def _spread(kind: str, load: float) -> Callable[[float], Vector]:
    """Return the load by the direction of the rod."""
    if kind == "dead":
        return lambda angle: (0.0, load)
    return lambda angle: (-load * np.sin(angle), load * np.cos(angle))


def _run() -> Evidence:
    checks, scenarios, shapes = [], {}, []
    errors = np.zeros(len(MESHES))
    for kind, loads in _LOADS.items():
        # a dead load turns the tip by less than a right angle, the follower by up to 3.03 rad
        highest = np.pi / 2 - 1e-9 if kind == "dead" else 3.5
        for load in loads:
            reference = elastica((0.01, highest), distributed=_spread(kind, load))
            for mesh, nodes in enumerate(MESHES):
                table = {"kind": "distributed", "direction": _DIRECTION[kind], "magnitude": load}
                scenario = slender_arm(nodes, {"load": [table]})
                result = equilibrium(scenario)
                x, z = tip_of(result)
                errors[mesh] += np.hypot(x - reference.x, z - reference.z)
            within = _EDGE**2 / 12 * load
            checks += [
                Check(f"x, {kind} {load:g}", reference.x, x, within, "m"),
                Check(f"z, {kind} {load:g}", reference.z, z, within, "m"),
            ]
            shapes.append((kind, result.dataset["position"].values[-1], reference))
        scenarios[f"{kind}-{load:g}"] = scenario
    order = order_of(errors.tolist())
    checks.append(Check("order of convergence", 2.0, order, 0.25))

    def draw(axes: Axes) -> None:
        for kind, shape, end in shapes:
            colour = BLUE if kind == "dead" else VERMILLION
            axes.plot(*shape.T, color=colour, label=f"crinoid, {kind}")
            axes.plot(end.x, end.z, "o", mfc="none", color=INK, label="exact tip")
        axes.set(xlabel="x/L", ylabel="z/L", aspect="equal")
        key(axes)

    return Evidence(checks, order, scenarios, draw)


CASE = Case(
    name="distributed-load",
    title="A load w per length bends a cantilever, w L^3/EI = 1 to 25.",
    source="Two-point boundary-value problem of the inextensible elastica, EI theta'' = t x n, "
    "n' = -w, which the case solves by shooting to 1e-12; the loads are those of PyElastica's "
    "cases of a cantilever under a distributed load.",
    method=f"Static equilibrium with {MESHES[-1]} nodes; the order is from {MESHES[0]} and "
    f"{MESHES[-1]} nodes.",
    reason="The load on an edge l changes the moment along it by w l^2/12, hence the slope of "
    "the arm by w L l^2/(12 EI) at most. The ends of the arm add a term of order 3, hence 0.25 "
    "on the order.",
    kind="exact",
    run=_run,
)
