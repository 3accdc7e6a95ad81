"""Contact of edges with parts far from them along the arm: forces, and part of the tangent."""

from abc import abstractmethod
from collections.abc import Callable
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from crinoid.elements import HullContact, Motion, SelfContact

Rows = Float[Array, "rows b"]
Windows = tuple[SelfContact | HullContact, Int[Array, "w k"], Motion]

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
    def touch(self, motion: Motion) -> Any:
        """Return the contact of each edge."""

    def turned(self, attitude: Float[Array, "d d"] | None) -> "FarContact":
        """Return the contact at an attitude of the vehicle."""
        return self

    def placed(self, motion: Motion) -> Motion:
        """Return a motion with all rows of the windows."""
        return motion

    def positions(self, rows: Rows) -> Float[Array, "more b"]:
        """Return positions with all rows of the windows."""
        return rows

    def gaps(self, rows: Rows, axes: int) -> Float[Array, " w"]:
        """Return the gap of each window, or lower bounds where none presses (m)."""
        return self.distances(rows, axes)

    def distances(self, rows: Rows, axes: int) -> Float[Array, " w"]:
        """Return the gap of each window (m)."""
        places = self.positions(rows)[self.nodes, :axes]
        return jax.vmap(lambda contact, place: contact.gap(place))(self.contact, places)

    def push(self, motion: Motion) -> Rows:
        """Return the forces on all rows (N)."""

        def pushed() -> Rows:
            contact, nodes, window = self.nearest(motion, gaps)
            forces = jax.vmap(lambda one, there: one.forces(there))(contact, window)
            return jnp.zeros_like(motion.position).at[nodes[:, :NODES]].add(forces[:, :NODES])

        gaps = self._still_gaps(motion)
        return self._where_pressing(gaps, pushed)

    def stiffness(
        self,
        motion: Motion,
        jacobian: Callable[[SelfContact | HullContact, Motion], Array],
        num_nodes: int,
    ) -> Float[Array, "n b n b"]:
        """Return the derivative of the residuals by the nodes, from the Jacobian of a window."""
        size = motion.position.shape[1]

        def stiff() -> Float[Array, "n b n b"]:
            contact, nodes, window = self.nearest(motion, gaps)
            blocks = jnp.moveaxis(jax.vmap(jacobian)(contact, window), 3, 2)
            none, at = jnp.zeros((num_nodes, size, num_nodes, size)), nodes[:, :NODES]
            return none.at[at[:, :, None], :, at[:, None, :]].add(blocks[:, :NODES, :NODES])

        gaps = self._still_gaps(motion)
        return self._where_pressing(gaps, stiff)

    def resolved(
        self, moved: Rows, before: Float[Array, " w"], after: Float[Array, " w"], step: Array
    ) -> Bool[Array, ""]:
        """Return whether a step resolves its contacts, from the displacements and both gaps (m)."""
        return self.contact.resolved(moved[self.nodes], before, after, step)

    def nearest(self, motion: Motion, gaps: Float[Array, " w"]) -> Windows:
        """Return the windows with a force, at most: contacts, rows and motion."""
        return self.windows(motion, self.contact, jnp.asarray(self.nodes))

    def windows(
        self, motion: Motion, contact: SelfContact | HullContact, nodes: Int[Array, "w k"]
    ) -> Windows:
        """Return contacts, rows and motion of some windows."""
        width = motion.position.shape[1]
        moving = self.placed(motion).windows(lambda rows: rows[nodes], nodes.shape[:1], width)
        return contact, nodes, moving

    def _still_gaps(self, motion: Motion) -> Float[Array, " w"]:
        """Return the gaps by which windows are chosen, without derivative."""
        axes = motion.flow_velocity.shape[-1]
        return self.gaps(jax.lax.stop_gradient(motion.position), axes)

    def _where_pressing(self, gaps: Float[Array, " w"], of: Callable[[], Array]) -> Array:
        """Return an array of the windows in contact; zero, at no cost, while there are none."""
        pressing = jnp.any(gaps < self.contact.skin)
        return jax.lax.cond(pressing, of, lambda: jnp.zeros_like(jax.eval_shape(of)))
