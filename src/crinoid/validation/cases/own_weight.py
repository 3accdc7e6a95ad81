"""A cantilever under its own weight."""

import numpy as np
from matplotlib.axes import Axes

from crinoid.simulation import equilibrium
from crinoid.validation.case import Case, Check, Evidence
from crinoid.validation.elastica import elastica
from crinoid.validation.slender import MESHES, order_of, slender_arm, tip_of
from crinoid.view.figures.style import BLUE, INK, key

_EDGE = 1.0 / (MESHES[-1] - 1)
_WEIGHTS = (1.0, 5.0, 10.0)


def _run() -> Evidence:
    checks, scenarios, shapes, exact = [], {}, [], []
    errors = np.zeros(len(MESHES))
    for weight in _WEIGHTS:
        ends = (-np.pi / 2 + 1e-9, -0.05)
        reference = elastica(ends, distributed=lambda _, weight=weight: (0.0, -weight))
        for mesh, nodes in enumerate(MESHES):
            scenario = slender_arm(nodes, {"water.gravity": weight})
            result = equilibrium(scenario)
            x, z = tip_of(result)
            errors[mesh] += np.hypot(x - reference.x, z - reference.z)
        text = f"w = {weight:g}"
        checks += [
            Check(f"drop, {text}", -reference.z, -z, _EDGE**2 / 3, "m"),
            Check(f"shortening, {text}", 1.0 - reference.x, 1.0 - x, _EDGE**2 / 3, "m"),
        ]
        scenarios[f"{weight:g}"] = scenario
        shapes.append(result.dataset["position"].values[-1])
        exact.append(reference)
    order = order_of(errors.tolist())
    checks.append(Check("order of convergence", 2.0, order, 0.25))

    def draw(axes: Axes) -> None:
        for weight, shape, end in zip(_WEIGHTS, shapes, exact, strict=True):
            axes.plot(*shape.T, color=BLUE, label="crinoid")
            axes.plot(end.x, end.z, "o", mfc="none", color=INK, label="exact tip")
            axes.text(end.x + 0.02, end.z, f"{weight:g}", va="center")
        axes.set(xlabel="x/L", ylabel="z/L", aspect="equal")
        key(axes)

    return Evidence(checks, order, scenarios, draw)


CASE = Case(
    name="own-weight",
    title="A horizontal cantilever hangs under its own weight w per length, w L^3/EI = 1 to 10.",
    source="Two-point boundary-value problem of the inextensible elastica, EI theta'' = w (L - s) "
    "cos theta, which the case solves by shooting to 1e-12.",
    method=f"Static equilibrium with {MESHES[-1]} nodes; the order is from {MESHES[0]} and "
    f"{MESHES[-1]} nodes.",
    reason="The error of the mesh has order 2 in the length of an edge, L/40; the tip is within a "
    "third of an edge squared. The ends of the arm add a term of order 3, hence 0.25 on the order.",
    kind="exact",
    run=_run,
)
