"""An upright blade, with and without buoyancy, in a steady current."""

import numpy as np
from matplotlib.axes import Axes

from crinoid.simulation import equilibrium
from crinoid.validation.case import Case, Check, Evidence
from crinoid.validation.cases.gosselin_blade import blade, exact
from crinoid.validation.slender import MESHES, order_of, tip_of
from crinoid.view.figures.style import BLUE, INK, key

_EDGE = 1.0 / (MESHES[-1] - 1)
_CASES = ((1.0, 0.0), (1.0, 10.0), (10.0, 0.0), (10.0, 10.0))
"""Cauchy and buoyancy number."""


def _run() -> Evidence:
    checks, scenarios, shapes, ends = [], {}, [], []
    errors = np.zeros(len(MESHES))
    for cauchy, buoyancy in _CASES:
        reference = exact(cauchy, np.pi / 2 - 1e-9, buoyancy)
        for mesh, nodes in enumerate(MESHES):
            values = {"arm.section.displaced_area": 1e-3 * (1.0 + buoyancy)}
            scenario = blade(nodes, cauchy, values)
            result = equilibrium(scenario)
            x, z = tip_of(result)
            errors[mesh] += np.hypot(x - reference.x, z - reference.z)
        length = float(result.dataset["base_force"].values[-1, 0]) / cauchy
        lean = np.pi / 2 - float(result.dataset["tip_angle"].values[-1])
        text, within = f"Ca {cauchy:g}, B {buoyancy:g}", _EDGE**2 / 12 * (cauchy + buoyancy)
        checks += [
            Check(f"effective length, {text}", reference.reach, length, within, "m"),
            Check(f"tip from upright, {text}", np.pi / 2 - reference.angle, lean, within, "rad"),
        ]
        scenarios[f"{cauchy:g}-{buoyancy:g}"] = scenario
        shapes.append(result.dataset["position"].values[-1])
        ends.append(reference)
    order = order_of(errors.tolist())
    checks.append(Check("order of convergence", 2.0, order, 0.25))

    def draw(axes: Axes) -> None:
        for (cauchy, buoyancy), shape, end in zip(_CASES, shapes, ends, strict=True):
            axes.plot(*shape.T, color=BLUE, label="crinoid")
            axes.plot(end.x, end.z, "o", mfc="none", color=INK, label="exact tip")
            text = f"Ca {cauchy:g}, B {buoyancy:g}"
            side = "right" if buoyancy > cauchy else "left"
            shift = (-7 if side == "right" else 7, 3)
            axes.annotate(text, (end.x, end.z), shift, textcoords="offset points", ha=side)
        axes.set(xlabel="x/L", ylabel="z/L", aspect="equal", xlim=(-0.4, 1.0), ylim=(0, 1.15))
        key(axes)

    return Evidence(checks, order, scenarios, draw)


CASE = Case(
    name="luhar-nepf-current",
    title="A current bends a blade against its stiffness and its buoyancy.",
    source="Model of Luhar and Nepf 2011, Limnol. Oceanogr. 56, 2003-2017, with Ca = 1/2 rho Cd d "
    "U^2 L^3/EI and B the buoyancy per length times L^3/EI; effective length: integral of the "
    "cubed cosine from upright. The exact rod, by shooting to 1e-12.",
    method=f"Static equilibrium with {MESHES[-1]} nodes; the effective length is the force on the "
    f"clamp along the current over 1/2 rho Cd d U^2. The order is from {MESHES[0]} and "
    f"{MESHES[-1]} nodes.",
    reason="A load per length changes the curvature over an edge l by its l^2/(12 EI) at most. "
    "The ends of the arm add a term of order 3, hence 0.25 on the order.",
    kind="exact",
    run=_run,
)
