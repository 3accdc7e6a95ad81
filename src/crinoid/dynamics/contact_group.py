"""Contacts on windows of rows: gaps, forces, and whether a step resolves them."""

from typing import Any

from jaxtyping import Array, Bool, Float

from crinoid.dynamics.rows import Rows
from crinoid.dynamics.windows import LawGroup, remembering
from crinoid.elements import Motion, SoftSkin
from crinoid.numerics import index_array

Gaps = Float[Array, " w"]


class ContactGroup(LawGroup):
    """Contact on windows of rows. Its memory is the attitude of bodies, where some turn."""

    @staticmethod
    def of(contact: Any, index: index_array.Index, pose: Any) -> "ContactGroup":
        """Return a contact on the windows of an index array; ``pose`` has theirs, if any."""
        return ContactGroup(((contact, (pose, None)),), index)

    @property
    def contact(self) -> SoftSkin:
        """Contact of each window."""
        ((contact, _),) = self.laws
        assert isinstance(contact, SoftSkin)
        return contact

    def gaps(self, rows: Rows) -> Gaps:
        """Return the distance of the surfaces in each window (m)."""

        def gap(laws: Any, window: Rows) -> Array:
            ((contact, (pose, _)),) = laws
            return contact.gap(window, pose)

        return self.each(gap, index_array.gather(rows, self.index))

    def push(self, motion: Motion) -> tuple[Gaps, Float[Array, "w k b"]]:
        """Return the gaps (m), and the forces on the rows of each window (N), of obstacles."""

        def push(laws: Any, window: Motion) -> tuple[Array, Array]:
            ((contact, held),) = laws
            return contact.push(remembering(window, held))

        return self.each(push, self.windows(motion))

    def resolved(self, moved: Rows, before: Gaps, after: Gaps, step: Array) -> Bool[Array, ""]:
        """Return whether a step resolves its contacts, from the displacements and both gaps (m)."""
        return self.contact.resolved(index_array.gather(moved, self.index), before, after, step)
