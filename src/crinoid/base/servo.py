"""Servos of the base: followers of a command with limits."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from crinoid.actuation import Actuator, Input
from crinoid.foundation.axes import ANGLES, CHANNELS

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
