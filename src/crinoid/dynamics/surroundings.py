"""The water around the arm, as a time step sees it."""

from dataclasses import replace
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

Rows = Float[Array, "rows b"]
Points = Float[Array, "rows d"]


class Stir(NamedTuple):
    """A change of the water at the nodes."""

    velocity: Float[Array, "n d"]
    """m/s."""
    acceleration: Float[Array, "n d"]
    """Material acceleration (m/s2)."""


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

    def stirred(self, stir: Stir) -> "Surroundings":
        """Return the surroundings where the water at the nodes, the first rows, moves otherwise."""
        nodes = slice(stir.velocity.shape[0])
        return replace(
            self,
            velocity=self.velocity.at[nodes].add(stir.velocity),
            acceleration=self.acceleration.at[nodes].add(stir.acceleration),
        )
