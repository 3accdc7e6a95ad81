"""Releases of an arm that other programs can state as well."""

from typing import Any, NamedTuple

from crinoid.scenario import Scenario

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

    def scenario(self, nodes: int, time_step: float = 0.01) -> Scenario:
        """Return the arm as a scenario."""
        simulation = {"start": "rest", "time_step": time_step, "duration": self.duration}
        tables = {**self.tables, "simulation": simulation}
        return Scenario.from_dict(tables).with_values({"arm.nodes": nodes})


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
