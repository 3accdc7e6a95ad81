"""Soft skin between two surfaces: a penalty force by their gap, a dashpot, and friction."""

from abc import abstractmethod
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from crinoid.elements.element import Law
from crinoid.foundation.fixed_numbers import (
    CREEP,
    EASE,
    MISSED_WORK,
    NEGLIGIBLE_WORK,
    SKIN_DAMPING,
    SKIN_STRENGTH,
)
from crinoid.numerics.small_matrices import product
from crinoid.rod import Rod


class SoftSkin(Law):
    """Soft skin between two surfaces: its force by their gap, a dashpot, and friction."""

    strength: eqx.AbstractVar[Float[Array, "*count"]]
    """Force where the surfaces meet (N)."""
    friction: eqx.AbstractVar[Float[Array, "*count"]]
    mass: eqx.AbstractVar[Float[Array, "*count"]]
    """Reduced mass of the two (kg)."""

    @property
    @abstractmethod
    def skin(self) -> Float[Array, "*count"]:
        """Gap at which contact begins (m)."""

    @property
    @abstractmethod
    def between_axes(self) -> Float[Array, "*count"]:
        """Distance of the two axes where the surfaces meet (m)."""

    @abstractmethod
    def gap(self, position: Float[Array, "k b"], pose: Any) -> Float[Array, ""]:
        """Return the distance of the surfaces (m); ``pose`` is the memory of the window."""

    @abstractmethod
    def travel(self, moved: Float[Array, "k b"]) -> Float[Array, ""]:
        """Return the largest displacement of one relative to the other, from that of its rows."""

    def press(self, gap: Float[Array, "*count"]) -> tuple[Array, Array]:
        """Return the potential (J) and the force (N) of the skin at a gap (m)."""
        depth = jnp.maximum(1.0 - gap / self.skin, 0.0)
        return self.strength * self.skin * depth**5 / 5, self.strength * depth**4

    def damped(self, gap: Float[Array, ""], rate: Float[Array, ""]) -> Float[Array, ""]:
        """Return the force of skin and dashpot (N), by the gap (m) and its rate (m/s)."""
        _, force = self.press(gap)
        rubs = (force > 0) & (self.friction > 0)
        depth = jnp.where(rubs, 1.0 - gap / self.skin, 1.0)  # a root with a finite slope
        dashpot = 4.0 * SKIN_DAMPING * jnp.sqrt(self.mass * self.strength * depth**3 / self.skin)
        return jnp.where(rubs, jnp.maximum(force - dashpot * rate, 0.0), force)

    def rubbing(self, pressing: Float[Array, ""], sliding: Float[Array, " d"]) -> Array:
        """Return the friction (N) under a pressing force (N), by the velocity of sliding (m/s)."""
        return -self.friction * pressing * eased_direction(sliding)

    def resolved(
        self,
        moved: Float[Array, "*count k b"],
        before: Float[Array, "*count"],
        after: Float[Array, "*count"],
        step: Array,
    ) -> Bool[Array, ""]:
        """Return whether a step of given length (s) resolves all contacts.

        From the displacements of the windows, and the gaps at both ends (m). The forces at the ends
        must account for the energy that the skin stores in between, so that a hit returns the
        energy that it took. And no two may move further relative to each other than halfway to
        their axes: none passes through unnoticed.
        """
        each = jax.vmap(lambda contact, window: contact.travel(window), (self.window_axes, 0))
        travel = each(self, moved)
        near = travel <= jnp.maximum(before, 0.0) + 0.5 * self.between_axes
        (stored, force), (stored_before, force_before) = map(self.press, (after, before))
        closed = before - after
        missed = 0.5 * (force + force_before) * closed - (stored - stored_before)
        hit = stored + stored_before + 0.5 * self.mass * (closed / step) ** 2
        negligible = NEGLIGIBLE_WORK * self.press(jnp.zeros_like(after))[0]
        return jnp.all(near) & jnp.all(jnp.abs(missed) <= MISSED_WORK * hit + negligible)


def closest_of_cores(
    edge: Array, core: Array, apart: Array, *, core_ease: float = 0.0
) -> tuple[Array, Array]:
    """Return the nearest points of an edge (0 to 1) and of the core of a capsule (-1 to 1).

    The minimum of a convex quadratic in a box of two (Ericson, Real-Time Collision Detection,
    2005, section 5.1.9). ``core`` is half of the core, ``apart`` the start of the edge less the
    middle of the core, ``core_ease`` the weight that draws the point to that middle.
    """
    squared, mixed = product(edge, edge), product(edge, core)
    of_core = (1 + core_ease) * product(core, core)
    of_edge = (1 + EASE) * squared
    on_edge, on_core = product(edge, apart) - 0.5 * EASE * squared, product(core, apart)
    long, whole = of_core > 0, of_edge * of_core - mixed**2
    whole = jnp.where(whole > 0, whole, 1.0)  # both may be points
    share = jnp.clip((mixed * on_core - of_core * on_edge) / whole, 0.0, 1.0)
    along = jnp.clip((on_core + mixed * share) / jnp.where(long, of_core, 1.0), -1.0, 1.0)
    of_edge = jnp.where(of_edge > 0, of_edge, 1.0)
    return jnp.clip((mixed * along - on_edge) / of_edge, 0.0, 1.0), along


def eased_direction(velocity: Float[Array, " _"]) -> Float[Array, " _"]:
    """Return the direction of a velocity (m/s), shorter than 1 where friction begins."""
    return velocity / jnp.sqrt(product(velocity, velocity) + CREEP**2)


def size(vectors: Float[Array, "*many d"]) -> Float[Array, "*many"]:
    """Return the lengths of vectors."""
    return jnp.sqrt(jnp.sum(vectors**2, axis=-1))


def rows_of(vector: Float[Array, " _"], width: int) -> Float[Array, "1 b"]:
    """Return a vector as one row of a width."""
    return jnp.pad(vector, (0, width - vector.size))[None]


def surfaces(rod: Rod) -> tuple[Float[Array, " e"], Float[Array, " e"]]:
    """Return the radius of each edge (m), and its force where surfaces meet (N)."""
    radius = rod.edge_diameter[:, 1] / 2
    # in space that of the stiffer direction
    stiffness = jnp.max(rod.EI.reshape(rod.nodes, -1), axis=1)
    modulus = 0.5 * (stiffness[1:] + stiffness[:-1]) / (jnp.pi / 4 * radius**4)
    return radius, SKIN_STRENGTH * modulus * radius**2
