"""Paths that a target takes by a formula."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.onset import Onset

Time = Float[Array, ""]


class Orbit(eqx.Module):
    """``centre + cos(angle) cosine + sin(angle) sine``: a circle, an ellipse, or to and fro."""

    centre: Float[Array, " d"]
    """Position of the centre (m)."""
    cosine: Float[Array, " d"]
    """From the centre to where the angle is zero (m)."""
    sine: Float[Array, " d"]
    """From the centre to where the angle is a right one (m)."""
    rate: Float[Array, ""]
    """Rate of the angle, once it is up to speed (rad/s)."""
    phase: Float[Array, ""]
    """The angle at the start (rad)."""
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
