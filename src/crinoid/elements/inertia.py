"""Inertia of the arm's own mass, lumped at its nodes."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.elements.element import Element, Motion
from crinoid.rod import Rod


class Inertia(Element):
    """``m a`` at each node."""

    stencil: ClassVar[int] = 1
    stored: ClassVar[str] = "kinetic"
    first: int = eqx.field(static=True)
    mass: Float[Array, "*count"]

    @staticmethod
    def of(rod: Rod) -> "Inertia":
        """Lump the mass of a rod: each node takes the length that it owns."""
        return Inertia(1, rod.mass_per_length * rod.voronoi_length)

    def residual(self, motion: Motion) -> Float[Array, "1 b"]:
        return self.mass * motion.acceleration

    def energy(self, motion: Motion) -> Float[Array, ""]:
        return 0.5 * self.mass * jnp.sum(motion.velocity**2)

    def power(self, motion: Motion) -> Float[Array, ""]:
        return jnp.zeros(())
