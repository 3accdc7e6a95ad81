"""Motion of a rigid body that turns, from its two rows: centre of mass, and rotation."""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from crinoid.numerics.frames import turned
from crinoid.numerics.small_matrices import product

_Vector = Float[Array, " d"]


class RigidMotion(NamedTuple):
    """Position, velocity and attitude of a rigid body. SI units."""

    attitude: Float[Array, "d d"]
    """Matrix from the axes of the body to those of the world."""
    position: _Vector
    velocity: _Vector
    spin: Float[Array, " turns"]
    """Angular velocity in the axes of the world (rad/s)."""


class Pose(eqx.Module):
    """Attitude of a body at the start of a step, from which that at the end follows.

    The second row of a body has its rotation in the axes of the world: its change over a step is
    the rotation vector of that step, in the plane the angle from x toward z, and its rate the
    angular velocity (Bruels, Cardona and Arnold 2012). So a sphere keeps its angular momentum.
    """

    attitude: Float[Array, "*count d d"]
    turn: Float[Array, "*count turns"]
    """Rotation in the second row at the start of the step (rad)."""

    @staticmethod
    def unturned(count: int, axes: int) -> "Pose":
        """Return the pose of bodies whose axes are those of the world."""
        return Pose(jnp.stack([jnp.eye(axes)] * count), jnp.zeros((count, 1 if axes == 2 else 3)))

    def of(self, index: Int[np.ndarray, " each"]) -> "Pose":
        """Return the poses of some of the bodies."""
        return Pose(self.attitude[index], self.turn[index])

    def attitude_at(self, rotation: Float[Array, " b"]) -> Float[Array, "d d"]:
        """Return the attitude for a second row."""
        turn = rotation[: self.turn.size] - self.turn
        return product(turned(jnp.eye(self.attitude.shape[0]), turn), self.attitude)

    def motion(self, position: Float[Array, "2 b"], velocity: Float[Array, "2 b"]) -> RigidMotion:
        """Return the motion of the body with these rows."""
        axes, turns = self.attitude.shape[0], self.turn.size
        attitude, spin = self.attitude_at(position[1]), velocity[1, :turns]
        return RigidMotion(attitude, position[0, :axes], velocity[0, :axes], spin)


class VehiclePose(Pose):
    """Attitude of a vehicle at the start of a step; its second row turns in its own axes."""

    @staticmethod
    def at_start(axes: int) -> "VehiclePose":
        """Return the pose at the start of a run, when its axes are those of the world."""
        return VehiclePose(jnp.eye(axes), jnp.zeros(1 if axes == 2 else 3))

    def attitude_at(self, rotation: Float[Array, " b"]) -> Float[Array, "d d"]:
        """Return the attitude for a second row."""
        return turned(self.attitude, rotation[: self.turn.size] - self.turn)
