"""Where the tip should be."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.spline import PiecewiseCubic


class Target(eqx.Module):
    """The wanted pose of the tip (x, z in m, angle in rad): fixed parts and parts on a path."""

    fixed: Float[Array, " pose"]
    path: PiecewiseCubic | None
    """Values of the coordinates in ``moving`` over time; held before and after."""
    moving: tuple[int, ...] = eqx.field(static=True)

    def __call__(self, time: Float[Array, ""]) -> Float[Array, " pose"]:
        """Return the wanted pose at ``time`` (s)."""
        if self.path is None:
            return self.fixed
        return self.fixed.at[jnp.asarray(self.moving)].set(self.path(time))


def pose_error(
    wanted: Float[Array, " pose"], measured: Float[Array, " pose"]
) -> Float[Array, " pose"]:
    """Return how far the tip is from where it should be, the angle the short way round."""
    error = wanted - measured
    turn = error[-1]
    return error.at[-1].set(turn - 2 * jnp.pi * jnp.round(turn / (2 * jnp.pi)))
