"""The arm of a scenario as a Cosserat rod of PyElastica, to be timed and compared with crinoid.

PyElastica's rods bend, twist, stretch and shear, and their sections have inertia about all three
axes. Water is left out but for its buoyancy, which reduces gravity; so is damping, because the
Kelvin-Voigt damping of an arm is not among what PyElastica has.
"""

import elastica
import numpy as np

from crinoid import Scenario
from rest_shape import rest_shape


class _World(elastica.BaseSystemCollection, elastica.Constraints, elastica.Forcing):
    """A rod, its clamp and the forces on it, as PyElastica collects them."""


class ElasticaRod:
    """A rod that leaves the clamp along x, with as many vertices as the arm has nodes.

    Its first vertex and its first element are held. As what is held is the middle of an element,
    the rod begins half an element behind the clamp, and its tip is at the arm's length.
    """

    def __init__(self, scenario: Scenario) -> None:
        arm, water = scenario.arm, scenario.water
        edge = arm.length / (arm.nodes - 1.5)
        places, frames = rest_shape(arm, edge)
        places -= [edge / 2, 0.0, 0.0]
        # PyElastica's third director is the tangent
        directors = frames[:, [1, 2, 0]].transpose(1, 2, 0)
        self._rod = elastica.CosseratRod.straight_rod(
            arm.nodes - 1,
            places[0],
            frames[0, 0],
            frames[0, 1],
            edge * (arm.nodes - 1),
            arm.radius,
            arm.density,
            youngs_modulus=arm.youngs_modulus,
            shear_modulus=arm.youngs_modulus / (2 * (1 + arm.poisson_ratio)),
            position=places.T.copy(),
            directors=directors.copy(),
        )
        self._rod.rest_kappa[:] = self._rod.kappa
        self._start = places.T, directors
        self._world = _World()
        self._world.append(self._rod)
        self._world.constrain(self._rod).using(
            elastica.OneEndFixedBC, constrained_position_idx=(0,), constrained_director_idx=(0,)
        )
        gravity = water.gravity * (1 - water.density / arm.density)
        self._world.add_forcing_to(self._rod).using(
            elastica.GravityForces, acc_gravity=np.array([0.0, 0.0, -gravity])
        )
        self._world.finalize()
        self._stepper = elastica.PositionVerlet()

    def tips(self, time_step: float, samples: int, steps: int) -> np.ndarray:
        """Let the rod swing from rest; return its tip after each ``steps``, ``(samples, 3)`` in m.

        Where it diverges, what is left of them is not a number.
        """
        rod, stepper, world = self._rod, self._stepper, self._world
        rod.position_collection[:], rod.director_collection[:] = self._start
        # the accelerations too: what is not a number outlives PyElastica's way to clear them
        for rate in (
            rod.velocity_collection,
            rod.omega_collection,
            rod.acceleration_collection,
            rod.alpha_collection,
        ):
            rate[:] = 0.0
        tips = np.full((samples, 3), np.nan)
        time, step = np.float64(0.0), np.float64(time_step)
        for tip in tips:
            for _ in range(steps):
                time = stepper.step(world, time, step)
            tip[:] = rod.position_collection[:, -1]
            if not np.isfinite(tip).all():
                break
        return tips
