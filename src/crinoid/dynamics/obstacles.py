"""Rigid bodies beside the arm: how they move, and what they and the arm do to each other."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from crinoid import chain
from crinoid.dynamics.tangent import Border
from crinoid.elements import Body, Contact, Motion

Rows = Float[Array, "rows b"]
Points = Float[Array, "m d"]

_MISSED = 0.01
"""Error that a step may make in the work of a contact, over the energy of the hit."""
_NEGLIGIBLE = 5e-7
"""Error in that work that does not matter, over the energy that the whole skin takes up."""


class Touch(eqx.Module):
    """Contact of ``m`` obstacles with the arm, now and summed up since the start. SI units."""

    force: Float[Array, "m d"]
    """Force of each obstacle on the arm (N)."""
    in_contact: Bool[Array, " m"]
    impulse: Float[Array, "m d"]
    """Impulse of each obstacle on the arm since the start (N s)."""
    duration: Float[Array, " m"]
    """Time that each one has been in contact since the start (s)."""
    closest: Float[Array, " m"]
    """Smallest distance of each one from the arm since the start (m)."""

    def since(self, before: "Touch", step: Array) -> "Touch":
        """Return this with what was before a step added."""
        return Touch(
            self.force,
            self.in_contact,
            before.impulse + 0.5 * step * (before.force + self.force),
            before.duration + jnp.where(self.in_contact, step, 0.0),
            jnp.minimum(before.closest, self.closest),
        )


class Obstacles(eqx.Module):
    """``m`` obstacles; in what a time step solves for, they are the rows after the nodes.

    Most move as they are told: at a steady velocity, which may be zero, or carried by the water.
    Those with a mass are free: the arm, the water and their weight move them. In space their rows
    have a column for a spin, like those of the nodes; it stays zero, as obstacles do not spin.
    """

    contact: Contact
    """Contact of every obstacle with every edge, obstacle by obstacle."""
    bodies: Body
    """Inertia, weight and drag of the free ones."""
    position: Float[Array, "m d"]
    """Position at the start (m)."""
    drift: Float[Array, "m d"]
    """Velocity of the steady ones, and of the free ones at the start (m/s)."""
    free: tuple[int, ...] = eqx.field(static=True)
    carried: tuple[int, ...] = eqx.field(static=True)
    """Obstacles that start with the water's velocity; they keep to it unless they are free."""

    @property
    def count(self) -> int:
        """Number of obstacles."""
        return self.position.shape[0]

    @property
    def finest(self) -> Float[Array, ""]:
        """Smallest distance between the middles of an obstacle and the arm where they touch (m)."""
        return jnp.min(self.contact.arm_radius + self.contact.radius)

    @property
    def led(self) -> np.ndarray:
        """Which ones move as they are told."""
        return np.setdiff1d(np.arange(self.count), self.free)

    def held(self) -> "Obstacles":
        """Return the same obstacles, none of them free: what statics leans the arm against."""
        none = jax.tree.map(lambda x: x[:0], self.bodies)
        return Obstacles(self.contact, none, self.position, self.drift, (), self.carried)

    def begin(self, points: Points, velocity: Callable[[Points], Points]) -> Points:
        """Return the velocities that the obstacles start with; ``velocity`` is the water's."""
        if not self.carried:
            return self.drift
        carried = jnp.asarray(self.carried)
        return self.drift.at[carried].set(velocity(points[carried]), unique_indices=True)

    def lead(
        self,
        position: Points,
        flow_velocity: Points,
        velocity: Callable[[Points], Points],
        step: Array,
    ) -> tuple[Points, Points]:
        """Return where the obstacles that move as they are told get to, and how fast they then are.

        The carried ones drift with the mean of the water's velocities at both ends of the step
        (Heun); ``velocity`` is that at given positions at its end.
        """
        told = position + step * self.drift
        carried = np.setdiff1d(self.carried, self.free).astype(int)
        if not carried.size:
            return told, self.drift
        start, leaving = position[carried], flow_velocity[carried]
        reached = start + 0.5 * step * (leaving + velocity(start + step * leaving))
        return (
            told.at[carried].set(reached, unique_indices=True),
            self.drift.at[carried].set(velocity(reached), unique_indices=True),
        )

    def push(self, motion: Motion) -> tuple[Float[Array, "m e"], Rows]:
        """Return how far each obstacle is from each edge (m), and the forces on all rows (N)."""
        push = jax.vmap(lambda contact, pair: contact.push(pair))
        gap, forces = push(self.contact, self.motions(motion))
        rows = self.scatter(forces, motion.position.shape[0])
        return gap.reshape(self.count, -1), rows

    def touch(self, motion: Motion) -> tuple[Touch, Float[Array, "n b"]]:
        """Return what the obstacles do to the arm right now, and the forces on the nodes (N).

        In space the last column has the torques about the edges that end there (N m).
        """
        gap, rows = self.push(motion)
        force = -rows[-self.count :, : self.contact.axes]
        none = jnp.zeros(self.count)
        closest = jnp.min(gap, axis=1)
        touching = jnp.any(self.touching(gap), axis=1)
        return Touch(force, touching, 0.0 * force, none, closest), rows[: -self.count]

    def touching(self, gap: Float[Array, "m e"]) -> Bool[Array, "m e"]:
        """Return which obstacles press on which edges, of which the gaps are given (m)."""
        _, pressing = self.contact.press(gap.reshape(-1))
        return pressing.reshape(gap.shape) > 0

    def felt(self, motion: Motion, inside: Bool[Array, " e"]) -> Float[Array, " d"]:
        """Return the force of all obstacles on some of the edges, one vector (N)."""
        _, forces = jax.vmap(lambda contact, pair: contact.push(pair))(
            self.contact, self.motions(motion)
        )
        back = -forces[:, 2, : self.contact.axes].reshape(self.count, -1, self.contact.axes)
        return jnp.sum(jnp.where(inside[:, None], back, 0.0), axis=(0, 1))

    def windows(self, rows: Rows) -> Float[Array, "pairs 3 b"]:
        """Return each edge with each obstacle, obstacle by obstacle."""
        nodes, points = rows[: -self.count], rows[-self.count :]
        edges = chain.gather(nodes, 1, nodes.shape[0] - 2, 2)
        shape = (self.count, *edges.shape)
        each = jnp.broadcast_to(points[:, None, None], (*shape[:2], 1, shape[-1]))
        pairs = jnp.concatenate([jnp.broadcast_to(edges, shape), each], axis=2)
        return pairs.reshape(-1, 3, shape[-1])

    def motions(self, motion: Motion) -> Motion:
        """Return how each edge moves with each obstacle."""
        width = motion.position.shape[1]
        return motion.windows(self.windows, self.contact.radius.shape, width)

    def gaps(self, rows: Rows) -> Float[Array, "m e"]:
        """Return the distance of each obstacle from each edge (m)."""
        gaps = jax.vmap(lambda contact, window: contact.gap(window))(
            self.contact, self.windows(rows)
        )
        return gaps.reshape(self.count, -1)

    def scatter(self, windows: Float[Array, "pairs 3 b"], num_rows: int) -> Rows:
        """Add forces on edges and obstacles up on their rows."""
        each = windows.reshape(self.count, -1, *windows.shape[1:])
        nodes = chain.scatter(jnp.sum(each, axis=0)[:, :2], 1, num_rows - self.count)
        return jnp.concatenate([nodes, jnp.sum(each[:, :, 2], axis=1)])

    def border(
        self,
        touch: Float[Array, "m edges 3 b 3 b"],
        own: Float[Array, "f b b"],
        num_nodes: int,
    ) -> Border:
        """Return how nodes and free obstacles move each other.

        ``touch`` are the derivatives of the contacts, ``own`` those of what else acts on the free
        ones.
        """
        touch = touch[jnp.asarray(self.free)]
        own = own + jnp.sum(touch[:, :, 2, :, 2], axis=1)
        count, size = own.shape[:2]

        def scatter(edges: Float[Array, "edges 2 b"]) -> Float[Array, "n b"]:
            return chain.scatter(edges, self.contact.first, num_nodes)

        by_column, by_row = jax.vmap(scatter, -1, -1), jax.vmap(scatter, 1, 0)
        of_nodes = jax.vmap(by_column, 0, 2)(touch[:, :, :2, :, 2])
        of_bodies = jax.vmap(by_row)(touch[:, :, 2, :, :2])
        corner = jnp.einsum("fij,fg->figj", own, jnp.eye(count))
        total = count * size
        return Border(
            of_nodes.reshape(num_nodes, size, total),
            of_bodies.reshape(total, num_nodes, size),
            corner.reshape(total, total),
        )

    def resolved(
        self,
        before: Rows,
        was: Float[Array, "m e"],
        after: Rows,
        now: Float[Array, "m e"],
        step: Array,
    ) -> Bool[Array, ""]:
        """Return whether a step was short enough for its contacts, of which the gaps are given (m).

        It was if the force at its two ends accounts for what the skin takes up in between, so
        that a hit gives back the energy that it took; and if no obstacle moved on further,
        relative to an edge, than would bring its middle half of the way into the arm's, so that
        none can pass through unseen.
        """
        contact = self.contact
        gap, gap_before = now.reshape(-1), was.reshape(-1)
        (held, force), (held_before, force_before) = map(contact.press, (gap, gap_before))
        closed = gap_before - gap
        missed = 0.5 * (force + force_before) * closed - (held - held_before)
        hit = held + held_before + 0.5 * contact.mass * (closed / step) ** 2
        negligible = _NEGLIGIBLE * contact.press(jnp.zeros_like(gap))[0]
        accounted = jnp.abs(missed) <= _MISSED * hit + negligible

        moved = self.windows((after - before)[:, : contact.axes])
        travel = jnp.max(jnp.sum((moved[:, :2] - moved[:, 2:]) ** 2, axis=-1), axis=1)
        room = jnp.maximum(gap_before, 0.0) + 0.5 * (contact.arm_radius + contact.radius)
        return jnp.all(accounted) & jnp.all(travel <= room**2)
