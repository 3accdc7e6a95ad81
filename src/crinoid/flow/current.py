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
    def of(jet: Jet, lasting: Jet | None = None) -> "Current":
        """Take the current from the jet of all flows together.

        ``Du/Dt = du/dt + (grad u) u``. With ``lasting``, the jet of the steady flows among them,
        the acceleration is what those have for good, ``(grad u) u`` of them alone.
        """
        carried = jet if lasting is None else lasting
        velocity, gradient = carried.velocity, carried.gradient
        # sums of products and not `@`: many small matrices are quicker that way
        acceleration = jnp.sum(gradient * velocity, axis=-1)
        slope = jnp.sum(carried.hessian * velocity, axis=-1)
        slope += jnp.sum(gradient[:, :, None] * gradient, axis=1)
        if lasting is None:
            acceleration += jet.rate
            slope += jet.gradient_rate
        return Current(jet.velocity, acceleration, jet.gradient, slope)
