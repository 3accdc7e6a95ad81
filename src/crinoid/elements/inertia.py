"""Inertia of the arm's own mass, lumped at its nodes."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.elements.element import Element, Motion
from crinoid.rod import Rod


class Inertia(Element):
    """``m a`` at each node, and in space ``I`` times the angular acceleration of each spin."""

    stencil: ClassVar[int] = 1
    stored: ClassVar[str] = "kinetic"
    spins: ClassVar[bool] = True
    first: int = eqx.field(static=True)
    mass: Float[Array, "*count b"]
    """Of each node (kg) and, in space, of the edge that ends there about itself (kg m2)."""

    @staticmethod
    def of(rod: Rod) -> "Inertia":
        """Lump the mass of a rod: each node takes the length that it owns."""
        mass = jnp.repeat((rod.mass_per_length * rod.voronoi_length)[:, None], rod.axes, axis=1)
        if rod.spin_inertia is not None:
            # the edge that ends at the root is the clamp's
            spin = jnp.pad(rod.spin_inertia, (1, 0))[:, None]
            mass = jnp.concatenate([mass, spin], axis=1)
        return Inertia(1, mass)

    def residual(self, motion: Motion) -> Float[Array, "1 b"]:
        return self.mass * motion.acceleration

    def energy(self, motion: Motion) -> Float[Array, ""]:
        return 0.5 * jnp.sum(self.mass * motion.velocity**2)

    def power(self, motion: Motion) -> Float[Array, ""]:
        return jnp.zeros(())
