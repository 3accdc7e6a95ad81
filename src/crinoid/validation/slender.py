"""Slender arms: scenarios in a vacuum, of unit stiffness, mass and length."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from crinoid.results.result import Result
from crinoid.scenario import Scenario

MESHES = (21, 41)
"""Numbers of nodes: two give an order of convergence. Cases that share them compile once."""

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


def tip_of(result: Result) -> Float[np.ndarray, " axis"]:
    """Return the last position of the tip (m)."""
    return np.asarray(result.dataset["tip_position"].values[-1])


def order_of(errors: Sequence[float], refinement: float = 2.0) -> float:
    """Return the order of convergence that the last two errors show.

    ``refinement`` is the ratio of their mesh sizes or time steps.
    """
    return float(np.log(errors[-2] / errors[-1]) / np.log(refinement))
