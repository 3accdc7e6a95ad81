"""Contact of the arm with a surface of any shape: a mesh, or a bed."""

from abc import abstractmethod
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.elements.body_contact import BodyContact
from crinoid.elements.contact import Contact
from crinoid.foundation.fixed_numbers import BED_RANGE, BODY_SKIN, EASE, NEAREST_STEPS
from crinoid.numerics.grid_spline import GridSpline
from crinoid.numerics.small_matrices import product


class Surface(eqx.Module):
    """Boundary of a solid, by the distance of a point from it."""

    samples: eqx.AbstractVar[int]
    """Number of points on an edge among which the search for the nearest one begins."""

    @abstractmethod
    def distance(self, place: Float[Array, " d"], near: Float[Array, ""]) -> Float[Array, ""]:
        """Return the signed distance (m) of a place (m) from the surface, negative inside.

        It must be right within a distance ``near`` (m), where contact may begin.
        """


class SignedDistance(Surface):
    """Surface as the zero level of its signed distance on a grid around the solid."""

    spline: GridSpline
    samples: int = eqx.field(static=True)

    def distance(self, place: Float[Array, " d"], near: Float[Array, ""]) -> Float[Array, ""]:
        """Return the signed distance (m); outside of the grid a lower bound to it."""
        value, off = self.spline(place), place - self.spline.clamped(place)
        beyond = product(off, off)
        # the solid lies on the other side of the grid's face: the angle there is obtuse
        far = jnp.sqrt(jnp.where(beyond > 0, beyond + value**2, 1.0))
        return jnp.where(beyond > 0, far, value)


class Bed(Surface):
    """Surface as heights over level places; all below is solid."""

    height: GridSpline
    samples: int = eqx.field(static=True)

    def distance(self, place: Float[Array, " d"], near: Float[Array, ""]) -> Float[Array, ""]:
        """Return the distance (m) from the tangent plane at the nearest point of the bed.

        That point is estimated on the tangent plane right below, so the error is of third order
        in the distance over the radius of curvature.
        """
        level, z = place[:-1], place[-1]

        def above(foot: Array) -> tuple[Array, Array]:
            height, slope = jax.value_and_grad(self.height)(foot)
            return z - height - product(slope, level - foot), slope

        rise, slope = above(level)
        # where the place is far, its nearest point may be anywhere
        shift = jnp.clip(rise, -near, near) / (1 + product(slope, slope))
        rise, slope = above(level + shift * slope)
        return rise / jnp.sqrt(1 + product(slope, slope))


class SurfaceContact(Contact):
    """Contact of an edge, a capsule as thick as the arm, with one surface.

    The gap is ``min_s phi(x(s)) + EASE l (s - 1/2)^2 / 2`` less the radius of the arm, with the
    distance ``phi`` and the length ``l`` of the edge at rest. Its slope is that of ``phi`` at the
    nearest point (envelope theorem), which follows from a search along the edge. First derivatives
    of force and gap come from the Taylor expansion of ``phi`` there, to second order; that of the
    nearest point is the one of an implicit function.

    The skin, the dashpot and friction are those of `crinoid.elements.Contact`. There is one point
    of contact for each edge.
    """

    surface: Surface = eqx.field(kw_only=True)

    @property
    def window_axes(self) -> Any:
        every = jax.tree.map(lambda _: 0, self)
        return eqx.tree_at(lambda contact: contact.surface, every, None)

    def _closest(
        self, position: Float[Array, "3 d"], half_axis: Float[Array, " d"]
    ) -> tuple[Array, Array, Array, Array]:
        near, far, place = position
        edge, start = far - near, near - place
        still, *ends = jax.lax.stop_gradient((self, start, edge))
        share = still._nearest(*ends)
        point = ends[0] + share * ends[1]
        value, slope, bend = still._expanded(point)
        curve = product(product(bend, ends[1]), ends[1]) + still._pull

        def outward(moved: Array) -> Array:
            return slope + product(bend, moved)

        # nothing in value: the nearest point moves with the edge, and along it
        moved = start + share * edge - point
        rising = product(outward(moved), edge) + self._pull * (share - 0.5)
        nearest = jnp.clip(share - rising / jnp.maximum(curve, 0.1 * still._pull), 0.0, 1.0)
        moved = start + nearest * edge - point
        weights = jnp.stack([1 - nearest, nearest, -jnp.ones_like(nearest)])
        distance = value + 0.5 * product(slope + outward(moved), moved)
        gap = distance + 0.5 * self._pull * (nearest - 0.5) ** 2 - self.arm_radius
        return gap, weights[:, None] * outward(moved), nearest, 0 * half_axis

    @property
    def _pull(self) -> Array:
        return EASE * self.rest_length

    def _distance(self, place: Array) -> Array:
        return self.surface.distance(place, BED_RANGE * self.arm_radius)

    def _expanded(self, point: Array) -> tuple[Array, Array, Array]:
        """Return the distance (m), its gradient, and its second derivatives (1/m)."""

        def sloped(point: Array) -> tuple[Array, tuple[Array, Array]]:
            value, slope = jax.value_and_grad(self._distance)(point)
            return slope, (value, slope)

        bend, (value, slope) = jax.jacfwd(sloped, has_aux=True)(point)
        return value, slope, bend

    def _nearest(self, start: Array, edge: Array) -> Array:
        """Return the place along the edge with the least eased distance, from 0 to 1."""

        def eased(share: Array) -> Array:
            return self._distance(start + share * edge) + 0.5 * self._pull * (share - 0.5) ** 2

        def sloped(share: Array) -> Array:
            return jax.jvp(eased, (share,), (jnp.ones_like(share),))[1]

        shares = jnp.linspace(0.0, 1.0, self.surface.samples)
        least = jnp.argmin(jax.vmap(eased)(shares))
        ends = shares[jnp.maximum(least - 1, 0)], shares[jnp.minimum(least + 1, shares.size - 1)]

        def narrowed(_: Any, bracket: tuple[Array, ...]) -> tuple[Array, ...]:
            low, high, share = bracket
            slope, curve = jax.jvp(sloped, (share,), (jnp.ones_like(share),))
            low, high = jnp.where(slope < 0, share, low), jnp.where(slope < 0, high, share)
            newton = share - slope / jnp.where(curve > 0, curve, 1.0)
            inside = (curve > 0) & (newton >= low) & (newton <= high)
            return low, high, jnp.where(inside, newton, 0.5 * (low + high))

        return jax.lax.fori_loop(0, NEAREST_STEPS, narrowed, (*ends, shares[least]))[2]


class BodySurfaceContact(SurfaceContact, BodyContact):
    """Contact of a free body with a surface: as that of an edge, with the skin of bodies."""

    @property
    def skin(self) -> Float[Array, "*count"]:
        return BODY_SKIN * self.arm_radius
