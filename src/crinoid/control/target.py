"""Where the tip should be."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.base import Base
from crinoid.control.path import Line, Orbit
from crinoid.products import product
from crinoid.space import POSE
from crinoid.spline import PiecewisePolynomial

Pose = Float[Array, " pose"]
Time = Float[Array, ""]


class Carrier(eqx.Module):
    """The submarine as a frame of reference: it moves as prescribed, whatever the servos do."""

    base: Base
    """The base whose prescribed motion it follows."""
    origin: Float[Array, " d"]
    """Set position of the base (m)."""

    def carry(self, pose: Pose, time: Time) -> Pose:
        """Return in the world what is fixed to the submarine at ``time`` (s)."""
        shift, turn, angle = self._displacement(time)
        axes = shift.size
        pointing = pose[axes:] + angle if axes == 2 else product(turn, pose[axes:])
        return jnp.concatenate([self.origin + shift + product(turn, pose[:axes]), pointing])

    def seen(self, pose: Pose, time: Time) -> Pose:
        """Return from the submarine what is in the world at ``time`` (s)."""
        shift, turn, angle = self._displacement(time)
        axes = shift.size
        pointing = pose[axes:] - angle if axes == 2 else product(turn.T, pose[axes:])
        return jnp.concatenate([product(turn.T, pose[:axes] - self.origin - shift), pointing])

    def _displacement(
        self, time: Time
    ) -> tuple[Float[Array, " d"], Float[Array, "d d"], Float[Array, "..."]]:
        displaced, _, _ = self.base.pose(time, self.base.servo.at_rest())
        axes = self.base.axes
        return displaced[:axes], self.base.rotation(displaced), displaced[axes:]


class Target(eqx.Module):
    """The wanted pose of the tip (`crinoid.space.POSE`): fixed parts and parts on a path."""

    fixed: Pose
    """Pose that the target has where it does not move (m, rad)."""
    path: PiecewisePolynomial | Orbit | Line | None
    """Values of the coordinates in ``moving`` over time."""
    moving: tuple[int, ...] = eqx.field(static=True)
    """Coordinates of the pose that follow the path, by index."""
    carrier: Carrier | None = None
    """Frame that the target moves with; none: the world."""

    def __call__(self, time: Time) -> Pose:
        """Return the wanted pose at ``time`` (s), in the world."""
        pose = self.in_frame(time)
        return pose if self.carrier is None else self.carrier.carry(pose, time)

    def seen(self, pose: Pose, time: Time) -> Pose:
        """Return a pose of the world at ``time`` (s) in the frame of the target."""
        return pose if self.carrier is None else self.carrier.seen(pose, time)

    def in_frame(self, time: Time) -> Pose:
        """Return the wanted pose at ``time`` (s), in the frame of the target."""
        if self.path is None:
            return self.fixed
        pose = self.fixed.at[jnp.asarray(self.moving)].set(self.path(time))
        if not _spatial(pose):
            return pose
        direction = pose[3:]  # between two unit vectors the curve cuts the corner
        return jnp.append(pose[:3], direction / jnp.sqrt(jnp.sum(direction**2)))


def pose_error(wanted: Pose, measured: Pose) -> Pose:
    """Return how far the tip is from where it should be.

    In the plane the angle the short way round; in space directions differ by the chord between
    their unit vectors, which no orientation of the arm makes singular.
    """
    error = wanted - measured
    if _spatial(error):
        return error
    turn = error[-1]
    return jnp.append(error[:-1], turn - 2 * jnp.pi * jnp.round(turn / (2 * jnp.pi)))


def _spatial(pose: Pose) -> bool:
    return pose.shape[0] == len(POSE[3])
