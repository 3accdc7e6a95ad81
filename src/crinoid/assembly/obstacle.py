"""From the description of obstacles to the arrays that they are computed with."""

from __future__ import annotations

from collections.abc import Sequence

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Bool, Float

from crinoid.assembly.numbers import array
from crinoid.dynamics import Obstacles
from crinoid.elements import Body, Contact
from crinoid.rod import Rod
from crinoid.scenario import Obstacle, Sphere

_ROUNDED = 1e-9
"""Share of the arm's length that is round-off."""


class ObstacleParameters(eqx.Module):
    """The numbers of all ``[[obstacle]]``; of a shape that lacks one it is without effect."""

    position: Float[Array, "m d"]
    """Where each one is at t = 0, in the world (m)."""
    velocity: Float[Array, "m d"]
    """How each one drifts; of one that the flow carries 0 (m/s)."""
    radius: Float[Array, " m"]
    half_axis: Float[Array, "m d"]
    normal: Float[Array, "m d"]
    friction: Float[Array, " m"]
    mass: Float[Array, " m"]
    """Infinite for one that the arm cannot push away (kg)."""
    free: tuple[int, ...] = eqx.field(static=True)
    carried: tuple[int, ...] = eqx.field(static=True)

    @staticmethod
    def of(obstacles: Sequence[Obstacle]) -> ObstacleParameters:
        """Return the numbers of obstacles, one or more."""
        still = np.zeros(len(obstacles[0].position))
        drifts = [obstacle.velocity for obstacle in obstacles]
        return ObstacleParameters(
            position=array([o.position for o in obstacles]),
            velocity=array([still if drift == "flow" else drift for drift in drifts]),
            radius=array([getattr(o, "radius", 0.0) for o in obstacles]),
            half_axis=array([o.half_axis for o in obstacles]),
            normal=array([o.out for o in obstacles]),
            friction=array([o.friction for o in obstacles]),
            mass=array([getattr(o, "mass", None) or np.inf for o in obstacles]),
            free=tuple(
                index
                for index, obstacle in enumerate(obstacles)
                if isinstance(obstacle, Sphere) and obstacle.mass is not None
            ),
            carried=tuple(index for index, drift in enumerate(drifts) if drift == "flow"),
        )

    def obstacles(
        self, rod: Rod, origin: Float[Array, " d"], density: Array, gravity: Array
    ) -> Obstacles:
        """Build the obstacles beside a rod whose root is set at ``origin`` (m); traceable."""
        free = np.asarray(self.free, int)
        return Obstacles(
            contact=Contact.of(
                rod,
                radius=self.radius,
                half_axis=self.half_axis,
                normal=self.normal,
                friction=self.friction,
                mass=self.mass,
            ),
            bodies=Body.of(
                mass=self.mass[free], radius=self.radius[free], density=density, gravity=gravity
            ),
            position=self.position - origin,
            drift=self.velocity,
            free=self.free,
            carried=self.carried,
        )


def edges_within(span: tuple[float, float], nodes: int) -> Bool[Array, " edge"]:
    """Return which edges of an arm lie in a part of it, given over its length, or reach into it."""
    ends = np.arange(nodes) / (nodes - 1)
    return jax.device_put((ends[1:] > span[0] + _ROUNDED) & (ends[:-1] < span[1] - _ROUNDED))
