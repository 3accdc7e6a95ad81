"""Readers of the solids of a scenario, by the keys of their tables."""

from collections.abc import Callable
from functools import partial

from crinoid.recording.mesh import read_mesh
from crinoid.recording.seabed import read_seabed
from crinoid.recording.solid_surface import SolidSurface
from crinoid.scenario import Mesh, Scenario, Seabed


def surface_readers(scenario: Scenario) -> dict[str, Callable[[], SolidSurface]]:
    """Return the reader of each solid of a scenario, by its key."""
    found: dict[str, Callable[[], SolidSurface]] = {}
    for index, obstacle in enumerate(scenario.obstacle):
        if isinstance(obstacle, Mesh):
            found[f"obstacle.{index}"] = partial(read_mesh, obstacle, scenario)
        elif isinstance(obstacle, Seabed):
            found[f"obstacle.{index}"] = partial(read_seabed, obstacle, scenario)
    return found
