"""How the tip moves as the base turns the arm far, beside what a linear model has."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.base import Base
from crinoid.products import product

Channels = Float[Array, " channel"]
Pose = Float[Array, " pose"]


class Turned(eqx.Module):
    """Displacement of the tip as the base turns, less the part that is linear in the turn.

    That of a rigid arm, in the shape in which it is linearised: what it bends by changes little.
    """

    base: Base
    """The base, its set angles those where the arm is linearised."""
    lever: Float[Array, " d"]
    """From the root to the tip there (m)."""
    pointing: Float[Array, " pointing"]
    """Pose of the tip there behind its position: an angle, or a unit vector."""
    slope: Float[Array, "pose channel"]
    """The linear part, by the displacement of the channels."""

    def __call__(self, channels: Channels) -> Pose:
        """Return that part (m, rad, 1) for a displacement of the channels from there (m, rad)."""
        return self.swung(channels) - product(self.slope, channels)

    def swung(self, channels: Channels) -> Pose:
        """Return how far the tip of the rigid arm goes as the channels that turn do."""
        turn = self.base.rotation(channels)
        moved = product(turn, self.lever) - self.lever
        if self.base.axes == 2:  # an angle is linear in the turn
            return jnp.concatenate([moved, channels[2:]])
        return jnp.concatenate([moved, product(turn, self.pointing) - self.pointing])
