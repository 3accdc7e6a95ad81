"""Obstacles: rigid bodies near the arm, their motion and their contact with it."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from crinoid.dynamics.bordered import Border
from crinoid.dynamics.free_bodies import FreeBodies
from crinoid.elements import Contact, Motion, Pose, Surface, SurfaceContact
from crinoid.numerics import banded

Rows = Float[Array, "rows b"]
Points = Float[Array, "m d"]


class Touch(eqx.Module):
    """Contact of ``m`` obstacles with the arm, now and since the start. SI units."""

    force: Float[Array, "m d"]
    """Force of each obstacle on the arm (N)."""
    in_contact: Bool[Array, " m"]
    impulse: Float[Array, "m d"]
    """Impulse of each obstacle on the arm since the start (N s)."""
    duration: Float[Array, " m"]
    """Duration of contact since the start (s)."""
    closest: Float[Array, " m"]
    """Smallest distance from the arm since the start (m)."""

    def since(self, before: "Touch", step: Array) -> "Touch":
        """Return the contact with the sums up to a step added."""
        return Touch(
            self.force,
            self.in_contact,
            before.impulse + 0.5 * step * (before.force + self.force),
            before.duration + jnp.where(self.in_contact, step, 0.0),
            jnp.minimum(before.closest, self.closest),
        )


class Obstacles(eqx.Module):
    """``m`` obstacles, the rows after the nodes.

    Most have a prescribed motion: a steady velocity, which may be zero, or that of the water. Those
    with a mass are free: the arm, other obstacles, the water and their weight move and turn them.
    Then a row for the rotation of each obstacle follows.
    """

    contact: Contact
    """Contact of every obstacle with every edge, obstacle by obstacle."""
    bodies: FreeBodies | None
    """The free obstacles, if there are any."""
    position: Float[Array, "m d"]
    """Position at the start (m)."""
    drift: Float[Array, "m d"]
    """Steady velocity, of free obstacles the initial one (m/s)."""
    carried: tuple[int, ...] = eqx.field(static=True)
    """Obstacles that start with the water's velocity, and keep it unless they are free."""
    surfaces: tuple[Surface | None, ...] = ()
    """Surfaces about the positions of obstacles, None of a round one or a plane; may be empty."""

    @property
    def count(self) -> int:
        """Number of obstacles."""
        return self.position.shape[0]

    @property
    def free(self) -> tuple[int, ...]:
        """Indices of the obstacles that are free."""
        return () if self.bodies is None else self.bodies.index

    @property
    def rows(self) -> int:
        """Number of their rows."""
        return self.count if self.bodies is None else 2 * self.count

    @property
    def half_axis(self) -> Float[Array, "m d"]:
        """Half of the core of each obstacle, in its axes (m)."""
        edges = self.contact.radius.shape[0] // self.count
        return self.contact.half_axis[::edges]

    @property
    def finest(self) -> Float[Array, ""]:
        """Smallest distance between the axes of an obstacle and the arm in contact (m).

        That of a tool's ball is over its largest displacement, of a node by 1.
        """
        contact, reach = self.contact, self.contact.between_axes
        if contact.beyond is not None:
            reach = reach / (1 + 2 * contact.beyond / contact.rest_length)
        return jnp.min(reach)

    @property
    def prescribed(self) -> np.ndarray:
        """Indices of the obstacles with a prescribed motion."""
        return np.setdiff1d(np.arange(self.count), self.free)

    def begin(self, points: Points, velocity: Callable[[Points], Points]) -> Points:
        """Return the initial velocities of the obstacles; ``velocity`` is the water's."""
        if not self.carried:
            return self.drift
        at = jnp.asarray(self.carried)
        return self.drift.at[at].set(velocity(points[at]), unique_indices=True)

    def prescribed_motion(
        self,
        position: Points,
        flow_velocity: Points,
        velocity: Callable[[Points], Points],
        step: Array,
    ) -> tuple[Points, Points]:
        """Return positions and velocities of the obstacles after a step, as if none were free.

        Obstacles carried by the water move with the mean of its velocities at both ends of the step
        (Heun's method); ``velocity`` is that at the end, by position.
        """
        end = position + step * self.drift
        at = np.setdiff1d(self.carried, self.free).astype(int)
        if not at.size:
            return end, self.drift
        start, initial = position[at], flow_velocity[at]
        reached = start + 0.5 * step * (initial + velocity(start + step * initial))
        return (
            end.at[at].set(reached, unique_indices=True),
            self.drift.at[at].set(velocity(reached), unique_indices=True),
        )

    def push(self, motion: Motion, pose: Pose | None) -> tuple[Float[Array, "m e"], Rows]:
        """Return the distance of obstacles from edges (m), and the forces on all rows (N).

        ``pose`` has their attitudes at the start of the step, where some are free.
        """
        gap, forces = self.each(Contact.push, self.motions(motion, pose))
        rows = self.scatter(forces, motion.position.shape[0])
        return gap.reshape(self.count, -1), rows

    def touch(self, motion: Motion, pose: Pose | None) -> tuple[Touch, Float[Array, "n b"]]:
        """Return the present contact, and the forces on the nodes (N).

        In space the last column has the torques about the edges that end there (N m).
        """
        gap, rows = self.push(motion, pose)
        force = -rows[-self.rows :][: self.count, : self.contact.axes]
        none = jnp.zeros(self.count)
        closest = jnp.min(gap, axis=1)
        touching = jnp.any(self.touching(gap), axis=1)
        return Touch(force, touching, 0.0 * force, none, closest), rows[: -self.rows]

    def touching(self, gap: Float[Array, "m e"]) -> Bool[Array, "m e"]:
        """Return which obstacles press on which edges, from the gaps (m)."""
        _, pressing = self.contact.press(gap.reshape(-1))
        return pressing.reshape(gap.shape) > 0

    def edge_force(
        self, motion: Motion, pose: Pose | None, inside: Bool[Array, " e"]
    ) -> Float[Array, " d"]:
        """Return the total force of all obstacles on some of the edges (N)."""
        _, forces = self.each(Contact.push, self.motions(motion, pose))
        each = -forces[:, 2, : self.contact.axes].reshape(self.count, -1, self.contact.axes)
        on_edges = self.on_edges(jnp.sum(each, axis=0))
        return jnp.sum(jnp.where(inside[:, None], on_edges, 0.0), axis=0)

    def on_edges(self, windows: Float[Array, "window ..."]) -> Float[Array, "e ..."]:
        """Add what a window of the tool's ball has, the last one, to the last edge."""
        if self.contact.ball is None:
            return windows
        return windows[:-1].at[-1].add(windows[-1])

    def _of_pairs(self, pose: Pose | None) -> Pose | None:
        """Return the attitude of the obstacle of each pair."""
        edges = self.contact.radius.shape[0] // self.count
        return jax.tree.map(lambda x: jnp.repeat(x, edges, axis=0), pose)

    def windows(self, rows: Rows) -> Float[Array, "pairs k b"]:
        """Return the windows of each edge with each obstacle, obstacle by obstacle."""
        nodes, points = rows[: -self.rows], rows[-self.rows :]
        edges = banded.gather(nodes, 1, nodes.shape[0] - 2, 2)
        if self.contact.ball is not None:
            edges = jnp.concatenate([edges, edges[-1:]])
        shape = (self.count, *edges.shape)
        own = points.reshape(-1, self.count, 1, shape[-1]).swapaxes(0, 1).swapaxes(1, 2)
        each = jnp.broadcast_to(own, (*shape[:2], *own.shape[2:]))
        pairs = jnp.concatenate([jnp.broadcast_to(edges, shape), each], axis=2)
        return pairs.reshape(-1, *pairs.shape[2:])

    def motions(self, motion: Motion, pose: Pose | None) -> Motion:
        """Return the motion of each edge with each obstacle."""
        moving = motion.windows(self.windows, self.contact.radius.shape, motion.position.shape[1])
        return moving.remembering(self._of_pairs(pose), None)

    def gaps(self, rows: Rows, pose: Pose | None) -> Float[Array, "m e"]:
        """Return the distance of each obstacle from each edge (m)."""
        gaps = self.each(Contact.gap, self.windows(rows), self._of_pairs(pose))
        return gaps.reshape(self.count, -1)

    def each(self, of: Callable[..., Any], *pairs: Any) -> Any:
        """Return a function of the contact and of arrays of each pair, obstacle by obstacle."""
        if not self.surfaces:
            return jax.vmap(of)(self.contact, *pairs)
        whole = jax.tree.map(
            lambda x: x.reshape(self.count, -1, *x.shape[1:]), (self.contact, *pairs)
        )
        # each surface alone, as their grids differ in size; all others together
        alone = [index for index, surface in enumerate(self.surfaces) if surface is not None]
        others = [index for index, surface in enumerate(self.surfaces) if surface is None]
        groups = [*([others] if others else []), *([index] for index in alone)]

        def of_group(group: list[int]) -> Any:
            surface = self.surfaces[group[0]]

            def one(contact: Contact, *pair: Any) -> Any:
                if surface is not None:
                    contact = SurfaceContact(**vars(contact), surface=surface)
                return of(contact, *pair)

            return jax.vmap(jax.vmap(one))(*jax.tree.map(lambda x: x[np.array(group)], whole))

        order = np.argsort(np.array([*others, *alone]))
        return jax.tree.map(
            lambda *x: jnp.concatenate(x)[order].reshape(-1, *x[0].shape[2:]),
            *map(of_group, groups),
        )

    def scatter(self, windows: Float[Array, "pairs k b"], num_rows: int) -> Rows:
        """Sum forces on edges and obstacles into their rows."""
        each = windows.reshape(self.count, -1, *windows.shape[1:])
        on_edges = self.on_edges(jnp.sum(each, axis=0)[:, :2])
        nodes = banded.scatter(on_edges, 1, num_rows - self.rows)
        own = [jnp.sum(each[:, :, row], axis=1) for row in range(2, each.shape[2])]
        return jnp.concatenate([nodes, *own])

    def border(
        self,
        touch: Float[Array, "m edges 4 b 4 b"],
        own: Float[Array, "rows b rows b"],
        num_nodes: int,
    ) -> Border:
        """Return the blocks of the tangent that couple nodes and free obstacles.

        ``touch`` has the derivatives of the contacts with the arm, ``own`` those of all other
        forces on the rows of the obstacles.
        """
        assert self.bodies is not None
        size, at = own.shape[1], jnp.asarray(self.bodies.unknowns(own.shape[1]))
        free = jnp.asarray(self.free)
        touch = touch[free]
        rows = jnp.stack([free, free + self.count], axis=1)
        blocks = jnp.moveaxis(jnp.sum(touch[:, :, 2:, :, 2:], axis=1), 3, 2)
        own = own.at[rows[:, :, None], :, rows[:, None, :], :].add(blocks)
        corner = own.reshape(-1, own.shape[2] * size)[at][:, at]

        def of_bodies(edges: Float[Array, "f e 2 b 2 b"]) -> Float[Array, "p n b"]:
            """Sum derivatives, by the bodies in the last two axes, over the edges."""
            each = jnp.moveaxis(edges, (4, 5), (1, 2))
            every = jnp.zeros((2 * self.count, *each.shape[2:])).at[rows].set(each)
            kept = every.reshape(-1, *each.shape[3:])[at]
            first = self.contact.first
            return jax.vmap(lambda e: banded.scatter(self.on_edges(e), first, num_nodes))(kept)

        of_nodes = of_bodies(touch[:, :, :2, :, 2:])
        of_extra = of_bodies(jnp.moveaxis(touch[:, :, 2:, :, :2], (2, 3), (4, 5)))
        return Border(jnp.moveaxis(of_nodes, 0, -1), of_extra, corner)

    def resolved(
        self, moved: Rows, before: Float[Array, "m e"], after: Float[Array, "m e"], step: Array
    ) -> Bool[Array, ""]:
        """Return whether a step resolves its contacts, from the displacements and both gaps (m)."""
        gaps = before.reshape(-1), after.reshape(-1)
        return self.contact.resolved(self.windows(moved), *gaps, step)
