"""Base of the arm: its servos, its prescribed motion, and the boundary nodes that follow."""

from abc import abstractmethod

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from crinoid.actuation import Actuator, Input
from crinoid.foundation.axes import ANGLES, CHANNELS
from crinoid.numerics.frames import cross, dot, rotate_90
from crinoid.numerics.piecewise import PiecewisePolynomial
from crinoid.numerics.ramp import Onset
from crinoid.numerics.small_matrices import product

Channels = Float[Array, " channel"]

_DAMPED_BANDWIDTH = (2.0**0.5 - 1.0) ** 0.5
"""Where a critically damped second-order response falls by 3 dB, over its natural frequency."""


class ServoState(eqx.Module):
    """State of the servos: position and motion of the channels (m or rad, s)."""

    position: Channels
    """Displacement (m or rad)."""
    velocity: Channels
    """Velocity (m/s or rad/s)."""
    acceleration: Channels
    """At the end of the last step, carried on from the means of the last two steps.

    Each new command makes it jump: taken as it is at the ends of the steps alone, it would push the
    arm by more, or less, than the servo's velocity changes by.
    """
    mean: Channels
    """Mean acceleration over the last step."""
    span: Float[Array, ""]
    """Length of the last step (s)."""


class Servo(Actuator):
    """Critically damped second-order followers with limits on range, speed and acceleration.

    A speed loop in a position loop: the distance ``d`` to the command wants a speed ``s(d)``, and
    the acceleration is ``2 n (s - speed)``, ``n`` the natural frequency. Near the command
    ``s = n d / 2``, which makes the loops critically damped; farther out it leads, by the lag of
    the speed loop, the speed that the greatest acceleration brakes off on the way.
    """

    lower: Channels
    """Smallest displacement (m or rad)."""
    upper: Channels
    """Largest displacement (m or rad)."""
    max_speed: Channels
    """Largest speed (m/s or rad/s)."""
    max_acceleration: Channels
    """Largest acceleration (m/s2 or rad/s2)."""
    bandwidth: Channels
    """Frequency at which the response has fallen by 3 dB (Hz)."""

    @property
    def inputs(self) -> tuple[Input, ...]:
        names = next(names for names in CHANNELS.values() if len(names) == self.lower.shape[-1])
        return tuple(
            Input(
                name,
                "rad" if name in ANGLES else "m",
                "turn" if name in ANGLES else "shift",
                self.lower[..., index],
                self.upper[..., index],
            )
            for index, name in enumerate(names)
        )

    def drive(self, state: ServoState) -> Channels:
        return state.position

    def at_rest(self) -> ServoState:
        """Return the servos at zero, not moving."""
        zero = jnp.zeros_like(self.lower)
        return ServoState(zero, zero, zero, zero, jnp.zeros(()))

    def advance(self, state: ServoState, command: Channels, step: Array) -> ServoState:
        """Follow ``command``, held for ``step`` seconds.

        Exact for any step where no limit is met, second order in the step where one is. However
        coarse the step, no limit is broken: the servo can always stop within its range.
        """
        command = self._within(command)
        natural, reach = self.natural, self._linear_reach
        start, error = state.velocity, state.position - command

        slope = start + natural * error
        decay = jnp.exp(-natural * step)
        near_velocity = (start - natural * slope * step) * decay
        near_position = command + (error + slope * step) * decay

        distance = jnp.abs(error)
        wanted = self._wanted_velocity(error + jnp.clip(0.5 * step * start, -distance, distance))
        decay = jnp.exp(-2 * natural * step)
        far_velocity = wanted + (start - wanted) * decay
        travel = wanted * step + (start - wanted) * (1 - decay) / (2 * natural)
        far = distance > reach
        free_velocity = jnp.where(far, far_velocity, near_velocity)
        free_position = jnp.where(far, state.position + travel, near_position)

        # a step that is coarse for these loops must still stop before the range and the command
        up, down = self.upper - state.position, state.position - self.lower
        to_linear = jnp.where(far, distance - reach / 3, jnp.inf)
        up = jnp.where(error < 0, jnp.minimum(up, to_linear), up)
        down = jnp.where(error > 0, jnp.minimum(down, to_linear), down)
        velocity = jnp.clip(
            free_velocity, -self._fastest(down, -start, step), self._fastest(up, start, step)
        )
        limit = self.max_acceleration * step
        velocity = jnp.clip(velocity, start - limit, start + limit)
        room = jnp.where(velocity > 0, self.upper - free_position, free_position - self.lower)
        free = (velocity == free_velocity) & (velocity**2 <= 2 * self.max_acceleration * room)

        braking = 0.5 * start**2 / self.max_acceleration
        limited_position = state.position + jnp.clip(
            0.5 * (start + velocity) * step, -jnp.maximum(down, braking), jnp.maximum(up, braking)
        )
        position = self._within(jnp.where(free, free_position, limited_position))  # round-off
        mean = (velocity - start) / step
        ahead = mean + (mean - state.mean) * step / (step + state.span)
        acceleration = jnp.clip(ahead, -self.max_acceleration, self.max_acceleration)
        return ServoState(position, velocity, acceleration, mean, step)

    def response(self, frequency: Float[np.ndarray, " f"]) -> Complex[np.ndarray, "f input"]:
        """Return position over command at frequencies (Hz), as long as no limit is met."""
        ratio = frequency[:, None] * _DAMPED_BANDWIDTH / np.asarray(self.bandwidth)
        return 1 / (1 + 1j * ratio) ** 2

    def _within(self, position: Channels) -> Channels:
        # a channel without room stays put; `clip` would let it answer with half a slope
        fixed = self.lower >= self.upper
        return jnp.where(fixed, self.lower, jnp.clip(position, self.lower, self.upper))

    @property
    def natural(self) -> Channels:
        """Natural circular frequency of each channel, which is critically damped (rad/s)."""
        return 2 * jnp.pi * self.bandwidth / _DAMPED_BANDWIDTH

    @property
    def _linear_reach(self) -> Channels:
        braking = 3 * self.max_acceleration / self.natural**2
        return jnp.minimum(braking, 2 * self.max_speed / self.natural)

    def _wanted_velocity(self, error: Channels) -> Channels:
        # v = sqrt(2 a (d - a / n^2)) brakes at a; less the lag a / (2 n) it meets n d / 2 where
        # d = 3 a / n^2, with the same slope
        natural, brake = self.natural, self.max_acceleration
        distance = jnp.abs(error)
        margin = brake / natural**2
        curve = jnp.sqrt(2 * brake * jnp.maximum(distance - margin, 2 * margin))
        far = -jnp.sign(error) * (curve - 0.5 * brake / natural)
        velocity = jnp.where(distance > 3 * margin, far, -0.5 * natural * error)
        return jnp.clip(velocity, -self.max_speed, self.max_speed)

    def _fastest(self, room: Channels, start: Channels, step: Array) -> Channels:
        """Return the greatest speed after a step from which full braking stops within ``room``."""
        brake = self.max_acceleration * step
        left = jnp.maximum(room - 0.5 * start * step, 0.0)
        return jnp.sqrt(0.25 * brake**2 + 2 * self.max_acceleration * left) - 0.5 * brake


Time = Float[Array, ""]
Turns = tuple[tuple[Array, ...], tuple[Array, ...]]


class BaseMotion(eqx.Module):
    """A displacement of one channel as a function of time (m or rad)."""

    channel: eqx.AbstractVar[int]

    @abstractmethod
    def displacement(self, time: Time) -> Float[Array, ""]:
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
            return Prescribed(*jnp.stack([ghost, root], axis=1), None)
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
            [
                jnp.stack([ghost, root], axis=1)[1:],
                jnp.stack([still[:2], spin], axis=1)[..., None],
            ],
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
