"""Contact of the arm with itself: pairs of edges that are far from each other along it."""
# ruff: noqa: D102  # the base class documents its methods

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from crinoid.dynamics.contact_group import ContactGroup
from crinoid.dynamics.far_contact import FarContact
from crinoid.dynamics.rows import ROOT, Rows
from crinoid.elements import Motion, SelfContact, VehiclePose
from crinoid.foundation.fixed_numbers import CANDIDATES
from crinoid.rod import Rod


class SelfTouch(eqx.Module):
    """Contact of the edges of an arm with far edges. SI units."""

    gap: Float[Array, "*t e"]
    """Distance of each edge's surface from that of the nearest far edge (m)."""
    force: Float[Array, "*t e d"]
    """Force of far edges on each edge (N)."""
    pairs: Int[Array, "*t"]
    """Number of pairs that press on each other."""


class FarEdges(FarContact):
    """Pairs of edges that can touch, because the arm between them is long enough to turn back.

    Forces and their derivatives are those of the nearest pairs, a fixed number, so that the program
    has static shapes.
    """

    contact: SelfContact
    """Contact of each pair."""
    beyond: tuple[int, ...] = eqx.field(static=True)
    """First far edge ahead of each edge."""

    @staticmethod
    def of(rod: Rod, beyond: tuple[int, ...], friction: Float[Array, ""]) -> "FarEdges":
        """Pair the far edges of a rod."""
        return FarEdges(SelfContact.of(rod, jnp.asarray(_pairs(beyond)), friction), beyond)

    @property
    def edges(self) -> Int[np.ndarray, "pair 2"]:
        """Indices of the two edges of each pair."""
        return _pairs(self.beyond)

    @property
    def nodes(self) -> Int[np.ndarray, "pair 4"]:
        """Rows of the nodes of each pair."""
        near = self.edges + ROOT
        return np.stack([near, near + 1], axis=2).reshape(-1, 4)

    @property
    def most(self) -> int:
        """Largest number of pairs with a force."""
        return min(len(self.nodes), CANDIDATES * len(self.beyond))

    def gaps(self, rows: Rows, pose: VehiclePose | None) -> Float[Array, " pair"]:
        nodes = rows[ROOT : ROOT + len(self.beyond) + 1, :3]
        middle, edge = 0.5 * (nodes[1:] + nodes[:-1]), nodes[1:] - nodes[:-1]
        reach = 0.5 * jnp.sqrt(jnp.sum(edge**2, axis=1))
        one, other = self.edges.T
        apart = jnp.sum((middle[one] - middle[other]) ** 2, axis=1)
        # by the balls around both: cheap, and nearly always enough
        within = reach[one] + reach[other] + self.contact.between_axes
        bound = jnp.sqrt(apart + jnp.finfo(float).tiny) - within
        near = jnp.any(bound < self.contact.skin)
        return jax.lax.cond(near, lambda: self.group(pose).gaps(rows), lambda: bound)

    def touch(self, motion: Motion, pose: VehiclePose | None) -> SelfTouch:
        axes, count = motion.flow_velocity.shape[-1], len(self.beyond)
        gaps, edges = self.group(pose).gaps(motion.position), jnp.asarray(self.edges)
        gap = jnp.full(count, jnp.inf).at[edges].min(gaps[:, None])
        group = self.nearest(gaps, pose)
        forces = -group.residuals(motion)[:, 0, :, :axes]
        on_edges = jnp.sum(forces.reshape(-1, 2, 2, axes), axis=2)
        force = jnp.zeros((count, axes)).at[group.index[:, ::2] - ROOT].add(on_edges)
        return SelfTouch(gap, force, jnp.sum(gaps < self.contact.skin))

    def resolved(
        self, moved: Rows, before: Float[Array, " pair"], after: Float[Array, " pair"], step: Array
    ) -> Bool[Array, ""]:
        nodes = moved[ROOT : ROOT + len(self.beyond) + 1, :3]
        farthest = 2 * jnp.sqrt(jnp.max(jnp.sum((nodes - nodes[0]) ** 2, axis=1)))
        apart = jnp.minimum(before, after) > self.contact.skin
        room = before + 0.5 * self.contact.between_axes
        still, exactly = jnp.all(apart & (farthest <= room)), super().resolved
        return jax.lax.cond(still, lambda: still, lambda: exactly(moved, before, after, step))

    def nearest(self, gaps: Float[Array, " pair"], pose: VehiclePose | None) -> ContactGroup:
        if self.most == len(self.nodes):
            return self.group(pose)
        _, at = jax.lax.top_k(-gaps, self.most)
        contact = jax.tree.map(lambda values: values[at], self.contact)
        return self.on(jnp.asarray(self.nodes)[at], contact, pose)


def _pairs(beyond: tuple[int, ...]) -> Int[np.ndarray, "pair 2"]:
    """Return all pairs of an edge with a far edge ahead of it."""
    return np.array(
        [(i, j) for i, first in enumerate(beyond) for j in range(first, len(beyond))], int
    ).reshape(-1, 2)


def far_edges(lengths: Float[np.ndarray, " e"], radii: Float[np.ndarray, " e"]) -> tuple[int, ...]:
    """Return the first far edge ahead of each edge, from the edges' lengths and radii (m).

    Between two far edges the arm is at least as long as half a circle whose diameter is that of the
    arm: it can turn back there without being bent more than its thickness lets it.
    """
    ends = np.cumsum(lengths)
    starts = ends - lengths
    found = []
    for i, end in enumerate(ends):
        far = starts - end >= 0.5 * np.pi * (radii[i] + radii)
        far[: i + 2] = False
        found.append(int(np.argmax(far)) if far.any() else len(ends))
    return tuple(found)
