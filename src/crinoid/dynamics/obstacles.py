"""Obstacles: rigid bodies near the arm, their motion and their contact with it."""

from collections.abc import Callable, Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from crinoid.dynamics.contact_group import ContactGroup
from crinoid.dynamics.free_bodies import FreeBodies
from crinoid.dynamics.rows import ROOT
from crinoid.elements import Contact, Motion, Pose

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

    contacts: tuple[Contact, ...]
    """Contacts of every edge: one with all round obstacles and planes, and one with each obstacle
    whose surface is from a file."""
    members: tuple[tuple[int, ...], ...] = eqx.field(static=True)
    """Obstacles of each contact."""
    bodies: FreeBodies | None
    """The free obstacles, if there are any."""
    position: Float[Array, "m d"]
    """Position at the start (m)."""
    half_axis: Float[Array, "m d"]
    """Half of the core of each, in its axes (m)."""
    drift: Float[Array, "m d"]
    """Steady velocity, of free obstacles the initial one (m/s)."""
    carried: tuple[int, ...] = eqx.field(static=True)
    """Obstacles that start with the water's velocity, and keep it unless they are free."""

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
    def finest(self) -> Float[Array, ""]:
        """Smallest distance between the axes of an obstacle and the arm in contact (m).

        That of a tool's ball is over its largest displacement, of a node by 1.
        """

        def of_contact(contact: Contact) -> Array:
            reach = contact.between_axes
            if contact.beyond is not None:
                reach = reach / (1 + 2 * contact.beyond / contact.rest_length)
            return jnp.min(reach)

        return jnp.min(jnp.stack([of_contact(contact) for contact in self.contacts]))

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

    def groups(self, num_nodes: int, pose: Pose | None) -> list[ContactGroup]:
        """Return their contacts with the edges; the windows are a grid of obstacles by edges.

        ``pose`` has their attitudes at the start of the step, where some are free.
        """

        def group(contact: Contact, members: tuple[int, ...]) -> ContactGroup:
            each = np.array(members)[:, None]
            edges = np.arange(ROOT, num_nodes - 1)
            if contact.ball is not None:
                edges = np.append(edges, edges[-1])
            rows = [edges, edges + 1, num_nodes + each]
            if self.bodies is not None:
                rows.append(num_nodes + self.count + each)
            index = np.stack(np.broadcast_arrays(*rows), axis=-1)
            return ContactGroup.of(contact, index, pose and pose.of(np.repeat(each, edges.size)))

        return [group(*each) for each in zip(self.contacts, self.members, strict=True)]

    def by_obstacle(self, found: Sequence[Float[Array, " w"]]) -> Float[Array, "m e"]:
        """Return numbers of the windows of each contact as one row for each obstacle."""
        rows = [x.reshape(len(at), -1) for x, at in zip(found, self.members, strict=True)]
        if len(rows) == 1:
            return rows[0]
        return jnp.concatenate(rows)[np.argsort(np.concatenate(self.members))]

    def by_contact(self, gap: Float[Array, "m e"]) -> list[Float[Array, " w"]]:
        """Return the gaps in the windows of each contact (m), from those of each obstacle."""
        return [gap[np.array(at)].reshape(-1) for at in self.members]

    def touching(self, gap: Float[Array, "m e"]) -> Bool[Array, "m e"]:
        """Return which obstacles press on which edges, from the gaps (m)."""
        each = zip(self.contacts, self.by_contact(gap), strict=True)
        return self.by_obstacle([contact.press(gaps)[1] for contact, gaps in each]) > 0

    def push(
        self, motion: Motion, num_nodes: int, pose: Pose | None
    ) -> tuple[Float[Array, "m e"], Float[Array, "rows b"]]:
        """Return the distance of obstacles from edges (m), and the forces on all rows (N)."""
        gaps, rows = [], jnp.zeros_like(motion.position)
        for group in self.groups(num_nodes, pose):
            gap, forces = group.push(motion)
            gaps.append(gap)
            rows += group.scatter(forces, rows.shape)
        return self.by_obstacle(gaps), rows

    def touch(
        self, motion: Motion, num_nodes: int, pose: Pose | None
    ) -> tuple[Touch, Float[Array, "n b"]]:
        """Return the present contact, and the forces on the nodes (N).

        In space the last column has the torques about the edges that end there (N m).
        """
        gap, rows = self.push(motion, num_nodes, pose)
        none = jnp.zeros(self.count)
        force = -rows[num_nodes : num_nodes + self.count, : self.position.shape[1]]
        touching = jnp.any(self.touching(gap), axis=1)
        return Touch(force, touching, 0.0 * force, none, jnp.min(gap, axis=1)), rows[:num_nodes]

    def edge_force(
        self, motion: Motion, num_nodes: int, pose: Pose | None, inside: Bool[Array, " e"]
    ) -> Float[Array, " d"]:
        """Return the total force of all obstacles on some of the edges (N)."""
        total = jnp.zeros(self.position.shape[1])
        for group in self.groups(num_nodes, pose):
            _, forces = group.push(motion)
            felt = inside[group.index[..., 0].reshape(-1) - ROOT]
            total -= jnp.sum(jnp.where(felt[:, None], forces[:, 2, : total.size], 0.0), axis=0)
        return total
