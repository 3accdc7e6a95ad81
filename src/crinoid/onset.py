"""How loads and flows come on."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float


class Onset(eqx.Module):
    """A factor of time: 0 before ``start``, 1 once ``ramp_time`` has passed.

    In between it follows half a cosine, so that what is ramped keeps a continuous rate; with no
    ramp time it jumps.
    """

    start: Float[Array, "*count"]
    ramp_time: Float[Array, "*count"]

    def __call__(self, time: Float[Array, ""] | float) -> Float[Array, "*count"]:
        """Return the factor at ``time`` (s)."""
        since = time - self.start
        ramped = self.ramp_time > 0
        progress = jnp.clip(since / jnp.where(ramped, self.ramp_time, 1.0), 0.0, 1.0)
        return jnp.where(ramped, 0.5 - 0.5 * jnp.cos(jnp.pi * progress), since >= 0)
