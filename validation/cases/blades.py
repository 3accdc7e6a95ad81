"""Blades and a chain in a steady current, with drag across them only."""

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from crinoid.scenario import Scenario
from crinoid.simulation import equilibrium
from crinoid.view.figures.style import BLUE, INK, VERMILLION
from validation.case import Check, Evidence, case
from validation.elastica import PlanarEnd, elastica
from validation.slender import (
    EDGE,
    MESHES,
    KnownBend,
    TipMeasure,
    bent,
    order_of,
    slender_arm,
)

_NODES = MESHES[-1]
_FIGURES = {1.0: 0.974833, 2.15443469: 0.903263, 10.0: 0.523612, 12.91549665: 0.461353}
"""Reconfiguration numbers of the model by Cauchy number, to the six digits given."""
_TAIL = (316.0, 1000.0)
_UPRIGHT = np.pi / 2


def _blade(nodes: int, cauchy: float, values: Mapping[str, Any]) -> Scenario:
    """Return an upright blade of neutral weight in a current along +x, with normal drag only.

    ``cauchy`` is 1/2 rho Cd d U^2 L^3/EI. ``values`` is as in `slender_arm`.
    """
    water = {
        "base.tilt_deg": 90.0,
        "arm.section.displaced_area": 1e-3,
        "water.density": 1000.0,
        "water.gravity": 1.0,
        "water.drag_normal": 1.0,
        "water.drag_tangential": 0.0,
        "flow": [{"kind": "uniform", "velocity": [float(np.sqrt(cauchy / 10.0)), 0.0]}],
    }
    return slender_arm(nodes, water | dict(values))


def _exact(cauchy: float, highest: float, buoyancy: float = 0.0) -> PlanarEnd:
    """Return the shape of a blade whose tip points at most at ``highest`` (rad).

    ``buoyancy`` is the weight of displaced water less that of the blade, per length times L^3/EI.
    """

    def load(angle: float) -> tuple[float, float]:
        drag = cauchy * np.sin(angle) * abs(np.sin(angle))
        return drag * np.sin(angle), buoyancy - drag * np.cos(angle)

    return elastica((1e-4, highest), tilt=_UPRIGHT, distributed=load)


def _share(nodes: int, cauchy: float) -> float:
    """Return the drag of crinoid's blade over that of a rigid one."""
    force = equilibrium(_blade(nodes, cauchy, {})).dataset["base_force"].values[-1]
    return float(force[0] / cauchy)


@case(
    kind="exact",
    title="A blade bends with the current: its drag over that of a rigid one is R.",
    source="Model of Gosselin, de Langre and Machado-Almeida 2010, J. Fluid Mech. 650, 319-341, "
    "with C = 1/2 rho Cd d U^2 L^3/EI; the exact rod, by shooting to 1e-12. In the limit of "
    "large C, R falls as C^(-1/3).",
    method=f"Static equilibrium with {_NODES} nodes; R is the force along the current on the "
    f"clamp. The order is from {MESHES[0]} and {_NODES} nodes.",
    reason="The blade bends over a length L C^(-1/3); the trapezoid rule errs by a twelfth of the "
    "square of the edge L/40 over it. Stretching forces have a round-off of 1e-6 N. The slope has "
    "0.007 of the former; the exact one is 0.003 from its limit.",
)
def gosselin_blade() -> Evidence:
    curve, highest = {}, _UPRIGHT - 1e-9
    for cauchy in sorted({*_FIGURES, *_TAIL, *np.logspace(-1, 3, 25)}):
        # a soft blade has more than one equilibrium: this branch bends ever more as C rises
        shape = _exact(cauchy, highest)
        highest, curve[cauchy] = shape.angle, shape.reach
    references = {0.1: curve[0.1], **_FIGURES, 100.0: curve[100.0]} | {c: curve[c] for c in _TAIL}
    found = {cauchy: _share(_NODES, cauchy) for cauchy in references}
    checks = []
    for cauchy, reference in references.items():
        within = EDGE**2 / 12 * cauchy ** (2 / 3) + 1e-6 / cauchy
        checks.append(Check(f"R, C = {cauchy:.4g}", reference, found[cauchy], within, "1", True))
    slope = np.log(found[_TAIL[1]] / found[_TAIL[0]]) / np.log(_TAIL[1] / _TAIL[0])
    checks.append(Check("slope of ln R, C = 316 to 1000", -1 / 3, float(slope), 0.01))
    order = order_of([abs(_share(nodes, 10.0) - curve[10.0]) for nodes in MESHES])
    checks.append(Check("order of convergence, C = 10", 2.0, order, 0.25))

    def draw(axes: Axes) -> None:
        axes.loglog(*zip(*curve.items(), strict=True), color=INK, label="exact")
        tail = np.array([10.0, 1000.0])
        law = curve[1000.0] * (tail / 1000.0) ** (-1 / 3)
        axes.loglog(tail, law, "--", color=VERMILLION, label="slope -1/3")
        axes.loglog(*zip(*found.items(), strict=True), "o", color=BLUE, label="crinoid")
        axes.set(xlabel="Cauchy number C", ylabel="reconfiguration number R", yticks=[0.1, 0.3, 1])
        axes.yaxis.set_major_formatter("{x:g}")
        axes.yaxis.set_minor_formatter("")

    scenarios = {f"{cauchy:.4g}": _blade(_NODES, cauchy, {}) for cauchy in (1.0, *_TAIL)}
    return Evidence(checks, order, scenarios, draw)


@case(
    kind="exact",
    title="A current bends a blade against its stiffness and its buoyancy.",
    source="Model of Luhar and Nepf 2011, Limnol. Oceanogr. 56, 2003-2017, with Ca = 1/2 rho Cd d "
    "U^2 L^3/EI and B the buoyancy per length times L^3/EI; effective length: integral of the "
    "cubed cosine from upright. The exact rod, by shooting to 1e-12.",
    method=f"Static equilibrium with {_NODES} nodes; the effective length is the force on the "
    f"clamp along the current over 1/2 rho Cd d U^2. The order is from {MESHES[0]} and "
    f"{_NODES} nodes.",
    reason="A load per length changes the curvature over an edge l by at most its l^2/(12 EI). "
    "The ends add a term of order 3: 0.25 on the order.",
)
def luhar_nepf_current() -> Evidence:
    bends = []
    for cauchy, buoyancy in ((1.0, 0.0), (1.0, 10.0), (10.0, 0.0), (10.0, 10.0)):
        values = {"arm.section.displaced_area": 1e-3 * (1.0 + buoyancy)}
        bend = KnownBend(
            f"{cauchy:g}-{buoyancy:g}",
            text := f"Ca {cauchy:g}, B {buoyancy:g}",
            partial(_blade, cauchy=cauchy, values=values),
            _exact(cauchy, _UPRIGHT - 1e-9, buoyancy),
            EDGE**2 / 12 * (cauchy + buoyancy),
            text,
            buoyancy > cauchy,
            pressure=cauchy,
        )
        bends.append(bend)
    measures = {
        "effective length": TipMeasure(lambda tip: tip.reach),
        "tip from upright": TipMeasure(lambda tip: _UPRIGHT - tip.angle, "rad"),
    }
    return bent(bends, measures, xlim=(-0.4, 1.0), ylim=(0, 1.15))


@case(
    kind="exact",
    title="A chain in a current hangs straight, at 38.173 deg where its drag is its weight w.",
    source="Balance across the chain, r cos^2 a = sin a at the angle a from the vertical, with r "
    "= 1/2 rho Cd d U^2/w: the critical angle of Pode 1951, David Taylor Model Basin Report 687, "
    "without drag along it.",
    method=f"Static equilibrium of a clamped arm with EI = 1e-4 w L^3 and {_NODES} nodes.",
    reason="A straight chain has no error of the mesh. Stretching forces have a round-off of 1e-7 "
    "N, 1e-5 of the weight of the last half edge.",
)
def limp_chain() -> Evidence:
    checks, scenarios, drawn = [], {}, []
    chain = {"base.tilt_deg": -90.0, "arm.section.EI": 1e-4, "arm.section.mass_per_length": 2.0}
    for ratio in (0.25, 1.0, 4.0):  # normal drag of a broadside chain over its weight in water
        exact = float(np.arcsin((np.sqrt(1.0 + 4.0 * ratio**2) - 1.0) / (2.0 * ratio)))
        text = f"drag {ratio:g} w"
        scenarios[f"{ratio:g}"] = scenario = _blade(_NODES, ratio, chain)
        shape = equilibrium(scenario).dataset["position"].values[-1]
        along = np.diff(shape, axis=0)
        angles = np.arctan2(along[:, 0], -along[:, 1])
        checks += [
            Check(f"angle at the middle, {text}", exact, angles[_NODES // 2], 1e-5, "rad"),
            Check(f"angle at the tip, {text}", exact, angles[-1], 1e-5, "rad"),
        ]
        drawn.append((f"{text}: {np.degrees(exact):.3f} deg", exact, shape))

    def draw(axes: Axes) -> None:
        for text, angle, shape in drawn:
            axes.plot(*shape.T, color=BLUE, label="crinoid")
            way = np.array([np.sin(angle), -np.cos(angle)])
            line = shape[_NODES // 2] + np.outer([0.0, 0.6], way)
            axes.plot(*line.T, "--", color=VERMILLION, label="exact direction")
            axes.annotate(text, line[1], (5, -3), textcoords="offset points")
        axes.set(xlabel="x/L", ylabel="z/L", aspect="equal", xlim=(-0.1, 1.7))

    remarks = (
        "The clamp holds the chain upright, and a bending stiffness of 1e-4 w L^3 straightens it "
        "within about 0.1 L.",
    )
    return Evidence(checks, None, scenarios, draw, remarks)
