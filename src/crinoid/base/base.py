"""Where the arm is held: the pose of the base, and what it prescribes to the first nodes."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.base.motion import BaseMotion
from crinoid.base.servo import Servo, ServoState

CHANNELS = ("slide", "heave", "tilt")
"""The channels of a planar base: +x and +z (m), and the turn from +x toward +z (rad)."""

Channels = Float[Array, " channel"]


class Prescribed(eqx.Module):
    """How the ghost node and the root move. SI units."""

    position: Float[Array, "2 b"]
    velocity: Float[Array, "2 b"]
    acceleration: Float[Array, "2 b"]


class Base(eqx.Module):
    """A base that starts at the origin of the arm's coordinates, turned by ``tilt``.

    Its pose is the displacement of its channels: their servos' positions plus whatever motion is
    prescribed. The clamp is a ghost edge: a node behind the root, ``ghost_length`` away, that
    turns with the base.
    """

    tilt: Float[Array, ""]
    ghost_length: Float[Array, ""]
    servo: Servo
    motions: tuple[BaseMotion, ...]

    def pose(
        self, time: Float[Array, ""], servo: ServoState
    ) -> tuple[Channels, Channels, Channels]:
        """Return displacement, velocity and acceleration of the channels."""
        position, velocity, acceleration = servo.position, servo.velocity, servo.acceleration
        for motion in self.motions:
            value, rate, second = motion.derivatives(time)
            position = position.at[motion.channel].add(value)
            velocity = velocity.at[motion.channel].add(rate)
            acceleration = acceleration.at[motion.channel].add(second)
        return position, velocity, acceleration

    def hold(self, pose: Channels) -> Float[Array, "2 b"]:
        """Return the places of the ghost node and the root for a pose."""
        root = pose[:2]
        angle = self.tilt + pose[2]
        behind = -self.ghost_length * jnp.stack([jnp.cos(angle), jnp.sin(angle)])
        return jnp.stack([root + behind, root])

    def prescribe(self, time: Float[Array, ""], servo: ServoState) -> Prescribed:
        """Return how the ghost node and the root move at ``time``."""
        pose, rate, second = self.pose(time, servo)

        def moving(pose: Channels, rate: Channels) -> tuple[Array, Array]:
            return jax.jvp(self.hold, (pose,), (rate,))

        (position, velocity), (_, acceleration) = jax.jvp(moving, (pose, rate), (rate, second))
        return Prescribed(position, velocity, acceleration)

    @staticmethod
    def wrench(
        position: Float[Array, "2 b"], reaction: Float[Array, "2 b"]
    ) -> tuple[Float[Array, " b"], Float[Array, ""]]:
        """Return the force (N) and the moment about the root (N m) of the arm on the submarine.

        ``reaction`` is the force of the base on the ghost node and the root.
        """
        arm = position[0] - position[1]
        moment = arm[0] * reaction[0, 1] - arm[1] * reaction[0, 0]
        return -jnp.sum(reaction, axis=0), -moment
