"""Inertia of the arm's own mass."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.elements.edge import mass_matrices
from crinoid.elements.element import Element, Motion
from crinoid.products import product
from crinoid.rod import Rod


class Inertia(Element):
    """``m a`` along each edge, and in space ``I`` times the acceleration of its spin."""

    stencil: ClassVar[int] = 2
    stored: ClassVar[str] = "kinetic"
    spins: ClassVar[bool] = True
    first: int = eqx.field(static=True)
    mass: Float[Array, "*count 2 2"]
    """Mass matrix of an edge (kg)."""
    spin: Float[Array, "*count turns"]
    """In space, the moment of inertia of the edge about itself (kg m2)."""

    @staticmethod
    def of(rod: Rod) -> "Inertia":
        """Build the inertia of a rod."""
        mass = mass_matrices(rod.edge_mass)
        spin = rod.spin_inertia
        spin = jnp.zeros((mass.shape[0], 0)) if spin is None else spin[:, None]
        return Inertia(1, mass, spin)

    def residual(self, motion: Motion) -> Float[Array, "2 b"]:
        return self._momentum(motion.acceleration)

    def energy(self, motion: Motion) -> Float[Array, ""]:
        return 0.5 * jnp.sum(self._momentum(motion.velocity) * motion.velocity)

    def working(self, motion: Motion) -> None:
        return None

    def _momentum(self, velocity: Float[Array, "2 b"]) -> Float[Array, "2 b"]:
        axes = velocity.shape[1] - self.spin.size
        moving = product(self.mass, velocity[:, :axes])
        spinning = jnp.stack([jnp.zeros_like(self.spin), self.spin * velocity[1, axes:]])
        return jnp.concatenate([moving, spinning], axis=1)
