"""Contact of the arm with itself: its forces and its part of the tangent."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from crinoid.dynamics.rows import ROOT
from crinoid.elements import Motion, SelfContact
from crinoid.rod import Rod

Rows = Float[Array, "rows b"]

CANDIDATES = 2
"""Number of pairs that may press at the same time, for each edge."""


class SelfTouch(eqx.Module):
    """Contact of the edges of an arm with far edges. SI units."""

    gap: Float[Array, "*t e"]
    """Distance of each edge's surface from that of the nearest far edge (m)."""
    force: Float[Array, "*t e d"]
    """Force of far edges on each edge (N)."""
    pairs: Int[Array, "*t"]
    """Number of pairs that press on each other."""


class FarEdges(eqx.Module):
    """Pairs of edges that can touch, because the arm between them is long enough to turn back.

    All gaps are known at any time. Forces and their derivatives are those of the nearest pairs,
    a fixed number, so that the program has static shapes.
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
    def finest(self) -> Float[Array, ""]:
        """Smallest distance between two axes in contact (m)."""
        return jnp.min(jnp.sum(self.contact.radii, axis=1))

    @property
    def most(self) -> int:
        """Largest number of pairs with a force."""
        return min(len(self.nodes), CANDIDATES * len(self.beyond))

    def gaps(self, rows: Rows, axes: int) -> Float[Array, " pair"]:
        """Return the gap of each pair (m)."""
        places = rows[self.nodes, :axes]
        return jax.vmap(lambda contact, place: contact.gap(place))(self.contact, places)

    def push(self, motion: Motion) -> Rows:
        """Return the forces on all rows (N)."""

        def pushed() -> Rows:
            contact, nodes, window = self._nearest(motion, gaps)
            forces = jax.vmap(lambda one, there: one.forces(there))(contact, window)
            return jnp.zeros_like(motion.position).at[nodes].add(forces)

        gaps = self._still_gaps(motion)
        return self._where_pressing(gaps, pushed)

    def stiffness(
        self, motion: Motion, jacobian: Callable[[SelfContact, Motion], Array], num_nodes: int
    ) -> Float[Array, "n b n b"]:
        """Return the derivative of the residuals, from the Jacobian of a pair."""
        size = motion.position.shape[1]

        def stiff() -> Float[Array, "n b n b"]:
            contact, nodes, window = self._nearest(motion, gaps)
            blocks = jnp.moveaxis(jax.vmap(jacobian)(contact, window), 3, 2)
            none = jnp.zeros((num_nodes, size, num_nodes, size))
            return none.at[nodes[:, :, None], :, nodes[:, None, :]].add(blocks)

        gaps = self._still_gaps(motion)
        return self._where_pressing(gaps, stiff)

    def touch(self, motion: Motion, gaps: Float[Array, " pair"]) -> SelfTouch:
        """Return gap and force of each edge, given the ``gaps`` of the pairs (m)."""
        axes, count = motion.flow_velocity.shape[-1], len(self.beyond)
        edges = jnp.asarray(self.edges)
        gap = jnp.full(count, jnp.inf).at[edges].min(gaps[:, None])
        contact, nodes, window = self._nearest(motion, gaps)
        forces = jax.vmap(lambda one, there: one.forces(there))(contact, window)
        on_edges = jnp.sum(forces[..., :axes].reshape(-1, 2, 2, axes), axis=2)
        force = jnp.zeros((count, axes)).at[nodes[:, ::2] - ROOT].add(on_edges)
        return SelfTouch(gap, force, jnp.sum(gaps < self.contact.skin))

    def resolved(
        self, moved: Rows, before: Float[Array, " pair"], after: Float[Array, " pair"], step: Array
    ) -> Bool[Array, ""]:
        """Return whether a step resolves its contacts, from the displacements and both gaps (m).

        As `crinoid.dynamics.Obstacles.resolved`.
        """
        ends = moved[self.nodes]
        apart = ends[:, :2, None] - ends[:, None, 2:]
        travel = jnp.max(jnp.sum(apart**2, axis=-1), axis=(1, 2))
        room = jnp.maximum(before, 0.0) + 0.5 * jnp.sum(self.contact.radii, axis=1)
        return jnp.all(self.contact.accounted(before, after, step)) & jnp.all(travel <= room**2)

    def _still_gaps(self, motion: Motion) -> Float[Array, " pair"]:
        """Return the gaps by which pairs are chosen, without derivative."""
        axes = motion.flow_velocity.shape[-1]
        return self.gaps(jax.lax.stop_gradient(motion.position), axes)

    def _where_pressing(self, gaps: Float[Array, " pair"], of: Callable[[], Array]) -> Array:
        """Return an array of the pairs in contact; zero, at no cost, while there are none."""
        pressing = jnp.any(gaps < self.contact.skin)
        return jax.lax.cond(pressing, of, lambda: jnp.zeros_like(jax.eval_shape(of)))

    def _nearest(
        self, motion: Motion, gaps: Float[Array, " pair"]
    ) -> tuple[SelfContact, Int[Array, "k 4"], Motion]:
        """Return the nearest pairs: their contacts, the rows of their nodes, and their motion."""
        contact, nodes = self.contact, jnp.asarray(self.nodes)
        if self.most < len(nodes):
            _, at = jax.lax.top_k(-gaps, self.most)
            contact, nodes = jax.tree.map(lambda values: values[at], (contact, nodes))
        window = motion.windows(lambda rows: rows[nodes], nodes.shape[:1], motion.position.shape[1])
        return contact, nodes, window


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
