"""From the description of obstacles to the arrays that they are computed with."""

from __future__ import annotations

import numpy as np

from crinoid.assembly.numbers import Numbers, array
from crinoid.dynamics import Obstacles
from crinoid.elements import Body, Contact
from crinoid.scenario import Scenario, Sphere


def contact_numbers(scenario: Scenario) -> Numbers | None:
    """Return what `Contact.of` takes of the obstacles, if there are any."""
    obstacles = scenario.obstacle
    if not obstacles:
        return None
    return {
        "radius": array([getattr(o, "radius", 0.0) for o in obstacles]),
        "half_axis": array([o.half_axis for o in obstacles]),
        "normal": array([o.out for o in obstacles]),
        "friction": array([o.friction for o in obstacles]),
        "mass": array([getattr(o, "mass", None) or np.inf for o in obstacles]),
    }


def body_numbers(scenario: Scenario) -> Numbers | None:
    """Return what `Body.of` takes of those that the arm can push away."""
    if not scenario.obstacle:
        return None
    free = [scenario.obstacle[index] for index in _free(scenario)]
    return {
        "mass": array([getattr(body, "mass", None) for body in free]),
        "radius": array([getattr(body, "radius", None) for body in free]),
    }


def _free(scenario: Scenario) -> tuple[int, ...]:
    """Return which obstacles the arm can push away."""
    return tuple(
        index
        for index, obstacle in enumerate(scenario.obstacle)
        if isinstance(obstacle, Sphere) and obstacle.mass is not None
    )


def build_obstacles(
    scenario: Scenario, contact: Contact | None, bodies: Body | None
) -> Obstacles | None:
    """Return all obstacles of a scenario, if there are any."""
    if contact is None or bodies is None:
        return None
    drifts = [obstacle.velocity for obstacle in scenario.obstacle]
    still = np.zeros(len(scenario.base.position))
    return Obstacles(
        contact=contact,
        bodies=bodies,
        place=array([np.subtract(o.position, scenario.base.position) for o in scenario.obstacle]),
        drift=array([still if drift == "flow" else drift for drift in drifts]),
        free=_free(scenario),
        carried=tuple(index for index, drift in enumerate(drifts) if drift == "flow"),
    )
