"""Hull of the vehicle: a capsule that the arm can touch, and its place."""
# ruff: noqa: D102  # the base class documents its methods

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from crinoid.dynamics.far_contact import FarContact
from crinoid.dynamics.rows import CENTRE, GHOST, ROOT, ROTATION
from crinoid.elements import HullContact, Motion, VehiclePose


class HullTouch(eqx.Module):
    """Contact of the edges of an arm with the hull. SI units."""

    gap: Float[Array, "*t e"]
    """Distance of each edge's surface from the hull (m); infinite near the root."""
    force: Float[Array, "*t e d"]
    """Force of the hull on each edge (N)."""


class Hull(FarContact):
    """Hull behind the root of an arm, and the edges far enough from the root to touch it.

    It follows the clamp of the arm, or a floating vehicle.
    """

    contact: HullContact
    """Contact of each far edge."""
    first_edge: int = eqx.field(static=True)
    """First far edge; all that follow are far."""

    @property
    def nodes(self) -> Int[np.ndarray, "far k"]:
        """Rows of the window of each far edge."""
        near = self.first_edge + ROOT + np.arange(self.contact.radius.shape[0])
        held = (GHOST, ROOT) if self.contact.axis is None else (GHOST, ROOT, CENTRE, ROTATION)
        return np.stack([near, near + 1, *(np.full_like(near, row) for row in held)], axis=1)

    def touch(self, motion: Motion, pose: VehiclePose | None) -> HullTouch:
        axes, near, group = motion.flow_velocity.shape[-1], self.first_edge, self.group(pose)
        force = -jnp.sum(group.residuals(motion)[:, 0, :2, :axes], axis=1)
        gap = jnp.concatenate([jnp.full(near, jnp.inf), group.gaps(motion.position)])
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
