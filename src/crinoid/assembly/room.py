"""Whether the arm has room among the obstacles."""

import numpy as np
from jaxtyping import Float

from crinoid.dynamics import System
from crinoid.programs import ONCE, compiled
from crinoid.scenario import Mistake, ScenarioError

_clearance = compiled(**ONCE)(System.clearance)


def find_room(system: System) -> Float[np.ndarray, " m"]:
    """Return how far each obstacle is from the arm without load (m)."""
    room = np.asarray(_clearance(system))
    mistakes = [
        Mistake(
            f"obstacle.{index}.position",
            f"lies {-1e3 * gap:.3g} mm inside the arm without load, takes a position clear of it",
        )
        for index, gap in enumerate(room)
        if gap < 0
    ]
    if mistakes:
        raise ScenarioError(mistakes)
    return room
