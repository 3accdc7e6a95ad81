"""A cantilever that a moment at its tip bends into a circle."""

import numpy as np
from matplotlib.axes import Axes

from crinoid.results.metrics import short_way
from crinoid.simulation import equilibrium
from crinoid.validation.case import Case, Check, Evidence
from crinoid.validation.slender import MESHES, order_of, slender_arm, tip_of
from crinoid.view.figures.style import BLUE, INK, key

_TURNS = (0.5, 1.0)


def _run() -> Evidence:
    checks, scenarios, shapes = [], {}, []
    errors = np.zeros(len(MESHES))
    for turns in _TURNS:
        angle = 2.0 * np.pi * turns
        # after whole or half turns the sine of the angle is 0
        end = (0.0, (1.0 - np.cos(angle)) / angle)
        for mesh, nodes in enumerate(MESHES):
            scenario = slender_arm(nodes, {"load.0.moment": angle})
            result = equilibrium(scenario)
            tip = tip_of(result)
            errors[mesh] += np.hypot(*(tip - end))
        turned = angle + short_way(result.dataset["tip_angle"].values - angle)[-1]
        text = f"{turns:g} turn"
        checks += [
            Check(f"x, {text}", end[0], tip[0], 1e-3, "m"),
            Check(f"z, {text}", end[1], tip[1], 1e-3, "m"),
            Check(f"angle, {text}", angle, turned, 1e-3, "rad"),
        ]
        scenarios[f"{turns:g}"] = scenario
        shapes.append(result.dataset["position"].values[-1])
    order = order_of(errors.tolist())
    checks.append(Check("order of convergence", 2.0, order, 0.1))

    def draw(axes: Axes) -> None:
        for turns, shape in zip(_TURNS, shapes, strict=True):
            angle = 2.0 * np.pi * turns * np.linspace(0.0, 1.0, 13)
            radius = 0.5 / (np.pi * turns)
            axes.plot(*shape.T, color=BLUE, label="crinoid")
            exact = radius * np.sin(angle), radius * (1.0 - np.cos(angle))
            axes.plot(*exact, "o", mfc="none", color=INK, label="exact")
        axes.set(xlabel="x/L", ylabel="z/L", aspect="equal")
        key(axes)

    return Evidence(checks, order, scenarios, draw)


CASE = Case(
    name="end-moment",
    title="A moment 2 pi EI/L at the tip closes a straight cantilever to a circle.",
    source="Euler's elastica: M = EI kappa, the same along the arm.",
    method=f"Static equilibrium with {MESHES[-1]} nodes under a moment and half of it; the order "
    f"is from {MESHES[0]} and {MESHES[-1]} nodes.",
    reason="Corners of the arm are on a wider circle and the clamp ends half an edge early: the "
    "tip of a full circle is off by pi/(6 N^2) L, 3.3e-4 L with N = 40 edges, of order 2.",
    kind="exact",
    run=_run,
)
