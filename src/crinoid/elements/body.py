"""A rigid sphere that the arm can push away."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from crinoid.elements.element import Element, Motion
from crinoid.elements.geometry import smooth_speed

DRAG = 0.47
"""Drag coefficient of a sphere between Reynolds numbers of 1e3 and 1e5 (Hoerner 1965, 3-8)."""
_ADDED_MASS = 0.5
"""Added mass of a sphere over the mass of the water that it displaces (Batchelor 1967, 6.4)."""


class Body(Element):
    """Inertia, weight, buoyancy, drag, added mass and Froude-Krylov force of a free sphere.

    ``m a = rho V Du/Dt + rho V / 2 (Du/Dt - a) + 1/2 rho C_d pi r^2 |w| w - (m - rho V) g``.
    It does not spin: of a row in space the last coordinate has an inertia, and nothing moves it.
    """

    stencil: ClassVar[int] = 1
    spins: ClassVar[bool] = True
    first: int = eqx.field(static=True)
    mass: Float[Array, "*count"]
    """Mass (kg)."""
    displaced: Float[Array, "*count"]
    """Mass of the water that it displaces (kg)."""
    drag: Float[Array, "*count"]
    """Drag over ``|w| w`` (kg/m)."""
    weight: Float[Array, "*count"]
    """Weight less buoyancy (N)."""

    @staticmethod
    def of(
        *,
        mass: Float[Array, " m"],
        radius: Float[Array, " m"],
        density: float | Array,
        gravity: float | Array,
    ) -> "Body":
        """Build spheres of given mass (kg) and radius (m) in water of a density (kg/m3)."""
        displaced = density * 4 / 3 * jnp.pi * radius**3
        drag = 0.5 * density * DRAG * jnp.pi * radius**2
        return Body(0, mass, displaced, drag, (mass - displaced) * gravity)

    def residual(self, motion: Motion) -> Float[Array, "1 b"]:
        axes = motion.flow_velocity.shape[1]
        relative = motion.flow_velocity - motion.velocity[:, :axes]
        water = self.displaced * (
            motion.flow_acceleration
            + _ADDED_MASS * (motion.flow_acceleration - motion.acceleration[:, :axes])
        )
        drag = self.drag * smooth_speed(jnp.sum(relative**2)) * relative
        weight = self.weight * np.eye(relative.shape[1])[-1:]
        force = water + drag - weight
        spare = motion.acceleration.shape[1] - axes
        return self.mass * motion.acceleration - jnp.pad(force, ((0, 0), (0, spare)))
