"""Free bodies among the obstacles: their forces, contact with each other, and rotation."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from crinoid.dynamics.rows import SPIN
from crinoid.elements import Body, BodyContact, Motion, Pose
from crinoid.elements.element import Element

Rows = Float[Array, "rows b"]
Jacobian = Callable[[Element, Motion, Int[np.ndarray, "window k"]], Array]


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

    def residual(self, motion: Motion, pose: Pose | None) -> tuple[Rows, Float[Array, " b"]]:
        """Return minus the forces on the rows of the obstacles, without those of the arm.

        Also the largest single force in it of each column (N).
        """
        size = motion.position.shape[1]
        total, largest = jnp.zeros((2 * self.count, size)), jnp.zeros(size)
        for element, rows, window in self._laws(motion, pose):
            forces = jax.vmap(lambda e, m: e.residual(m))(element, window)
            total = total.at[rows].add(forces)
            largest = jnp.maximum(largest, jnp.max(jnp.abs(forces[:, ::2]), axis=(0, 1)))
        return total, largest

    def stiffness(
        self, motion: Motion, pose: Pose | None, jacobian: Jacobian
    ) -> Float[Array, "rows b rows b"]:
        """Return the derivative of that residual, from the Jacobians of the windows of rows."""
        size = motion.position.shape[1]
        total = jnp.zeros((2 * self.count, size, 2 * self.count, size))
        for element, rows, window in self._laws(motion, pose):
            blocks = jnp.moveaxis(jacobian(element, window, rows), 3, 2)
            total = total.at[rows[:, :, None], :, rows[:, None, :], :].add(blocks)
        return total

    def gaps(self, rows: Rows, pose: Pose | None) -> Float[Array, " pair"]:
        """Return the gap of each pair (m)."""
        gap = jax.vmap(lambda contact, window, poses: contact.gap(window, poses))
        gaps = [gap(contact, rows[at], poses) for contact, at, poses in self._touching(pose)]
        return jnp.concatenate([jnp.zeros(0), *gaps])

    @property
    def skin(self) -> Float[Array, " pair"]:
        """Thickness of the skin of each pair (m)."""
        return jnp.concatenate([jnp.zeros(0), *(contact.skin for contact in self.contacts)])

    def resolved(
        self,
        moved: Rows,
        before: Float[Array, " pair"],
        after: Float[Array, " pair"],
        step: Array,
    ) -> Bool[Array, ""]:
        """Return whether a step resolves the contacts of pairs, like those with the arm."""
        counts = np.cumsum([len(pairs) for pairs in self.pairs])[:-1]
        gaps = (jnp.split(gap, counts) for gap in (before, after))
        each = zip(self._touching(None), *gaps, strict=True) if self.contacts else ()
        found = [contact.resolved(moved[rows], *gap, step) for (contact, rows, _), *gap in each]
        return jnp.all(jnp.array(found, bool))

    def _laws(
        self, motion: Motion, pose: Pose | None
    ) -> list[tuple[Element, Int[np.ndarray, "window k"], Motion]]:
        """Return the force laws on the bodies, with the rows and the motion of their windows."""
        assert pose is not None
        size, shift = motion.position.shape[1], 2 * self.count  # obstacles are the last rows
        laws = [(self.body, self.own_rows, pose.of(self.own_rows[:, 0])), *self._touching(pose)]
        return [
            (
                law,
                rows,
                motion.windows(
                    lambda each, at=rows - shift: each[at], rows.shape[:1], size
                ).remembering(poses, None),
            )
            for law, rows, poses in laws
        ]

    def _touching(
        self, pose: Pose | None
    ) -> list[tuple[BodyContact, Int[np.ndarray, "pair 4"], tuple[Pose, Pose] | None]]:
        """Return the contacts, the rows of their windows, and the poses of both bodies."""
        found = []
        for contact, pairs in zip(self.contacts, self.pairs, strict=True):
            first, second = np.array(pairs, int).T
            poses = None if pose is None else (pose.of(first), pose.of(second))
            rows = [first, first + self.count, second, second + self.count]
            found.append((contact, np.stack(rows, axis=1), poses))
        return found
