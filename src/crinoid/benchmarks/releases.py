"""Releases of an arm that other programs can state as well."""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from crinoid.scenario import Scenario
from crinoid.scenario.arm import Arm
from crinoid.scenario.flow import UniformFlow

_SILICONE = {"length": 0.5, "radius": 0.02, "youngs_modulus": 5e5, "damping_time": 0.0}
"""An arm without damping: the engines have no kind of it in common."""


class Release(NamedTuple):
    """An arm that is held straight, or as it was made, and let go at t = 0."""

    name: str
    tables: dict[str, Any]
    """Tables of its scenario."""
    duration: float = 2.0
    """In s."""
    interval: float = 0.1
    """Time between two samples (s)."""

    @property
    def samples(self) -> int:
        """Number of samples."""
        return round(self.duration / self.interval)

    def steps(self, time_step: float) -> int:
        """Return the number of time steps between two samples."""
        return round(self.interval / time_step)

    def scenario(self, nodes: int, time_step: float = 0.01) -> Scenario:
        """Return the arm as a scenario."""
        simulation = {"start": "rest", "time_step": time_step, "duration": self.duration}
        tables = {**self.tables, "simulation": simulation}
        return Scenario.from_dict(tables).with_values({"arm.nodes": nodes})

    def numbers(self, nodes: int, time_step: float) -> dict[str, float]:
        """Return the numbers of the arm in a current by the words of an input file."""
        scenario = self.scenario(nodes, time_step)
        arm, water, flow = scenario.arm, scenario.water, scenario.flow[0]
        assert isinstance(arm.radius, float)
        assert isinstance(flow, UniformFlow)
        area = np.pi * arm.radius**2
        return {
            "length": arm.length,
            "edges": nodes - 1,
            "diameter": 2 * arm.radius,
            "mass": arm.density * area,
            "EA": arm.youngs_modulus * area,
            "EI": arm.youngs_modulus * area * arm.radius**2 / 4,
            "drag": water.drag_normal,
            "added": water.added_mass_normal,
            "load": self.tables["tool"]["mass"],
            "volume": self.tables["tool"]["volume"],
            "z": scenario.base.position[-1],
            "gravity": water.gravity,
            "density": water.density,
            "current": flow.velocity[0],
            "duration": self.duration,
            "time_step": time_step,
        }


_AIR = {"density": 0.0, "gravity": 1.0}
IN_THE_PLANE = Release(
    "in air, in the plane",
    {"arm": {**_SILICONE, "density": 1080.0}, "base": {"position": [0.0, 0.0]}, "water": _AIR},
)
"""A straight arm, clamped level, under a tenth of gravity."""
IN_SPACE = Release(
    "in air, in space",
    {
        "arm": {**_SILICONE, "dimension": 3, "density": 1080.0, "rest_curvature": [3.0, 1.0, 3.0]},
        "base": {"position": [0.0, 0.0, 0.0]},
        "water": _AIR,
    },
)
"""An arm made as a piece of a coil: it bends both ways and twists."""
IN_A_CURRENT = Release(
    "in a current",
    {
        "arm": {**_SILICONE, "density": 1025.0},
        "base": {"position": [0.0, -10.0]},
        # CableDyn has no free end: it needs a body of some mass there
        "tool": {"mass": 0.2, "volume": 0.14 / 1025.0},
        "water": {"drag_normal": 1.1, "drag_tangential": 0.0, "added_mass_normal": 1.0},
        "flow": [{"kind": "uniform", "velocity": [0.25, 0.0]}],
    },
)
"""An arm as heavy as water, level and along the current, with a load at its tip."""
RELEASES = (IN_THE_PLANE, IN_SPACE, IN_A_CURRENT)


def shape_at_rest(
    arm: Arm, edge: float
) -> tuple[Float[np.ndarray, "node axis=3"], Float[np.ndarray, "edge direction=3 axis=3"]]:
    """Return vertices (m) and frames of an arm whose first edge has its middle at the clamp.

    Of a frame the rows are the tangent, m_1 and m_2. The engines of the peers hold the first edge,
    so that it begins half an edge (m) behind the clamp.
    """
    strains = arm.rest_curvature
    one, two, twist = strains if isinstance(strains, tuple) else (0.0, strains, 0.0)
    # bending toward m_1 turns about m_2, bending toward m_2 about -m_1
    turns = np.outer(edge * np.arange(arm.nodes - 1), [twist, -two, one])
    frames = Rotation.from_rotvec(turns).as_matrix().transpose(0, 2, 1)
    places = np.concatenate([np.zeros((1, 3)), np.cumsum(edge * frames[:, 0], axis=0)])
    return places - [edge / 2, 0.0, 0.0], frames
