"""The water around the arm, as a time step sees it."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

Rows = Float[Array, "rows b"]
Places = Float[Array, "rows d"]


class Surroundings(eqx.Module):
    """The water around given places, expanded to first order from each."""

    position: Places
    velocity: Places
    acceleration: Places
    """Material acceleration Du/Dt (m/s2)."""
    velocity_slope: Float[Array, "rows d d"]
    acceleration_slope: Float[Array, "rows d d"]

    def since(
        self, position: Rows, velocity: Places, acceleration: Places, alpha: Float[Array, ""]
    ) -> "Surroundings":
        """Return the water at a share ``alpha`` of a step back, between what it was and is now.

        Given are the places there, and velocity and acceleration at the step's start.
        """
        return Surroundings(
            position[:, : velocity.shape[1]],
            (1 - alpha) * self.velocity + alpha * velocity,
            (1 - alpha) * self.acceleration + alpha * acceleration,
            self.velocity_slope,
            self.acceleration_slope,
        )

    def at(self, position: Rows) -> tuple[Places, Places]:
        """Return velocity and material acceleration near the places."""
        moved = (position[:, : self.position.shape[1]] - self.position)[:, None, :]
        return (
            self.velocity + jnp.sum(self.velocity_slope * moved, axis=-1),
            self.acceleration + jnp.sum(self.acceleration_slope * moved, axis=-1),
        )
