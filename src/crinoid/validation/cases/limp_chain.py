"""A heavy chain that hangs in a current."""

import numpy as np
from matplotlib.axes import Axes

from crinoid.simulation import equilibrium
from crinoid.validation.case import Case, Check, Evidence
from crinoid.validation.cases.gosselin_blade import blade
from crinoid.validation.slender import MESHES
from crinoid.view.figures.style import BLUE, VERMILLION, key

_NODES = MESHES[-1]
_RATIOS = (0.25, 1.0, 4.0)
"""Normal drag of a broadside chain over its weight in water."""
_CHAIN = {"base.tilt_deg": -90.0, "arm.section.EI": 1e-4, "arm.section.mass_per_length": 2.0}


def exact(ratio: float) -> float:
    """Return the angle from the vertical (rad)."""
    return float(np.arcsin((np.sqrt(1.0 + 4.0 * ratio**2) - 1.0) / (2.0 * ratio)))


def _run() -> Evidence:
    checks, scenarios, shapes = [], {}, []
    for ratio in _RATIOS:
        scenario = blade(_NODES, ratio, _CHAIN)
        result = equilibrium(scenario)
        shape = result.dataset["position"].values[-1]
        along = np.diff(shape, axis=0)
        angles = np.arctan2(along[:, 0], -along[:, 1])
        text = f"drag {ratio:g} w"
        checks += [
            Check(f"angle at the middle, {text}", exact(ratio), angles[_NODES // 2], 1e-5, "rad"),
            Check(f"angle at the tip, {text}", exact(ratio), angles[-1], 1e-5, "rad"),
        ]
        scenarios[f"{ratio:g}"] = scenario
        shapes.append(shape)

    def draw(axes: Axes) -> None:
        for ratio, shape in zip(_RATIOS, shapes, strict=True):
            axes.plot(*shape.T, color=BLUE, label="crinoid")
            angle = exact(ratio)
            middle = shape[_NODES // 2]
            line = middle + np.outer([0.0, 0.6], [np.sin(angle), -np.cos(angle)])
            axes.plot(*line.T, "--", color=VERMILLION, label="exact direction")
            text = f"drag {ratio:g} w: {np.degrees(angle):.3f} deg"
            axes.annotate(text, line[1], (5, -3), textcoords="offset points")
        axes.set(xlabel="x/L", ylabel="z/L", aspect="equal", xlim=(-0.1, 1.7))
        key(axes)

    remarks = (
        "The clamp holds the chain upright, and a bending stiffness of 1e-4 w L^3 straightens it "
        "within about 0.1 L.",
    )
    return Evidence(checks, None, scenarios, draw, remarks)


CASE = Case(
    name="limp-chain",
    title="A chain in a current hangs straight, at 38.173 deg where its drag is its weight w.",
    source="Balance across the chain, r cos^2 a = sin a at the angle a from the vertical, with r "
    "= 1/2 rho Cd d U^2/w: the critical angle of Pode 1951, David Taylor Model Basin Report 687, "
    "without drag along it.",
    method=f"Static equilibrium of a clamped arm with EI = 1e-4 w L^3 and {_NODES} nodes.",
    reason="A straight chain has no error of the mesh. Stretching forces have a round-off of 1e-7 "
    "N, which is 1e-5 of the weight of the last half edge.",
    kind="exact",
    run=_run,
)
