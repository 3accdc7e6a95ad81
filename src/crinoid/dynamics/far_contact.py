"""Contact of edges with parts far from them along the arm: forces, and part of the tangent."""

from abc import abstractmethod
from collections.abc import Callable
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from crinoid.elements import HullContact, Motion, SelfContact, VehiclePose

Rows = Float[Array, "rows b"]
Windows = tuple[SelfContact | HullContact, Int[Array, "near k"], Motion]

NODES = 4
"""Rows of a window that are nodes of the arm; the others follow from a vehicle."""


class FarContact(eqx.Module):
    """Contact that couples nodes beyond the bands of the tangent.

    It acts on windows of nodes.
    """

    contact: eqx.AbstractVar[SelfContact | HullContact]
    """Contact of each window."""
    first_row: ClassVar[int] = 0
    """First row whose forces measure the balance."""

    @property
    @abstractmethod
    def nodes(self) -> Int[np.ndarray, "w k"]:
        """Rows of each window."""

    @property
    def finest(self) -> Float[Array, ""]:
        """Smallest distance between two axes in contact (m)."""
        return jnp.min(self.contact.between_axes)

    @abstractmethod
    def touch(self, motion: Motion, pose: VehiclePose | None) -> Any:
        """Return the contact of each edge; ``pose`` is that of a floating vehicle."""

    def gaps(self, rows: Rows, pose: VehiclePose | None) -> Float[Array, " w"]:
        """Return the gap of each window, or lower bounds where none presses (m)."""
        return self.distances(rows, pose)

    def distances(self, rows: Rows, pose: VehiclePose | None) -> Float[Array, " w"]:
        """Return the gap of each window (m)."""
        gap = jax.vmap(lambda contact, place: contact.gap(place, pose))
        return gap(self.contact, rows[self.nodes])

    def push(self, motion: Motion, pose: VehiclePose | None) -> Rows:
        """Return the forces on all rows (N)."""

        def pushed() -> Rows:
            contact, nodes, window = self.nearest(motion, pose, gaps)
            forces = jax.vmap(lambda one, there: one.forces(there))(contact, window)
            return jnp.zeros_like(motion.position).at[nodes[:, :NODES]].add(forces[:, :NODES])

        gaps = self._still_gaps(motion, pose)
        return self._where_pressing(gaps, pushed)

    def stiffness(
        self,
        motion: Motion,
        pose: VehiclePose | None,
        jacobian: Callable[[SelfContact | HullContact, Motion], Array],
        num_nodes: int,
    ) -> Float[Array, "n b n b"]:
        """Return the derivative of the residuals by the nodes, from the Jacobian of a window."""
        size = motion.position.shape[1]

        def stiff() -> Float[Array, "n b n b"]:
            contact, nodes, window = self.nearest(motion, pose, gaps)
            blocks = jnp.moveaxis(jax.vmap(jacobian)(contact, window), 3, 2)
            none, at = jnp.zeros((num_nodes, size, num_nodes, size)), nodes[:, :NODES]
            return none.at[at[:, :, None], :, at[:, None, :]].add(blocks[:, :NODES, :NODES])

        gaps = self._still_gaps(motion, pose)
        return self._where_pressing(gaps, stiff)

    def resolved(
        self, moved: Rows, before: Float[Array, " w"], after: Float[Array, " w"], step: Array
    ) -> Bool[Array, ""]:
        """Return whether a step resolves its contacts, from the displacements and both gaps (m)."""
        return self.contact.resolved(moved[self.nodes], before, after, step)

    def nearest(
        self, motion: Motion, pose: VehiclePose | None, gaps: Float[Array, " w"]
    ) -> Windows:
        """Return the windows with a force, at most: contacts, rows and motion."""
        contact, nodes = self.pressing(gaps)
        count, width = nodes.shape[:1], motion.position.shape[1]
        memory = jax.tree.map(lambda x: jnp.broadcast_to(x, (*count, *x.shape)), pose)
        window = motion.windows(lambda rows: rows[nodes], count, width)
        return contact, nodes, window.remembering(memory, None)

    def pressing(
        self, gaps: Float[Array, " w"]
    ) -> tuple[SelfContact | HullContact, Int[Array, "near k"]]:
        """Return contacts and rows of windows, at least of all with a force, by the gaps (m)."""
        return self.contact, jnp.asarray(self.nodes)

    def _still_gaps(self, motion: Motion, pose: VehiclePose | None) -> Float[Array, " w"]:
        """Return the gaps by which windows are chosen, without derivative."""
        return self.gaps(jax.lax.stop_gradient(motion.position), pose)

    def _where_pressing(self, gaps: Float[Array, " w"], of: Callable[[], Array]) -> Array:
        """Return an array of the windows in contact; zero, at no cost, while there are none."""
        pressing = jnp.any(gaps < self.contact.skin)
        return jax.lax.cond(pressing, of, lambda: jnp.zeros_like(jax.eval_shape(of)))
