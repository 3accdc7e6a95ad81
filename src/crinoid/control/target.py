"""Where the tip should be."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.space import POSE
from crinoid.spline import PiecewisePolynomial


class Target(eqx.Module):
    """The wanted pose of the tip (`crinoid.space.POSE`): fixed parts and parts on a path."""

    fixed: Float[Array, " pose"]
    path: PiecewisePolynomial | None
    """Values of the coordinates in ``moving`` over time; held before and after."""
    moving: tuple[int, ...] = eqx.field(static=True)

    def __call__(self, time: Float[Array, ""]) -> Float[Array, " pose"]:
        """Return the wanted pose at ``time`` (s)."""
        if self.path is None:
            return self.fixed
        pose = self.fixed.at[jnp.asarray(self.moving)].set(self.path(time))
        if not _spatial(pose):
            return pose
        direction = pose[3:]  # between two unit vectors the spline cuts the corner
        return pose.at[3:].set(direction / jnp.sqrt(jnp.sum(direction**2)))


def pose_error(
    wanted: Float[Array, " pose"], measured: Float[Array, " pose"]
) -> Float[Array, " pose"]:
    """Return how far the tip is from where it should be.

    In the plane the angle the short way round; in space directions differ by the chord between
    their unit vectors, which no orientation of the arm makes singular.
    """
    error = wanted - measured
    if _spatial(error):
        return error
    turn = error[-1]
    return error.at[-1].set(turn - 2 * jnp.pi * jnp.round(turn / (2 * jnp.pi)))


def _spatial(pose: Float[Array, " pose"]) -> bool:
    return pose.shape[0] == len(POSE[3])
