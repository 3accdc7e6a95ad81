"""Free bodies among the obstacles: their forces, and contact with each other."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from crinoid.dynamics.contact_group import ContactGroup
from crinoid.dynamics.rows import SPIN
from crinoid.dynamics.windows import LawGroup
from crinoid.elements import Body, BodyContact, Pose


class FreeBodies(eqx.Module):
    """Free bodies among ``m`` obstacles, and the pairs of these that can touch each other.

    Their arrays are those of the obstacles: ``m`` rows of positions, then as many of rotations,
    which are zero where the motion is prescribed.
    """

    index: tuple[int, ...] = eqx.field(static=True)
    """Which obstacles are free."""
    body: Body
    """Inertia, weight and drag of each."""
    spin: Float[Array, "m turns"]
    """Initial angular velocity of all obstacles (rad/s)."""
    contacts: tuple[BodyContact, ...] = ()
    """Contacts of pairs: of all with round bodies and planes at once, and one by one of those with
    a surface from a file."""
    pairs: tuple[tuple[tuple[int, int], ...], ...] = eqx.field(static=True, default=())
    """Obstacles of each pair of each contact."""

    @property
    def count(self) -> int:
        """Number of all obstacles."""
        return self.spin.shape[0]

    @property
    def own_rows(self) -> Int[np.ndarray, "f 2"]:
        """Both rows of each free body, among those of the obstacles."""
        index = np.array(self.index, int)
        return np.stack([index, index + self.count], axis=1)

    def unknowns(self, size: int) -> tuple[int, ...]:
        """Return the indices of their unknowns among the flattened rows of ``size`` numbers."""
        axes, turns = (2, 1) if size == 2 else (SPIN, 3)
        return tuple(
            int(size * row + i)
            for place, turn in self.own_rows
            for row, count in ((place, axes), (turn, turns))
            for i in range(count)
        )

    def law(self, num_nodes: int, pose: Pose) -> LawGroup:
        """Return inertia, weight and drag of the bodies on their rows."""
        held = pose.of(self.own_rows[:, 0]), None
        return LawGroup(((self.body, held),), num_nodes + self.own_rows)

    def groups(self, num_nodes: int, pose: Pose) -> list[ContactGroup]:
        """Return the contacts of the pairs; ``pose`` has the attitudes of all obstacles."""

        def group(contact: BodyContact, pairs: tuple[tuple[int, int], ...]) -> ContactGroup:
            first, second = np.array(pairs, int).T
            rows = first, first + self.count, second, second + self.count
            index = num_nodes + np.stack(rows, axis=1)
            return ContactGroup.of(contact, index, (pose.of(first), pose.of(second)))

        return [group(*each) for each in zip(self.contacts, self.pairs, strict=True)]

    def by_contact(self, gap: Float[Array, " pair"]) -> list[Float[Array, " w"]]:
        """Return the gaps of each contact (m)."""
        counts = np.cumsum([len(pairs) for pairs in self.pairs])[:-1]
        return jnp.split(gap, counts) if self.pairs else []

    @property
    def skin(self) -> Float[Array, " pair"]:
        """Thickness of the skin of each pair (m)."""
        return jnp.concatenate([jnp.zeros(0), *(contact.skin for contact in self.contacts)])
