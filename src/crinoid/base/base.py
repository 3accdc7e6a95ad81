"""Base of the arm: its prescribed motion, and the boundary nodes that follow it and its servos."""

from abc import abstractmethod
from types import EllipsisType

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.base.servo import Channels, Servo, ServoState
from crinoid.numerics.frames import cross, dot, rotate_90
from crinoid.numerics.piecewise import PiecewisePolynomial
from crinoid.numerics.ramp import Onset
from crinoid.numerics.small_matrices import product

Time = Float[Array, ""]
Turns = tuple[tuple[Array, ...], tuple[Array, ...]]


class BaseMotion(eqx.Module):
    """A displacement of one channel, or of all, as a function of time (m or rad)."""

    channel: eqx.AbstractVar[int | EllipsisType]
    """The channel, or ``...``: each."""

    @abstractmethod
    def displacement(self, time: Time) -> Float[Array, "*channel"]:
        """Return the displacement at ``time`` (s)."""

    def derivatives(self, time: Time) -> tuple[Array, Array, Array]:
        """Return displacement, velocity and acceleration at ``time``."""

        def rate(at: Time) -> tuple[Array, Array]:
            return jax.jvp(self.displacement, (at,), (jnp.ones_like(at),))

        (value, velocity), (_, acceleration) = jax.jvp(rate, (time,), (jnp.ones_like(time),))
        return value, velocity, acceleration


class SineMotion(BaseMotion):
    """``amplitude sin(2 pi f t + phase)``."""

    channel: int = eqx.field(static=True)
    amplitude: Float[Array, ""]
    """Amplitude (m or rad)."""
    frequency: Float[Array, ""]
    """Cycles per second (Hz)."""
    phase: Float[Array, ""]
    """Phase at time zero (rad)."""

    def displacement(self, time: Time) -> Float[Array, ""]:
        return self.amplitude * jnp.sin(2 * jnp.pi * self.frequency * time + self.phase)


class VelocityMotion(BaseMotion):
    """A constant velocity (m/s or rad/s) that comes on smoothly."""

    channel: int = eqx.field(static=True)
    onset: Onset
    velocity: Float[Array, ""]
    """Velocity once it is up to speed (m/s or rad/s)."""

    def displacement(self, time: Time) -> Float[Array, ""]:
        return self.velocity * self.onset.elapsed(time)


class TableMotion(BaseMotion):
    """A table of displacements, joined by piecewise polynomials."""

    channel: int = eqx.field(static=True)
    table: PiecewisePolynomial
    """Displacement (m or rad) over time (s)."""

    def displacement(self, time: Time) -> Float[Array, ""]:
        return self.table(time)[0]


class WaveMotion(BaseMotion):
    """First-order motion of all channels with surface waves.

    The sum of ``cosine cos(theta) - sine sin(theta)`` with ``theta = phase - omega t``: that of
    each wave at the place of the vessel.
    """

    channel: EllipsisType = eqx.field(static=True)
    onset: Onset
    """Onset of the waves."""
    frequencies: Float[Array, " m"]
    """Angular frequencies (rad/s)."""
    phases: Float[Array, " m"]
    """Phases at time zero (rad)."""
    cosine: Float[Array, "m channel"]
    """Real parts of the complex amplitudes (m or rad)."""
    sine: Float[Array, "m channel"]
    """Imaginary parts."""

    def displacement(self, time: Time) -> Float[Array, " channel"]:
        angle = self.phases - self.frequencies * time
        swing = product(jnp.cos(angle), self.cosine) - product(jnp.sin(angle), self.sine)
        return self.onset(time) * swing


class Prescribed(eqx.Module):
    """Prescribed motion of the ghost node and the root. SI units."""

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

    Its pose is the displacement of its channels, `crinoid.foundation.axes.CHANNELS`: their servos'
    positions plus the prescribed motion. The clamp is a ghost edge: a node behind the root,
    ``ghost_length`` away, that turns with the base; in space it carries a material frame.
    """

    angles: Float[Array, " angle"]
    """Set angles of the channels that turn: tilt, in space pan, tilt and roll (rad)."""
    ghost_length: Float[Array, ""]
    """Distance of the ghost node behind the root (m)."""
    servo: Servo
    """Servos of the channels."""
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
        return _frame(self._turns(pose))

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

    def moving(self, pose: Channels, rate: Channels, second: Channels) -> Prescribed:
        """Return how the ghost node and the root move for a pose and its first two rates."""
        axes = self.axes
        root = jnp.stack([pose[:axes], rate[:axes], second[:axes]])
        if axes == 2:
            tangent, turn, faster = self.direction(pose), rate[2], second[2]
            normal = rotate_90(tangent)
            lever = jnp.stack([tangent, turn * normal, faster * normal - turn**2 * tangent])
            ghost = root - self.ghost_length * lever
            position, velocity, acceleration = jnp.stack([ghost, root], axis=1)
            return Prescribed(position, velocity, acceleration, None)
        turns = (_, c, _), (_, s, _) = self._turns(pose)
        pan, tilt, roll = rate[3], rate[4], rate[5]
        more_pan, more_tilt, more_roll = second[3], second[4], second[5]
        ahead = more_tilt * s + (tilt**2 + pan**2) * c
        aside = more_pan * c - 2 * pan * tilt * s
        parts = [
            [c, jnp.zeros(()), s],
            [-tilt * s, pan * c, tilt * c],
            [-ahead, aside, more_tilt * c - tilt**2 * s],
        ]
        ghost = root - self.ghost_length * _panned(turns, parts)
        still = jnp.zeros(3)
        spin = jnp.stack([pan * s + roll, more_pan * s + pan * tilt * c + more_roll])
        velocity, acceleration = jnp.concatenate(
            [jnp.stack([ghost, root], axis=1)[1:], jnp.stack([still[:2], spin], axis=1)[..., None]],
            axis=2,
        )
        return Prescribed(jnp.stack([ghost[0], root[0]]), velocity, acceleration, _frame(turns))

    def prescribe(self, time: Float[Array, ""], servo: ServoState) -> Prescribed:
        """Return how the ghost node and the root move at ``time``."""
        return self.moving(*self.pose(time, servo))

    def _turns(self, pose: Channels) -> Turns:
        """Return the cosines and the sines of pan, tilt and roll."""
        angles = self.angles + pose[3:]
        return tuple(jnp.cos(angles)), tuple(jnp.sin(angles))

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


def _frame(turns: Turns) -> Float[Array, "3 3"]:
    (_, c, cr), (_, s, sr) = turns
    parts = [[c, jnp.zeros(()), s], [-sr * s, cr, sr * c], [-cr * s, -sr, cr * c]]
    return _panned(turns, parts)


def _panned(turns: Turns, parts: list[list[Array]]) -> Float[Array, "3 3"]:
    """Return vectors from their parts along the panned x and y, and along z."""
    (c, _, _), (s, _, _) = turns
    return jnp.stack([jnp.stack([c * x - s * y, s * x + c * y, z]) for x, y, z in parts])
