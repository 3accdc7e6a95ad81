"""Cubic B-splines on regular grids for compiled code."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float


class GridSpline(eqx.Module):
    """Cubic B-spline through values on a regular grid of one to three axes.

    Its second derivatives are continuous inside of the grid. Along an axis it is constant outside,
    from one spacing before the end on.
    """

    coefficients: Float[Array, "..."]
    origin: Float[Array, " axes"]  # place of the first value (m)
    spacing: Float[Array, " axes"]  # distance of the values along each axis (m)

    def clamped(self, place: Float[Array, " axes"]) -> Float[Array, " axes"]:
        """Return the nearest place inside of the grid (m)."""
        last = np.array(self.coefficients.shape) - 2
        return jnp.clip(
            place, self.origin + self.spacing, self.origin + jnp.asarray(last) * self.spacing
        )

    def __call__(self, place: Float[Array, " axes"]) -> Float[Array, ""]:
        """Return the value at a place (m)."""
        steps = (self.clamped(place) - self.origin) / self.spacing
        last = np.array(self.coefficients.shape) - 3
        cell = jnp.clip(jnp.floor(jax.lax.stop_gradient(steps)).astype(int), 1, last)
        t = steps - cell
        # uniform cubic B-spline (de Boor, A Practical Guide to Splines, 2001, chapter X)
        weights = jnp.stack(
            [(1 - t) ** 3, 3 * t**3 - 6 * t**2 + 4, 3 * (t + t**2 - t**3) + 1, t**3], axis=1
        )
        part = jax.lax.dynamic_slice(self.coefficients, cell - 1, (4,) * len(last))
        for weight in weights / 6:
            part = jnp.tensordot(weight, part, 1)
        return part
