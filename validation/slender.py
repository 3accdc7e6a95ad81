"""Slender arms: scenarios in a vacuum, of unit stiffness, mass and length, and their bends."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from scipy.optimize import brentq

from crinoid.results.errors import short_way
from crinoid.results.result import Result
from crinoid.scenario import Scenario
from crinoid.simulation import equilibrium
from crinoid.view.figures.style import BLUE, INK
from validation.case import Check, Evidence
from validation.elastica import PlanarEnd

MESHES = (21, 41)
"""Numbers of nodes: two give an order of convergence. Cases that share them compile once."""
BY_MESHES = (
    f"Static equilibrium with {MESHES[-1]} nodes; the order is from {MESHES[0]} and {MESHES[-1]} "
    "nodes."
)
EDGE = 1.0 / (MESHES[-1] - 1)
"""Length of an edge of the finer mesh over that of the arm."""

_ARM: dict[str, Any] = {
    "arm.length": 1.0,
    "arm.damping_time": 0.0,
    # a load of 10 N stretches the arm by 1e-6, far above the round-off of the stretching forces
    "arm.section": {
        "EA": 1e7,
        "EI": 1.0,
        "mass_per_length": 1.0,
        "diameter": 0.02,
        "displaced_area": 0.0,
    },
    "base.position": [0.0, 0.0],
    "water.density": 0.0,
    "water.gravity": 0.0,
    "load": [{"kind": "tip", "force": [0.0, 0.0], "moment": 0.0}],
}


def slender_arm(nodes: int, values: Mapping[str, Any]) -> Scenario:
    """Return a clamped arm along +x with EI, L and mass of 1 (SI), which hardly stretches.

    It is in a vacuum without gravity and has one load, at the tip and of 0. ``values`` replaces
    numbers by their dotted keys, such as ``load.0.force``.
    """
    return Scenario().with_values(_ARM).with_values({"arm.nodes": nodes, **values})


def cantilever_roots(count: int) -> Float[np.ndarray, " mode"]:
    """Return roots x of cos x cosh x = -1: a cantilever has omega = x^2 sqrt(EI/m)/L^2."""
    ends = [((n - 0.6) * np.pi, (n - 0.4) * np.pi) for n in range(1, count + 1)]
    return np.array([brentq(lambda x: np.cos(x) + 1 / np.cosh(x), *each) for each in ends])


def tip_of(result: Result) -> Float[np.ndarray, " axis"]:
    """Return the last position of the tip (m)."""
    return np.asarray(result.dataset["tip_position"].values[-1])


def order_of(errors: Sequence[float]) -> float:
    """Return the order of convergence of the last two errors, of a mesh or step and half of it."""
    return float(np.log2(errors[-2] / errors[-1]))


class KnownBend(NamedTuple):
    """A planar arm in equilibrium, and where its tip is exactly."""

    label: str
    """Name of its scenario."""
    text: str
    """Name in the checks."""
    arm: Callable[[int], Scenario]
    """Its scenario by the number of nodes."""
    end: PlanarEnd
    """Exact tip from the root, in the units of the arm."""
    within: float
    """Tolerance of its checks."""
    note: str = ""
    """Text next to the tip in the figure."""
    left: bool = False
    """Whether it is left of the tip."""
    points: Float[np.ndarray, "axis place"] | None = None
    """Exact places for the figure; by default the tip."""
    colour: str = BLUE
    name: str = "crinoid"
    pressure: float = 1.0
    """Drag per length of a rigid arm (N/m), for the reach."""


class TipMeasure(NamedTuple):
    """A function of the tip that is checked."""

    of: Callable[[PlanarEnd], float]
    unit: str = "m"
    share: float = 1.0
    """Its tolerance over that of the bend."""


PLACE = {"x": TipMeasure(lambda tip: tip.x), "z": TipMeasure(lambda tip: tip.z)}


def bent(
    bends: Sequence[KnownBend],
    measures: Mapping[str, TipMeasure],
    order_within: float = 0.25,
    **look: Any,
) -> Evidence:
    """Compare equilibria with their exact tips on two meshes.

    Parameters
    ----------
    bends
        The arms; the order of convergence is that of the sum of the distances of all tips.
    measures
        Measures of the tip by the names of their checks.
    order_within
        Tolerance of the order of convergence from 2.
    look
        Settings of the axes of the figure.
    """
    errors, checks, scenarios, shapes = np.zeros(len(MESHES)), [], {}, []
    for bend in bends:
        for mesh, nodes in enumerate(MESHES):
            scenarios[bend.label] = scenario = bend.arm(nodes)
            result, root = equilibrium(scenario), np.array(scenario.base.position)
            x, z = tip_of(result) - root
            errors[mesh] += np.hypot(x - bend.end.x, z - bend.end.z)
        data = result.dataset
        angle = bend.end.angle + short_way(data["tip_angle"].values - bend.end.angle)[-1]
        tip = PlanarEnd(x, z, angle, data["base_force"].values[-1, 0] / bend.pressure)
        for name, (of, unit, share) in measures.items():
            within = share * bend.within
            checks.append(Check(f"{name}, {bend.text}", of(bend.end), of(tip), within, unit))
        shapes.append(data["position"].values[-1] - root)
    order = order_of(errors.tolist())
    checks.append(Check("order of convergence", 2.0, order, order_within))

    def draw(axes: Axes) -> None:
        for bend, shape in zip(bends, shapes, strict=True):
            axes.plot(*shape.T, color=bend.colour, label=bend.name)
            tip = bend.end[:2]
            points = np.array([tip]).T if bend.points is None else bend.points
            exact = "exact tip" if bend.points is None else "exact"
            axes.plot(*points, "o", mfc="none", color=INK, label=exact)
            place: Any = {"xytext": (-7 if bend.left else 7, -3), "textcoords": "offset points"}
            axes.annotate(bend.note, tip, ha="right" if bend.left else "left", **place)
        axes.set(**{"xlabel": "x/L", "ylabel": "z/L", "aspect": "equal"} | look)

    return Evidence(checks, order, scenarios, draw)
