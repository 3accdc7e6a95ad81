"""Contact of edges with parts far from them along the arm."""

from abc import abstractmethod
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from crinoid.dynamics.contact_group import ContactGroup
from crinoid.dynamics.rows import Rows
from crinoid.elements import HullContact, Motion, SelfContact, VehiclePose
from crinoid.numerics.index_array import Index

NODES = 4
"""Rows of a window that are nodes of the arm; the others follow from a vehicle."""


class FarContact(eqx.Module):
    """Contact that couples nodes beyond the bands of the tangent."""

    contact: eqx.AbstractVar[SelfContact | HullContact]
    """Contact of each window."""

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

    def group(self, pose: VehiclePose | None) -> ContactGroup:
        """Return the contacts on all windows."""
        return self.on(self.nodes, self.contact, pose)

    @staticmethod
    def on(
        index: Index, contact: SelfContact | HullContact, pose: VehiclePose | None
    ) -> ContactGroup:
        """Return contacts on the windows of an index array, on a vehicle with a pose."""
        count = index.shape[:1]
        every = jax.tree.map(lambda x: jnp.broadcast_to(x, (*count, *x.shape)), pose)
        return ContactGroup.of(contact, index, every)

    def gaps(self, rows: Rows, pose: VehiclePose | None) -> Float[Array, " w"]:
        """Return the gap of each window, or lower bounds where none presses (m)."""
        return self.group(pose).gaps(rows)

    def push(self, motion: Motion, pose: VehiclePose | None) -> Rows:
        """Return the forces on all rows (N)."""

        def pushed(group: ContactGroup) -> Rows:
            return -group.scatter(group.residuals(motion)[:, 0], motion.position.shape)

        return self.where_pressing(motion, pose, pushed)

    def resolved(
        self, moved: Rows, before: Float[Array, " w"], after: Float[Array, " w"], step: Array
    ) -> Bool[Array, ""]:
        """Return whether a step resolves its contacts, from the displacements and both gaps (m)."""
        return self.group(None).resolved(moved, before, after, step)

    def nearest(self, gaps: Float[Array, " w"], pose: VehiclePose | None) -> ContactGroup:
        """Return the contacts on at least all windows with a force, by the gaps (m)."""
        return self.group(pose)

    def where_pressing(
        self, motion: Motion, pose: VehiclePose | None, of: Callable[[ContactGroup], Any]
    ) -> Any:
        """Return arrays ``of`` the windows in contact; zero, at no cost, while there are none."""
        gaps = self.gaps(jax.lax.stop_gradient(motion.position), pose)

        def found() -> Any:
            return of(self.nearest(gaps, pose))

        def none() -> Any:
            return jax.tree.map(jnp.zeros_like, jax.eval_shape(found))

        return jax.lax.cond(jnp.any(gaps < self.contact.skin), found, none)
