"""Where a motion starts from: the arm without load, and how it moves along with its base."""

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.base import Base, Prescribed, ServoState
from crinoid.chain import begun_with, widened
from crinoid.dynamics.forces import Forces
from crinoid.dynamics.grip import Grip
from crinoid.dynamics.integrator import Stage
from crinoid.dynamics.newton import Kept, implied, tangent_at
from crinoid.dynamics.state import State
from crinoid.dynamics.surroundings import Surroundings
from crinoid.dynamics.tangent import HELD, Tangent
from crinoid.elements import Motion
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
        rows = widened(jnp.concatenate([held[:1], held[1] + shape]), 4)
        directors = jnp.concatenate([clamp[1:2], clamp[1:2], directors])
        # nothing twists at the tip
        twists = jnp.pad((reference.rest_twist * reference.voronoi_length)[:-1], (1, 1))
        known = Frames.of(rows, Orientation(directors, twists, jnp.zeros_like(directors)))
        frames = Frames.of(rows, known.at(rows))
    parts, width = [rows], rows.shape[1]
    if (obstacles := forces.obstacles) is not None:
        parts.append(widened(obstacles.position + time * obstacles.drift, width))
    if forces.vehicle is not None:
        middle = widened(forces.vehicle.offset[None], width)
        parts += [middle, jnp.zeros_like(middle)]
    return jnp.concatenate(parts), frames


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


def mounted(
    forces: Forces, base: Base, time: Array, servo: ServoState, before: State | None = None
) -> Forces:
    """Return the forces at the end of a step from a state, or at the start, on a vehicle if any."""
    vehicle, axes = forces.vehicle, forces.axes
    if vehicle is None:
        return forces
    turns = 1 if axes == 2 else 3
    attitude, turn = jnp.eye(axes), jnp.zeros(turns)
    if before is not None:
        assert before.attitude is not None
        attitude, turn = before.attitude, before.motion.position[-1, :turns]
    return forces.mounted(vehicle.mount(base.prescribe(time, servo), attitude, turn))


def begin(
    forces: Forces,
    base: Base,
    servo: ServoState,
    time: Float[Array, ""],
    position: Rows,
    frames: Frames | None,
) -> tuple[Forces, Motion, Float[Array, "held b"]]:
    """Return the motion that a shape starts with, the forces then, and those on what is held (N).

    It moves rigidly with the base, and with the acceleration that follows; a vehicle that floats
    starts from rest.
    """
    forces = mounted(forces, base, time, servo)
    nodes, held = forces.nodes(position), base.prescribe(time, servo)
    moving = [begun_with(held.velocity, carried(held, nodes))]
    obstacles = forces.obstacles
    if obstacles is not None:
        points = position[nodes.shape[0] :][: obstacles.count, : forces.axes]
        started = obstacles.begin(points, lambda p: forces.flow_velocity(p, time))
        moving.append(widened(started, position.shape[1]))
    velocity = jnp.concatenate(moving)
    velocity = jnp.pad(velocity, ((0, position.shape[0] - velocity.shape[0]), (0, 0)))
    none, zero = jnp.zeros_like(position), jnp.zeros(())
    accelerated = begun_with(held.acceleration, none)
    stays, one = ("position", "velocity"), jnp.ones(())
    stage = Stage(time, position, velocity, accelerated, zero, zero, one, frames, stays)
    around = forces.surroundings(stage, none)
    acceleration, reaction = _accelerated(forces, around, stage)
    return forces, forces.motion(stage, acceleration, around), reaction


@eqx.filter_custom_jvp
def _accelerated(
    forces: Forces, around: Surroundings, stage: Stage
) -> tuple[Rows, Float[Array, "held b"]]:
    """Return the accelerations that balance the forces at a stage, and the forces on what is held.

    The forces are affine in the acceleration: one Newton step is exact. Its derivative follows from
    the balance, so the tangent is never differentiated.
    """
    return _one_step(forces, around, stage)[:2]


@_accelerated.def_jvp
def _accelerated_jvp(primals: Any, tangents: Any) -> Any:
    acceleration, reaction, tangent = _one_step(*primals)
    found = implied((*primals, None), (*tangents, None), acceleration, tangent)
    return (acceleration, reaction), found


def _one_step(
    forces: Forces, around: Surroundings, stage: Stage
) -> tuple[Rows, Float[Array, "held b"], Tangent]:
    none = jnp.zeros_like(stage.position)
    residual, _ = forces.residual(forces.motion(stage, none, around))
    tangent = tangent_at(forces, around, stage, none, None)
    acceleration = tangent.solve(-residual)
    return acceleration, residual[:HELD] + tangent.on_held(acceleration), tangent


def steady(
    forces: Forces,
    motion: Motion,
    reaction: Float[Array, "held b"],
    followers: Sequence[Any],
    attitude: Float[Array, "d d"] | None,
    grip: Grip | None,
    kept: Kept,
) -> State:
    """Return the state of an arm whose motion is known, and steady.

    ``reaction`` are the forces on what is held (N), and ``followers`` the states of the base's
    servo and of the other actuators.
    """
    servo, *actuators = followers
    return State(
        motion=motion,
        ahead=jnp.zeros_like(motion.position),
        servo=servo,
        actuators=tuple(actuators),
        reaction=reaction,
        gap=forces.gaps(motion.position),
        earlier=jnp.stack([motion.acceleration] * 5),
        guessed=jnp.asarray(False),
        kept=kept,
        attitude=attitude,
        grip=grip,
    )
