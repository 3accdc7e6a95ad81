"""Hull of the vehicle: a capsule that the arm can touch, and its place."""
# ruff: noqa: D102  # the base class documents its methods

from dataclasses import replace
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from crinoid.dynamics.far_contact import FarContact, Rows
from crinoid.dynamics.rows import BOUNDARY_NODES, CENTRE, GHOST, ROOT, ROTATION, SPIN
from crinoid.elements import HullContact, Motion
from crinoid.numerics.frames import rotation_velocity
from crinoid.numerics.small_matrices import product


class HullTouch(eqx.Module):
    """Contact of the edges of an arm with the hull. SI units."""

    gap: Float[Array, "*t e"]
    """Distance of each edge's surface from the hull (m); infinite near the root."""
    force: Float[Array, "*t e d"]
    """Force of the hull on each edge (N)."""


class Hull(FarContact):
    """Hull behind the root of an arm, and the edges far enough from the root to touch it.

    It follows the clamp of the arm, or a floating vehicle. A window then has two points of its
    axis besides nodes: one behind its nose, and its nose.
    """

    contact: HullContact
    """Contact of each far edge."""
    first_edge: int = eqx.field(static=True)
    """First far edge; all that follow are far."""
    axis: Float[Array, "2 d"] | None = None
    """Both points from the centre of mass in the axes of a floating vehicle (m)."""
    attitude: Float[Array, "d d"] | None = None
    """Matrix from these axes to those of the world."""
    first_row: ClassVar[int] = BOUNDARY_NODES  # a reaction at the clamp has a short lever

    @property
    def nodes(self) -> Int[np.ndarray, "far k"]:
        """Rows of the window of each far edge."""
        near = self.first_edge + ROOT + np.arange(self.contact.radius.shape[0])
        held = [GHOST, ROOT] if self.axis is None else [GHOST, ROOT, -2, -1]
        return np.stack([near, near + 1, *(np.full_like(near, row) for row in held)], axis=1)

    def turned(self, attitude: Float[Array, "d d"] | None) -> "Hull":
        return self if attitude is None else replace(self, attitude=attitude)

    def placed(self, motion: Motion) -> Motion:
        if self.axis is None:
            return motion
        assert self.attitude is not None
        axes, width = self.axis.shape[1], motion.position.shape[1]
        rate = motion.velocity[ROTATION, : 1 if axes == 2 else 3]
        swing = product(rotation_velocity(rate, self.axis), self.attitude.T)
        velocity = jnp.pad(motion.velocity[CENTRE, :axes] + swing, ((0, 0), (0, width - axes)))
        if axes == 3:
            forward = self.axis[1] - self.axis[0]
            spin = product(rate, forward) / jnp.sqrt(product(forward, forward))
            velocity = velocity.at[1, SPIN].set(spin)
        still = jnp.zeros((2, axes))
        return replace(
            motion,
            position=self.positions(motion.position),
            velocity=jnp.concatenate([motion.velocity, velocity]),
            acceleration=jnp.pad(motion.acceleration, ((0, 2), (0, 0))),
            flow_velocity=jnp.concatenate([motion.flow_velocity, still]),
            flow_acceleration=jnp.concatenate([motion.flow_acceleration, still]),
        )

    def positions(self, rows: Rows) -> Float[Array, "more b"]:
        if self.axis is None:
            return rows
        assert self.attitude is not None
        axes = self.axis.shape[1]
        points = rows[CENTRE, :axes] + product(self.axis, self.attitude.T)
        return jnp.concatenate([rows, jnp.pad(points, ((0, 0), (0, rows.shape[1] - axes)))])

    def touch(self, motion: Motion) -> HullTouch:
        axes, near = motion.flow_velocity.shape[-1], self.first_edge
        gaps = self.distances(motion.position, axes)
        _, _, window = self.nearest(motion, gaps)
        forces = jax.vmap(lambda one, there: one.on_edge(there))(self.contact, window)
        force = jnp.sum(forces[..., :axes], axis=1)
        gap = jnp.concatenate([jnp.full(near, jnp.inf), gaps])
        return HullTouch(gap, jnp.pad(force, ((near, 0), (0, 0))))


def first_far_edge(
    lengths: Float[np.ndarray, " e"], radii: Float[np.ndarray, " e"], retraction: float
) -> int:
    """Return the first edge that can touch the hull, from lengths and radii of the edges (m).

    Between the root and that edge the arm is at least as long as half a circle whose diameter is
    its own: it can turn back there without being bent more than its thickness lets it.
    ``retraction`` is how far channels draw the root back into a hull that floats (m).
    """
    starts = np.cumsum(lengths) - lengths
    near = np.flatnonzero(starts < np.pi * radii + retraction)
    return int(near[-1]) + 1
