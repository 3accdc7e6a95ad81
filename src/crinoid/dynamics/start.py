"""Where a motion starts from: the arm without load, and how it moves along with its base."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.base import Base, Prescribed
from crinoid.dynamics.forces import Forces
from crinoid.frames import Frames, Orientation, cross, dot, tangents
from crinoid.reference import Reference

Rows = Float[Array, "rows b"]


def undeformed(
    reference: Reference, base: Base, forces: Forces, time: Float[Array, ""]
) -> tuple[Rows, Frames | None]:
    """Return everything where it is without load (m), and in space the frames."""
    pose, _, _ = base.pose(time, base.servo.at_rest())
    held = base.hold(pose)
    if forces.axes == 2:
        shape, frames = reference.rest_shape(base.angles[0] + pose[2]), None
        rows = jnp.concatenate([held[:1], held[1] + shape])
    else:
        assert reference.rest_twist is not None
        clamp = base.frame(pose)
        shape, directors = reference.rest_frames(clamp)
        rows = as_rows(jnp.concatenate([held[:1], held[1] + shape]), 4)
        directors = jnp.concatenate([clamp[1:2], clamp[1:2], directors])
        twists = jnp.pad(reference.rest_twist * reference.voronoi_length, (1, 0))
        twists = twists.at[-1].set(0.0)  # nothing twists at the tip
        known = Frames.of(rows, Orientation(directors, twists, jnp.zeros_like(directors)))
        frames = Frames.of(rows, known.at(rows))
    obstacles = forces.obstacles
    if obstacles is None:
        return rows, frames
    position = as_rows(obstacles.position + time * obstacles.drift, rows.shape[1])
    return jnp.concatenate([rows, position]), frames


def clamped(base: Base, time: Float[Array, ""], rows: Rows, frames: Frames | None) -> Rows:
    """Return the rows with a spin of the clamp that follows its frame: zero, but not its slope.

    Statics starts from frames that it takes for given.
    """
    if frames is None:
        return rows
    pose, _, _ = base.pose(time, base.servo.at_rest())
    frame = base.frame(pose)
    given = jax.lax.stop_gradient(frames)
    return rows.at[1, 3].set(given.spin_to(1, frame[0], frame[1]))


def carried(held: Prescribed, nodes: Float[Array, "n b"]) -> Float[Array, "n b"]:
    """Return the velocities of nodes that move rigidly with the base (m/s, of spins rad/s)."""
    axes = held.position.shape[1]
    lever = held.position[0] - held.position[1]
    swing = (held.velocity[0] - held.velocity[1])[:axes]
    arm = nodes[:, :axes] - held.position[1]
    reach = jnp.sum(lever**2)
    if held.frame is None:
        spin = (lever[0] * swing[1] - lever[1] * swing[0]) / reach
        return held.velocity[1] + spin * jnp.stack([-arm[:, 1], arm[:, 0]], axis=1)
    turning = cross(lever, swing) / reach + held.velocity[1, 3] * held.frame[0]
    velocity = held.velocity[1, :3] + cross(turning, arm)
    return jnp.concatenate([velocity, dot(tangents(nodes), turning)[:, None]], axis=1)


def as_rows(points: Float[Array, "count d"], width: int) -> Float[Array, "count b"]:
    """Pad the coordinates of points to the width of a row with zeros."""
    return jnp.pad(points, ((0, 0), (0, width - points.shape[1])))
