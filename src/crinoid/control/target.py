"""Target of the tip: a fixed pose or a path, in the world or in the submarine's frame."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.base import Base
from crinoid.foundation.axes import POSE
from crinoid.numerics.piecewise import PiecewisePolynomial
from crinoid.numerics.ramp import Onset
from crinoid.numerics.small_matrices import product

Time = Float[Array, ""]


class Orbit(eqx.Module):
    """Circle, ellipse or oscillation: ``centre + cos(angle) cosine + sin(angle) sine``."""

    centre: Float[Array, " d"]
    """Position of the centre (m)."""
    cosine: Float[Array, " d"]
    """From the centre to where the angle is zero (m)."""
    sine: Float[Array, " d"]
    """From the centre to where the angle is a right one (m)."""
    rate: Float[Array, ""]
    """Rate of the angle, once it is up to speed (rad/s)."""
    phase: Float[Array, ""]
    """Angle at the start (rad)."""
    onset: Onset

    def __call__(self, time: Time) -> Float[Array, " d"]:
        """Return the position at ``time`` (s)."""
        angle = self.phase + self.rate * self.onset.elapsed(time)
        return self.centre + jnp.cos(angle) * self.cosine + jnp.sin(angle) * self.sine


class Line(eqx.Module):
    """A straight line at a constant velocity (m/s), once it is up to speed."""

    begin: Float[Array, " d"]
    """Position at the start (m)."""
    velocity: Float[Array, " d"]
    """Velocity once it is up to speed (m/s)."""
    onset: Onset

    def __call__(self, time: Time) -> Float[Array, " d"]:
        """Return the position at ``time`` (s)."""
        return self.begin + self.velocity * self.onset.elapsed(time)


Pose = Float[Array, " pose"]


class SubmarineFrame(eqx.Module):
    """Frame of the submarine, which moves as prescribed; the servos do not move it."""

    base: Base
    """Base with the prescribed motion."""
    origin: Float[Array, " d"]
    """Set position of the base (m)."""

    def to_world(self, pose: Pose, time: Time) -> Pose:
        """Return in the world a pose of the submarine's frame at ``time`` (s)."""
        shift, turn, angle = self._displacement(time)
        axes = shift.size
        pointing = pose[axes:] + angle if axes == 2 else product(turn, pose[axes:])
        return jnp.concatenate([self.origin + shift + product(turn, pose[:axes]), pointing])

    def to_frame(self, pose: Pose, time: Time) -> Pose:
        """Return in the submarine's frame a pose of the world at ``time`` (s)."""
        shift, turn, angle = self._displacement(time)
        axes = shift.size
        pointing = pose[axes:] - angle if axes == 2 else product(turn.T, pose[axes:])
        return jnp.concatenate([product(turn.T, pose[:axes] - self.origin - shift), pointing])

    def rotation(self, time: Time) -> Float[Array, "d d"]:
        """Return the matrix that turns vectors of the frame into the world at ``time`` (s)."""
        return self._displacement(time)[1]

    def _displacement(
        self, time: Time
    ) -> tuple[Float[Array, " d"], Float[Array, "d d"], Float[Array, "..."]]:
        displaced, _, _ = self.base.pose(time, self.base.servo.at_rest())
        axes = self.base.axes
        return displaced[:axes], self.base.rotation(displaced), displaced[axes:]


class Target(eqx.Module):
    """Reference pose of the tip (`crinoid.foundation.axes.POSE`): fixed or on a path."""

    fixed: Pose
    """Pose that the target has where it does not move (m, rad)."""
    path: PiecewisePolynomial | Orbit | Line | None
    """Values of the coordinates in ``moving`` over time."""
    moving: tuple[int, ...] = eqx.field(static=True)
    """Coordinates of the pose that follow the path, by index."""
    carrier: SubmarineFrame | None = None
    """Frame of the target; None: the world."""

    def __call__(self, time: Time) -> Pose:
        """Return the wanted pose at ``time`` (s), in the world."""
        pose = self.in_frame(time)
        return pose if self.carrier is None else self.carrier.to_world(pose, time)

    def to_frame(self, pose: Pose, time: Time) -> Pose:
        """Return a pose of the world at ``time`` (s) in the frame of the target."""
        return pose if self.carrier is None else self.carrier.to_frame(pose, time)

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
    """Return the error of a pose.

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
