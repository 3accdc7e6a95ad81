"""Motion of the submarine that nobody commands: it rides on top of the channels."""

from abc import abstractmethod

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.onset import Onset
from crinoid.spline import PiecewisePolynomial

Time = Float[Array, ""]


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
