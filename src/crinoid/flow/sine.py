"""A current that swings to and fro."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.flow.flow import Everywhere, Point, Time
from crinoid.onset import Onset


class Sine(Everywhere):
    """``u = amplitude sin(2 pi f t + phase)``."""

    onset: Onset
    amplitude: Float[Array, " b"]
    """Amplitude of the velocity (m/s)."""
    frequency: Float[Array, ""]
    """Cycles per second (Hz)."""
    phase: Float[Array, ""]
    """Phase at time zero (rad)."""

    def at(self, time: Time) -> Point:
        angle = 2 * jnp.pi * self.frequency * time + self.phase
        return self.amplitude * jnp.sin(angle)

    def path(self, time: Time) -> Point:
        rate = 2 * jnp.pi * self.frequency
        return -self.amplitude / rate * jnp.cos(rate * time + self.phase)
