"""An arm without water as a Cosserat rod of PyElastica."""

from collections.abc import Callable
from typing import Any

import elastica
import numpy as np

from crinoid.scenario import Scenario
from validation.peers.swing import Swing, Tips, clocked, radius_of, rod_at_rest


class _World(elastica.BaseSystemCollection, elastica.Constraints, elastica.Forcing):
    """A rod, its clamp and the forces on it."""


def prepare(
    scenario: Scenario,
    time_step: float,
    interval: float,
    samples: int,
    change: Callable[[Any], None] = lambda _: None,
) -> Swing:
    """Return a run; ``change`` is called with the rod before it is let go."""
    arm = scenario.arm
    edge, vertices, frames = rod_at_rest(scenario)
    # PyElastica's third director is the tangent
    places, directors = vertices.T.copy(), frames[:, [1, 2, 0]].transpose(1, 2, 0).copy()
    rod = elastica.CosseratRod.straight_rod(
        arm.nodes - 1,
        vertices[0],
        frames[0, 0],
        frames[0, 1],
        edge * (arm.nodes - 1),
        radius_of(scenario),
        arm.density,
        youngs_modulus=arm.youngs_modulus,
        shear_modulus=arm.youngs_modulus / (2 * (1 + arm.poisson_ratio)),
        position=places,
        directors=directors,
    )
    rod.rest_kappa[:] = rod.kappa
    change(rod)
    world = _World()
    world.append(rod)
    world.constrain(rod).using(
        elastica.OneEndFixedBC, constrained_position_idx=(0,), constrained_director_idx=(0,)
    )
    fall = np.array([0.0, 0.0, -scenario.water.gravity])
    world.add_forcing_to(rod).using(elastica.GravityForces, acc_gravity=fall)
    world.finalize()
    stepper, steps = elastica.PositionVerlet(), round(interval / time_step)
    columns = [0, 2] if arm.dimension == 2 else [0, 1, 2]

    def swing() -> Tips:
        rod.position_collection[:], rod.director_collection[:] = places, directors
        # the accelerations too: PyElastica does not clear one that is no number
        for rate in ("velocity", "omega", "acceleration", "alpha"):
            getattr(rod, f"{rate}_collection")[:] = 0.0
        tips = np.empty((samples, len(columns)))
        now, step = np.float64(0.0), np.float64(time_step)
        for tip in tips:
            for _ in range(steps):
                now = stepper.step(world, now, step)
            tip[:] = rod.position_collection[columns, -1]
        return tips

    return clocked(swing)
