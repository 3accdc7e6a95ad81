"""Where the arm is held: the pose of the base, and what it prescribes to the first nodes."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from crinoid.base.motion import BaseMotion
from crinoid.base.servo import Servo, ServoState
from crinoid.frames import cross, dot
from crinoid.products import product

Channels = Float[Array, " channel"]


class Prescribed(eqx.Module):
    """How the ghost node and the root move. SI units."""

    position: Float[Array, "2 d"]
    """Positions (m)."""
    velocity: Float[Array, "2 b"]
    """Velocities (m/s); in space with the rate at which the ghost edge spins (rad/s)."""
    acceleration: Float[Array, "2 b"]
    """Their rates (m/s2, rad/s2)."""
    frame: Float[Array, "3 3"] | None
    """In space the frame of the clamp: rows t, m_1, m_2."""


class Base(eqx.Module):
    """A base that starts at the origin of the arm's coordinates, turned by ``angles``.

    Its pose is the displacement of its channels, `crinoid.space.CHANNELS`: their servos' positions
    plus whatever motion is prescribed. The clamp is a ghost edge: a node behind the root,
    ``ghost_length`` away, that turns with the base; in space it carries a material frame.
    """

    angles: Float[Array, " angle"]
    """Set angles of the channels that turn: tilt, in space pan, tilt and roll (rad)."""
    ghost_length: Float[Array, ""]
    """Distance of the ghost node behind the root (m)."""
    servo: Servo
    """The servos of the channels."""
    motions: tuple[BaseMotion, ...]
    """Prescribed motions, which add up."""

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

    @property
    def axes(self) -> int:
        """Number of axes of a position."""
        return 2 if self.angles.shape[0] == 1 else 3

    def direction(self, pose: Channels) -> Float[Array, " d"]:
        """Return where the arm's root points for a pose."""
        if self.axes == 2:
            angle = self.angles[0] + pose[2]
            return jnp.stack([jnp.cos(angle), jnp.sin(angle)])
        return self.frame(pose)[0]

    def frame(self, pose: Channels) -> Float[Array, "3 3"]:
        """Return the clamp's frame in space for a pose: rows t, m_1, m_2.

        Turned by pan, by tilt and by roll, from t = x, m_1 = y, m_2 = z.
        """
        pan, tilt, roll = self.angles + pose[3:]
        level = jnp.stack([jnp.cos(pan), jnp.sin(pan), jnp.zeros(())])
        port = jnp.stack([-jnp.sin(pan), jnp.cos(pan), jnp.zeros(())])
        up = np.array([0.0, 0.0, 1.0])
        tangent = jnp.cos(tilt) * level + jnp.sin(tilt) * up
        above = jnp.cos(tilt) * up - jnp.sin(tilt) * level
        m_1 = jnp.cos(roll) * port + jnp.sin(roll) * above
        return jnp.stack([tangent, m_1, jnp.cos(roll) * above - jnp.sin(roll) * port])

    def rotation(self, pose: Channels) -> Float[Array, "d d"]:
        """Return the matrix that turns what the base carries from its set pose into a pose."""
        if self.axes == 3:
            return product(self.frame(pose).T, self.frame(jnp.zeros_like(pose)))
        cosine, sine = jnp.cos(pose[2]), jnp.sin(pose[2])
        return jnp.stack([jnp.stack([cosine, -sine]), jnp.stack([sine, cosine])])

    def hold(self, pose: Channels) -> Float[Array, "2 d"]:
        """Return the positions of the ghost node and the root for a pose."""
        root = pose[: self.axes]
        return jnp.stack([root - self.ghost_length * self.direction(pose), root])

    def moving(self, pose: Channels, rate: Channels) -> tuple[Array, Array]:
        """Return the positions held, and how they move: in space with the ghost edge's spin."""
        position, velocity = jax.jvp(self.hold, (pose,), (rate,))
        if self.axes == 2:
            return position, velocity
        frame, turning = jax.jvp(self.frame, (pose,), (rate,))
        spin = jnp.stack([jnp.zeros(()), dot(turning[1], frame[2])])
        return position, jnp.concatenate([velocity, spin[:, None]], axis=1)

    def prescribe(self, time: Float[Array, ""], servo: ServoState) -> Prescribed:
        """Return how the ghost node and the root move at ``time``."""
        pose, rate, second = self.pose(time, servo)
        (position, velocity), (_, acceleration) = jax.jvp(self.moving, (pose, rate), (rate, second))
        frame = self.frame(pose) if self.axes == 3 else None
        return Prescribed(position, velocity, acceleration, frame)

    @staticmethod
    def wrench(
        position: Float[Array, "*many 2 d"], reaction: Float[Array, "*many 2 b"]
    ) -> tuple[Float[Array, "*many d"], Float[Array, "..."]]:
        """Return the force (N) and the moment about the root (N m) of the arm on the submarine.

        ``reaction`` is what the base does to the ghost node and the root (N), in space also to the
        spin of the ghost edge (N m). The moment is one number in the plane, a vector in space.
        """
        axes = position.shape[-1]
        behind = position[..., 0, :] - position[..., 1, :]
        force, push = -jnp.sum(reaction[..., :axes], axis=-2), reaction[..., 0, :axes]
        if axes == 2:
            return force, -(behind[..., 0] * push[..., 1] - behind[..., 1] * push[..., 0])
        tangent = -behind / jnp.sqrt(dot(behind, behind))[..., None]
        return force, -cross(behind, push) - reaction[..., 1, 3:] * tangent
