"""What the water does to an arm at one place: how it moves, and how that changes nearby."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.flow.jet import Jet


class Current(eqx.Module):
    """Velocity and material acceleration of the water, to first order in the place."""

    velocity: Float[Array, " b"]
    """Velocity ``u`` (m/s)."""
    acceleration: Float[Array, " b"]
    """Material acceleration ``Du/Dt`` (m/s2)."""
    velocity_slope: Float[Array, "b b"]
    """Derivative of the velocity along the axes of space, the last index (1/s)."""
    acceleration_slope: Float[Array, "b b"]
    """Derivative of the material acceleration along the axes of space, the last index (1/s2)."""

    @staticmethod
    def of(jet: Jet, *, steady: bool = False) -> "Current":
        """Take the current from the jet of all flows together.

        ``Du/Dt = du/dt + (grad u) u``; of a steady flow ``du/dt`` is left out.
        """
        velocity, gradient = jet.velocity, jet.gradient
        # sums of products and not `@`: many small matrices are quicker that way
        acceleration = jnp.sum(gradient * velocity, axis=-1)
        slope = jnp.sum(jet.hessian * velocity, axis=-1)
        slope += jnp.sum(gradient[:, :, None] * gradient, axis=1)
        if not steady:
            acceleration += jet.rate
            slope += jet.gradient_rate
        return Current(velocity, acceleration, gradient, slope)
