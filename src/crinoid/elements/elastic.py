"""Elasticity of a discrete rod, with Kelvin-Voigt damping on every strain: stretch, planar bend.

A strain ``s`` of a window stores ``1/2 K (s - s_rest)^2``; its stress is
``K (s - s_rest + damping_time ds/dt)``, and the force is the stress times ``grad s``.
"""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.elements.element import Element, Motion
from crinoid.elements.geometry import bend_strain, turned, unit
from crinoid.rod import Rod


class Stretch(Element):
    """Stretch of an edge: ``s = |e| / l - 1`` with ``K = EA l`` (Bergou et al. 2010, eq. 3)."""

    stencil: ClassVar[int] = 2
    stored: ClassVar[str] = "elastic"
    worked: ClassVar[str] = "damping"
    first: int = eqx.field(static=True)
    EA: Float[Array, "*count"]
    rest_length: Float[Array, "*count"]
    damping_time: Float[Array, "*count"]

    @staticmethod
    def of(rod: Rod) -> "Stretch":
        """Build the edges of a rod."""
        damping_time = jnp.broadcast_to(rod.damping_time, rod.EA.shape)
        return Stretch(1, rod.EA, rod.chord_length, damping_time)

    def residual(self, motion: Motion) -> Float[Array, "2 b"]:
        strain, rate, direction = self._strain(motion)
        force = self.EA * (strain + self.damping_time * rate) * direction
        return jnp.stack([-force, force])

    def working(self, motion: Motion) -> Float[Array, "2 b"]:
        _, rate, direction = self._strain(motion)
        force = self.EA * self.damping_time * rate * direction
        return jnp.stack([force, -force])

    def energy(self, motion: Motion) -> Float[Array, ""]:
        strain, _, _ = self._strain(motion)
        return 0.5 * self.EA * self.rest_length * strain**2

    def _strain(self, motion: Motion) -> tuple[Array, Array, Array]:
        direction, length = unit(motion.position[1] - motion.position[0])
        speed = jnp.sum(direction * (motion.velocity[1] - motion.velocity[0]))
        return length / self.rest_length - 1.0, speed / self.rest_length, direction


class Bend(Element):
    """Bend at a node between two edges: ``s`` is the turn (`bend_strain`), and ``K = EI / l``.

    ``l`` is the length over which the node gathers the bend (after Bergou et al. 2008, eq. 1; 2010,
    section 4.1.1). The strain grows without bound as the edges fold onto each other, so an arm does
    not snap through a fold.
    At the root the first edge of the window is the ghost edge of the clamp, and the node owns half
    an edge: that keeps the clamp at the root itself.
    """

    stencil: ClassVar[int] = 3
    stored: ClassVar[str] = "elastic"
    worked: ClassVar[str] = "damping"
    first: int = eqx.field(static=True)
    stiffness: Float[Array, "*count"]
    """``EI / l`` (N m)."""
    rest_strain: Float[Array, "*count"]
    damping_time: Float[Array, "*count"]

    @staticmethod
    def of(rod: Rod, *, pinned: bool = False) -> "Bend":
        """Build the nodes of a rod but its tip; a pinned root resists no bending."""
        stiffness = rod.EI[:-1] / rod.strain_length[:-1, 0]
        if pinned:
            stiffness = stiffness.at[0].set(0.0)
        damping_time = jnp.broadcast_to(rod.damping_time, stiffness.shape)
        tangent = jnp.tan(0.5 * rod.rest_turn[:-1])
        rest = bend_strain(tangent, jnp.sqrt(1.0 + tangent**2))
        return Bend(0, stiffness, rest, damping_time)

    def residual(self, motion: Motion) -> Float[Array, "3 2"]:
        strain, rate, gradient = self._strain(motion)
        return self.stiffness * (strain - self.rest_strain + self.damping_time * rate) * gradient

    def working(self, motion: Motion) -> Float[Array, "3 2"]:
        _, rate, gradient = self._strain(motion)
        return -self.stiffness * self.damping_time * rate * gradient

    def strains(self, motion: Motion) -> Float[Array, "1"]:
        """Return the strain, as the one of a window."""
        return self._strain(motion)[0][None]

    def energy(self, motion: Motion) -> Float[Array, ""]:
        strain, _, _ = self._strain(motion)
        return 0.5 * self.stiffness * (strain - self.rest_strain) ** 2

    def _strain(self, motion: Motion) -> tuple[Array, Array, Array]:
        before, length_before = unit(motion.position[1] - motion.position[0])
        after, length_after = unit(motion.position[2] - motion.position[1])
        normal = turned(before)
        tangent = jnp.sum(normal * after) / (1.0 + jnp.sum(before * after))  # of half the turn
        secant = jnp.sqrt(1.0 + tangent**2)
        strain = bend_strain(tangent, secant)
        # d(strain)/d(turn), and an edge turns by its normal over its length
        growth = (secant**2 + 2.0 / secant) / 3.0
        by_before = -growth * normal / length_before
        by_after = growth * turned(after) / length_after
        gradient = jnp.stack([-by_before, by_before - by_after, by_after])
        return strain, jnp.sum(gradient * motion.velocity), gradient
