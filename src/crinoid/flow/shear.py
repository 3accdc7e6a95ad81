"""Currents that grow from the sea bed upward."""

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.flow.flow import Flow, Point, Time
from crinoid.onset import Onset


class PowerShear(Flow):
    """``u = velocity (h / h_ref)^exponent``, h the height above the sea bed; 0 below the bed."""

    steady: ClassVar[bool] = True
    onset: Onset
    reference_velocity: Float[Array, " b"]
    """Velocity at the reference height (m/s)."""
    reference_height: Float[Array, ""]
    """Height above the bed at which the reference velocity is reached (m)."""
    bed: Float[Array, ""]
    """Upward coordinate of the sea bed (m)."""
    exponent: Float[Array, ""]
    """Exponent of the height (1)."""

    def fully_on(self, point: Point, time: Time) -> Point:
        height = point[-1] - self.bed
        above = height > 0
        # the power's slope is infinite at the bed: keep it out of the branch that is not taken
        relative = jnp.where(above, height, self.reference_height) / self.reference_height
        return jnp.where(above, relative**self.exponent, 0.0) * self.reference_velocity


class LogarithmicShear(Flow):
    """``u = velocity ln(h / z_0) / ln(h_ref / z_0)``; 0 below the roughness length z_0."""

    steady: ClassVar[bool] = True
    onset: Onset
    reference_velocity: Float[Array, " b"]
    """Velocity at the reference height (m/s)."""
    reference_height: Float[Array, ""]
    """Height above the bed at which the reference velocity is reached (m)."""
    bed: Float[Array, ""]
    """Upward coordinate of the sea bed (m)."""
    roughness_length: Float[Array, ""]
    """Roughness length of the bed (m)."""

    def fully_on(self, point: Point, time: Time) -> Point:
        relative = jnp.maximum((point[-1] - self.bed) / self.roughness_length, 1.0)
        scale = jnp.log(self.reference_height / self.roughness_length)
        return jnp.log(relative) / scale * self.reference_velocity
