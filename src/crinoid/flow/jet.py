"""A flow at one place and time with its first and second derivatives: its 2-jet."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float


class Jet(eqx.Module):
    """A velocity field expanded to second order about a place and a time.

    Derivatives are those along the ``b`` axes of space, and along time as the last one.
    """

    velocity: Float[Array, " b"]
    """Velocity (m/s)."""
    slope: Float[Array, "b b+1"]
    """Its first derivatives (1/s; along time m/s2)."""
    bend: Float[Array, "b b+1 b+1"]
    """Its second derivatives."""

    @staticmethod
    def of(
        field: Callable[[Array, Array], Array], point: Float[Array, " b"], time: Float[Array, ""]
    ) -> "Jet":
        """Expand a velocity field about a point (m) and a time (s), by differentiating it."""

        def at(place: Array) -> Array:
            return field(place[:-1], place[-1])

        place, slope = jnp.append(point, time), jax.jacfwd(at)
        return Jet(at(place), slope(place), jax.jacfwd(slope)(place))

    @staticmethod
    def everywhere(velocity: Callable[[Array], Array], time: Float[Array, ""]) -> "Jet":
        """Expand a velocity that depends on the time (s) only."""

        def rate(time: Array) -> Array:
            return jax.jvp(velocity, (time,), (jnp.ones_like(time),))[1]

        now, first = velocity(time), rate(time)
        _, second = jax.jvp(rate, (time,), (jnp.ones_like(time),))
        along_time = jnp.zeros(now.shape[0] + 1).at[-1].set(1.0)
        return Jet(
            now,
            first[:, None] * along_time,
            second[:, None, None] * along_time[:, None] * along_time,
        )

    @staticmethod
    def still(size: int) -> "Jet":
        """Return the jet of water at rest, in ``size`` dimensions."""
        axes = size + 1
        return Jet(jnp.zeros(size), jnp.zeros((size, axes)), jnp.zeros((size, axes, axes)))

    def __add__(self, other: "Jet") -> "Jet":
        return jax.tree.map(jnp.add, self, other)

    def times(
        self, factor: Float[Array, ""], rate: Float[Array, ""], bend: Float[Array, ""]
    ) -> "Jet":
        """Return the jet of the flow times a factor of time, given with its two derivatives."""
        along_time = jnp.zeros(self.slope.shape[1]).at[-1].set(1.0)
        mixed = self.slope[:, :, None] * along_time
        squared = along_time[:, None] * along_time
        return Jet(
            factor * self.velocity,
            factor * self.slope + rate * self.velocity[:, None] * along_time,
            factor * self.bend
            + rate * (mixed + jnp.swapaxes(mixed, 1, 2))
            + bend * self.velocity[:, None, None] * squared,
        )
