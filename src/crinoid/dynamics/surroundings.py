"""The water around the arm, as a time step sees it."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

Rows = Float[Array, "rows b"]
Points = Float[Array, "rows d"]


class Surroundings(eqx.Module):
    """The water around given positions, expanded from each: the velocity to first order.

    The acceleration is expanded where it has a slope, which statics takes along.
    """

    position: Points
    velocity: Points
    acceleration: Points
    """Material acceleration Du/Dt (m/s2)."""
    velocity_slope: Float[Array, "rows d d"]
    acceleration_slope: Float[Array, "rows d d"] | None = None

    def at(self, position: Rows) -> tuple[Points, Points]:
        """Return velocity and material acceleration near the positions."""
        moved = (position[:, : self.position.shape[1]] - self.position)[:, None, :]
        velocity = self.velocity + jnp.sum(self.velocity_slope * moved, axis=-1)
        if self.acceleration_slope is None:
            return velocity, self.acceleration
        return velocity, self.acceleration + jnp.sum(self.acceleration_slope * moved, axis=-1)
