"""Forces of the water on the arm: Morison's on the relative velocity, weight and buoyancy.

Forces per length are integrated along each edge (``crinoid.rod.reference.shared``) with the
edge's tangent ``t`` all along it. The relative velocity ``w = u - v`` splits into ``w_t`` along the
tangent and ``w_n`` normal to it (Morison et al. 1950; cross-flow principle, Sumer and Fredsoe
2006, section 1.4).
"""

from typing import ClassVar, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from crinoid.elements.element import Element, Motion
from crinoid.numerics.frames import unit
from crinoid.numerics.small_matrices import product
from crinoid.rod import Rod
from crinoid.rod.reference import along, mass_matrices, shared


class Drag(Element):
    """Drag: quadratic along and across the arm, and linear.

    Per length: ``1/2 rho C_dn d |w_n| w_n + 1/2 rho C_dt pi d |w_t| w_t + c w``. With a viscosity
    ``C_dn`` is multiplied by ``cylinder_drag`` of the Reynolds number of ``w_n``.
    """

    stencil: ClassVar[int] = 2
    external: ClassVar[bool] = True
    worked: ClassVar[str] = "drag"
    first: int = eqx.field(static=True)
    normal: Float[Array, "*count 3"]
    """Force per length over ``|w_n| w_n`` at the start, the middle and the end of an edge,
    times its length (kg/m)."""
    tangential: Float[Array, "*count 3"]
    """Likewise over ``|w_t| w_t`` (kg/m)."""
    linear: Float[Array, "*count 3"]
    """Likewise over ``w`` (kg/s)."""
    reynolds: Float[Array, "*count 3"] | None = None
    """Reynolds number over the speed across, at the same places (s/m); None: constant drag."""

    @staticmethod
    def of(
        rod: Rod,
        *,
        density: float | Array,
        normal: float | Array,
        tangential: float | Array,
        linear: float | Array,
        viscosity: float | Array | None = None,
    ) -> "Drag":
        """Build the drag of a rod; ``linear`` in N s/m2, the others dimensionless.

        With a kinematic ``viscosity`` (m2/s) ``normal`` is a factor on the drag of a cylinder.
        """
        length = rod.rest_length[:, None]
        wetted = 0.5 * density * rod.edge_diameter * length
        return Drag(
            1,
            jnp.asarray(normal) * wetted,
            jnp.asarray(tangential) * jnp.pi * wetted,
            jnp.asarray(linear) * jnp.broadcast_to(length, wetted.shape),
            None if viscosity is None else rod.edge_diameter / viscosity,
        )

    def residual(self, motion: Motion) -> Float[Array, "2 b"]:
        tangent, _ = unit(motion.position[1] - motion.position[0])
        relative = along(motion.flow_velocity - motion.velocity)
        slip = jnp.sum(relative * tangent, axis=1)  # `@` would call a routine for each edge
        across = relative - slip[:, None] * tangent
        across_speed = smooth_speed(jnp.sum(across**2, axis=1))
        normal = self.normal * across_speed
        if self.reynolds is not None:
            normal = normal * cylinder_drag(self.reynolds * across_speed)
        return -shared(
            normal[:, None] * across
            + (self.tangential * smooth_speed(slip**2) * slip)[:, None] * tangent
            + self.linear[:, None] * relative
        )


class AddedMass(Element):
    """Inertia of the water: added mass along and across the arm, and the Froude-Krylov force.

    Per length: ``rho A [C_an (I - t t) + C_at t t] (Du/Dt - a) + rho A Du/Dt``. Its work counts
    as external: the kinetic energy of the water is not stored.
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


Number = TypeVar("Number", Float[Array, "..."], Float[np.ndarray, "..."])


def cylinder_drag(reynolds: Number) -> Number:
    """Return the drag coefficient of a smooth cylinder across a steady flow.

    For Reynolds numbers from 1e-4 to 2e5 (Sucker and Brauer 1975).
    """
    hump = 4e-4 * reynolds / (1 + 3.64e-7 * reynolds**2)
    return 1.18 + 6.8 * reynolds**-0.89 + 1.96 * reynolds**-0.5 - hump


def cylinder_added_mass(keulegan_carpenter: float) -> float:
    """Return the added mass of a smooth cylinder over the displaced mass.

    By the Keulegan-Carpenter number of the flow (DNV-RP-C205, section 6.9).
    """
    return max(0.6, 1 - 0.044 * max(0.0, keulegan_carpenter - 3))


def smooth_speed(squared: Float[Array, "..."]) -> Float[Array, "..."]:
    """Return the root of a squared speed, with a derivative at rest.

    The rounding is 1e-9 m/s wide: above 1e-6 m/s it changes a drag force by less than 1e-6 of it.
    """
    return jnp.sqrt(squared + 1e-18)
