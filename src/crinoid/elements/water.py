"""Forces of the water on the arm: Morison's on the relative velocity, weight and buoyancy.

Forces per length are integrated along each edge (`crinoid.elements.edge`) with the edge's own
tangent ``t`` all along it. The relative velocity ``w = u - v`` splits into ``w_t`` along the
tangent and ``w_n`` normal to it (Morison et al. 1950; cross-flow principle, Sumer and Fredsoe
2006, section 1.4).
"""

from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from crinoid.elements.edge import along, at_ends, mass_matrices, shared
from crinoid.elements.element import Element, Motion
from crinoid.elements.geometry import smooth_speed, unit
from crinoid.products import product
from crinoid.rod import Rod


class Drag(Element):
    """Quadratic drag along and across the arm, and a linear one.

    Per length: ``1/2 rho C_dn d |w_n| w_n + 1/2 rho C_dt pi d |w_t| w_t + c w``.
    """

    stencil: ClassVar[int] = 2
    external: ClassVar[bool] = True
    worked: ClassVar[str] = "drag"
    first: int = eqx.field(static=True)
    normal: Float[Array, "*count 3"]
    """Force per length over ``|w_n| w_n`` at the start, the middle and the end of an edge,
    times its length (kg/m)."""
    tangential: Float[Array, "*count 3"]
    """Force per length over ``|w_t| w_t`` at the start, the middle and the end of an edge,
    times its length (kg/m)."""
    linear: Float[Array, "*count 3"]
    """Force per length over ``w`` at the start, the middle and the end of an edge,
    times its length (kg/s)."""

    @staticmethod
    def of(
        rod: Rod,
        *,
        density: float | Array,
        normal: float | Array,
        tangential: float | Array,
        linear: float | Array,
    ) -> "Drag":
        """Build the drag of a rod; ``linear`` in N s/m2, the others are coefficients."""
        length = rod.rest_length[:, None]
        wetted = 0.5 * density * jax.vmap(along)(at_ends(rod.diameter)) * length
        return Drag(
            1,
            jnp.asarray(normal) * wetted,
            jnp.asarray(tangential) * jnp.pi * wetted,
            jnp.asarray(linear) * jnp.broadcast_to(length, wetted.shape),
        )

    def residual(self, motion: Motion) -> Float[Array, "2 b"]:
        tangent, _ = unit(motion.position[1] - motion.position[0])
        relative = along(motion.flow_velocity - motion.velocity)
        slip = jnp.sum(relative * tangent, axis=1)  # `@` would call a routine for each edge
        across = relative - slip[:, None] * tangent
        across_speed = smooth_speed(jnp.sum(across**2, axis=1))
        return -shared(
            (self.normal * across_speed)[:, None] * across
            + (self.tangential * smooth_speed(slip**2) * slip)[:, None] * tangent
            + self.linear[:, None] * relative
        )


class AddedMass(Element):
    """Inertia of the water: added mass along and across the arm, and the Froude-Krylov force.

    Per length: ``rho A [C_an (I - t t) + C_at t t] (Du/Dt - a) + rho A Du/Dt``. Its work counts
    as that of a force from outside, the kinetic energy of the water not being kept.
    """

    stencil: ClassVar[int] = 2
    external: ClassVar[bool] = True
    worked: ClassVar[str] = "added_mass"
    first: int = eqx.field(static=True)
    displaced: Float[Array, "*count 2 2"]
    """Mass matrix of the water that an edge displaces (kg)."""
    normal: Float[Array, "*count"]
    """Added-mass coefficient across the arm (1)."""
    tangential: Float[Array, "*count"]
    """Added-mass coefficient along the arm (1)."""

    @staticmethod
    def of(
        rod: Rod, *, density: float | Array, normal: float | Array, tangential: float | Array
    ) -> "AddedMass":
        """Build the added mass of a rod from its coefficients."""
        displaced = mass_matrices(density * rod.edge_volume)
        edges = rod.rest_length.shape
        return AddedMass(
            1,
            displaced,
            jnp.broadcast_to(jnp.asarray(normal, float), edges),
            jnp.broadcast_to(jnp.asarray(tangential, float), edges),
        )

    def residual(self, motion: Motion) -> Float[Array, "2 b"]:
        tangent, _ = unit(motion.position[1] - motion.position[0])
        relative = motion.flow_acceleration - motion.acceleration
        forward = jnp.sum(relative * tangent, axis=1)[:, None] * tangent
        pushed = self.normal * (relative - forward) + self.tangential * forward
        return -product(self.displaced, pushed + motion.flow_acceleration)


class Weight(Element):
    """Weight less buoyancy, ``-(m - rho A) g`` per length, along the last axis."""

    stencil: ClassVar[int] = 1
    external: ClassVar[bool] = True
    first: int = eqx.field(static=True)
    force: Float[Array, "*count"]
    """Downward force on each node (N)."""

    @staticmethod
    def of(rod: Rod, *, density: float | Array, gravity: float | Array) -> "Weight":
        """Build the weight in water of a rod."""
        on_ends = jax.vmap(shared)(gravity * (rod.edge_mass - density * rod.edge_volume))
        return Weight(1, jnp.pad(on_ends[:, 0], (0, 1)) + jnp.pad(on_ends[:, 1], (1, 0)))

    def residual(self, motion: Motion) -> Float[Array, "1 b"]:
        return self.force * np.eye(motion.position.shape[1])[-1:]

    def energy(self, motion: Motion) -> Float[Array, ""]:
        return self.force * motion.position[0, -1]

    def working(self, motion: Motion) -> None:
        return None
