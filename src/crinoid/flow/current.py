"""The motion of the water at one point, and how its velocity changes nearby."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.flow.jet import Jet


class Current(eqx.Module):
    """Velocity of the water to first order in the position, and its material acceleration."""

    velocity: Float[Array, " b"]
    """Velocity ``u`` (m/s)."""
    acceleration: Float[Array, " b"]
    """Material acceleration ``Du/Dt`` (m/s2)."""
    velocity_slope: Float[Array, "b b"]
    """Derivative of the velocity along the axes of space, the last index (1/s)."""

    @staticmethod
    def of(jet: Jet, lasting: Jet | None = None) -> "Current":
        """Take the current from the jet of all flows together.

        ``Du/Dt = du/dt + (grad u) u``. With ``lasting``, the jet of the steady flows among them,
        the acceleration is what those have for good, ``(grad u) u`` of them alone.
        """
        carried = jet if lasting is None else lasting
        # a sum of products and not `@`: many small matrices are quicker that way
        acceleration = jnp.sum(carried.gradient * carried.velocity, axis=-1)
        if lasting is None:
            acceleration += jet.rate
        return Current(jet.velocity, acceleration, jet.gradient)
