"""A flow at one point and time with the derivatives that its acceleration takes."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float


class Jet(eqx.Module):
    """A velocity field ``u`` expanded about a point and a time. Derivatives come as last axes."""

    velocity: Float[Array, " b"]
    """``u`` (m/s)."""
    gradient: Float[Array, "b b"]
    """``grad u`` (1/s)."""
    rate: Float[Array, " b"]
    """``du/dt`` (m/s2)."""

    @staticmethod
    def of(
        field: Callable[[Array, Array], Array], point: Float[Array, " b"], time: Float[Array, ""]
    ) -> "Jet":
        """Expand a velocity field about a point (m) and a time (s), by differentiating it."""
        velocity, rate = jax.jvp(lambda t: field(point, t), (time,), (jnp.ones_like(time),))
        return Jet(velocity, jax.jacfwd(field)(point, time), rate)

    @staticmethod
    def everywhere(velocity: Float[Array, " b"], rate: Float[Array, " b"]) -> "Jet":
        """Return the jet of a velocity that is the same everywhere, and of its rate."""
        size = velocity.shape[0]
        return Jet(velocity, jnp.zeros((size, size)), rate)

    def __add__(self, other: "Jet") -> "Jet":
        return jax.tree.map(jnp.add, self, other)

    def times(self, factor: Float[Array, ""], rate: Float[Array, ""]) -> "Jet":
        """Return the jet of the flow times a factor of time, given with its rate."""
        return Jet(
            factor * self.velocity,
            factor * self.gradient,
            factor * self.rate + rate * self.velocity,
        )
