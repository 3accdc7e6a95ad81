"""A servo: a channel of the base that follows a command as fast as its limits allow."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

Channels = Float[Array, " channel"]

_DAMPED_BANDWIDTH = (2.0**0.5 - 1.0) ** 0.5
"""Where a critically damped second-order response falls by 3 dB, over its natural frequency."""


class ServoState(eqx.Module):
    """Where the channels are and how they move (m or rad, s)."""

    position: Channels
    velocity: Channels
    acceleration: Channels


class Servo(eqx.Module):
    """Critically damped second-order followers with limits on range, speed and acceleration."""

    lower: Channels
    upper: Channels
    max_speed: Channels
    max_acceleration: Channels
    bandwidth: Channels
    """Frequency at which the response has fallen by 3 dB (Hz)."""

    def at_rest(self) -> ServoState:
        """Return the servos at zero, not moving."""
        zero = jnp.zeros_like(self.lower)
        return ServoState(zero, zero, zero)

    def advance(self, state: ServoState, command: Channels, step: Array) -> ServoState:
        """Follow ``command`` for ``step`` seconds at an acceleration constant over the step.

        Without limits the end of the step lies on the exact response to a held command. The speed
        is held to what the servo can still brake off before the end of its range and before the
        command, so that neither is overrun.
        """
        command = jnp.clip(command, self.lower, self.upper)
        natural = 2 * jnp.pi * self.bandwidth / _DAMPED_BANDWIDTH
        error = state.position - command
        slope = state.velocity + natural * error
        free_velocity = (state.velocity - natural * slope * step) * jnp.exp(-natural * step)

        forward = jnp.minimum(self.max_speed, self._braking_speed(command - state.position, step))
        backward = jnp.minimum(self.max_speed, self._braking_speed(state.position - command, step))
        velocity = jnp.clip(free_velocity, -backward, forward)
        limit = self.max_acceleration * step
        velocity = jnp.clip(velocity, state.velocity - limit, state.velocity + limit)
        position = state.position + 0.5 * (state.velocity + velocity) * step
        # round-off and a step too coarse to brake in must not carry the servo past its stops
        held = jnp.clip(position, self.lower, self.upper)
        velocity = jnp.where(held == position, velocity, 0.0)
        return ServoState(held, velocity, (velocity - state.velocity) / step)

    def _braking_speed(self, distance: Channels, step: Array) -> Channels:
        # the fastest speed at the end of this step that full braking stops within `distance`
        brake = self.max_acceleration * step
        room = jnp.maximum(distance, 0.0)
        return jnp.sqrt(0.25 * brake**2 + 2 * self.max_acceleration * room) - 0.5 * brake
