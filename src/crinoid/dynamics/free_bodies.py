"""Free bodies among the obstacles: their forces, contact with each other, and rotation."""

from collections.abc import Callable
from dataclasses import replace

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
    pose: Pose
    """Attitude of all obstacles at the start of a step; unturned they have the world's axes."""
    spin: Float[Array, "m turns"]
    """Initial angular velocity of all obstacles (rad/s)."""
    contact: BodyContact | None = None
    """Contact of each pair, if there are any."""
    pairs: tuple[tuple[int, int], ...] = eqx.field(static=True, default=())
    """Obstacles of each pair."""

    @property
    def count(self) -> int:
        """Number of all obstacles."""
        return self.spin.shape[0]

    @property
    def own_rows(self) -> Int[np.ndarray, "f 2"]:
        """Both rows of each free body, among those of the obstacles."""
        index = np.array(self.index, int)
        return np.stack([index, index + self.count], axis=1)

    @property
    def pair_rows(self) -> Int[np.ndarray, "pair 4"]:
        """Both rows of both obstacles of each pair."""
        first, second = np.array(self.pairs, int).reshape(-1, 2).T
        return np.stack([first, first + self.count, second, second + self.count], axis=1)

    def unknowns(self, size: int) -> tuple[int, ...]:
        """Return the indices of their unknowns among the flattened rows of ``size`` numbers."""
        axes, turns = (2, 1) if size == 2 else (SPIN, 3)
        return tuple(
            int(size * row + i)
            for place, turn in self.own_rows
            for row, count in ((place, axes), (turn, turns))
            for i in range(count)
        )

    def attitude(self, rows: Rows) -> Float[Array, "m d d"]:
        """Return the attitude of all obstacles for their rows."""
        return jax.vmap(lambda pose, row: pose.attitude_at(row))(self.pose, rows[self.count :])

    @property
    def elements(self) -> list[tuple[Element, Int[np.ndarray, "window k"]]]:
        """Force laws on the bodies with their attitudes, and the rows of their windows."""
        index = np.array(self.index, int)
        body = replace(self.body, pose=self._poses(index))
        found: list[tuple[Element, Int[np.ndarray, "window k"]]] = [(body, self.own_rows)]
        if self.contact is not None:
            found.append((self._posed_contact(), self.pair_rows))
        return found

    def residual(self, motion: Motion) -> tuple[Rows, Float[Array, " b"]]:
        """Return minus the forces on the rows of the obstacles, without those of the arm.

        Also the largest single force in it of each column (N).
        """
        size = motion.position.shape[1]
        total, largest = jnp.zeros((2 * self.count, size)), jnp.zeros(size)
        for element, rows in self.elements:
            forces = jax.vmap(lambda e, m: e.residual(m))(element, self._windows(motion, rows))
            total = total.at[rows].add(forces)
            largest = jnp.maximum(largest, jnp.max(jnp.abs(forces[:, ::2]), axis=(0, 1)))
        return total, largest

    def stiffness(self, motion: Motion, jacobian: Jacobian) -> Float[Array, "rows b rows b"]:
        """Return the derivative of that residual, from the Jacobians of the windows of rows."""
        size = motion.position.shape[1]
        total = jnp.zeros((2 * self.count, size, 2 * self.count, size))
        for element, rows in self.elements:
            blocks = jnp.moveaxis(jacobian(element, self._windows(motion, rows), rows), 3, 2)
            total = total.at[rows[:, :, None], :, rows[:, None, :], :].add(blocks)
        return total

    def gaps(self, rows: Rows) -> Float[Array, " pair"]:
        """Return the gap of each pair (m)."""
        if self.contact is None:
            return jnp.zeros(0)
        gap = jax.vmap(lambda contact, window: contact.gap(window))
        return gap(self._posed_contact(), rows[self.pair_rows])

    def resolved(
        self,
        moved: Rows,
        before: Float[Array, " pair"],
        after: Float[Array, " pair"],
        step: Array,
    ) -> Bool[Array, ""]:
        """Return whether a step resolves the contacts of pairs, like those with the arm."""
        contact = self.contact
        if contact is None:
            return jnp.asarray(True)
        windows = moved[self.pair_rows]
        axes = contact.axes
        travel = _size(windows[:, 0, :axes] - windows[:, 2, :axes])
        travel += _size(windows[:, 1]) * _size(contact.end)
        travel += _size(windows[:, 3]) * _size(contact.half_axis)
        room = jnp.maximum(before, 0.0) + 0.5 * (contact.arm_radius + contact.radius)
        return jnp.all(contact.accounted(before, after, step)) & jnp.all(travel <= room)

    def _posed_contact(self) -> BodyContact:
        assert self.contact is not None
        first, second = np.array(self.pairs, int).reshape(-1, 2).T
        return replace(self.contact, carrier=self._poses(first), pose=self._poses(second))

    def _poses(self, index: Int[np.ndarray, " each"]) -> Pose:
        return Pose(self.pose.attitude[index], self.pose.turn[index])

    def _windows(self, motion: Motion, rows: Int[np.ndarray, "window k"]) -> Motion:
        # the obstacles are the last rows of the motion
        return motion.windows(
            lambda each: each[rows - 2 * self.count], rows.shape[:1], motion.position.shape[1]
        )


def _size(vectors: Float[Array, "pair d"]) -> Float[Array, " pair"]:
    return jnp.sqrt(jnp.sum(vectors**2, axis=-1))
