"""Initial and boundary conditions, and the predictor of a time step."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from crinoid.base import Base, Prescribed, ServoState
from crinoid.dynamics.acting import ActingForces
from crinoid.dynamics.balance import Balance, implicit_derivative
from crinoid.dynamics.context import Context
from crinoid.dynamics.forces import Forces
from crinoid.dynamics.integrator import StepMap
from crinoid.dynamics.rows import BOUNDARY_NODES, GHOST, ROOT, SPIN, Rows
from crinoid.dynamics.state import State
from crinoid.dynamics.tangent import Tangent
from crinoid.foundation.fixed_numbers import JERKY
from crinoid.numerics.banded import pad_columns, with_first_rows
from crinoid.numerics.frames import Frames, Orientation, cross, dot, tangents
from crinoid.numerics.small_matrices import product
from crinoid.rod.reference import Reference


def at_end(
    forces: Forces,
    base: Base,
    servo: ServoState,
    context: Context,
    stage: StepMap,
    state: State,
    step: Array,
) -> tuple[ActingForces, Prescribed | None, StepMap]:
    """Return the forces at the end of a step, and the stage with prescribed motions set.

    Also the motion of the base, None on a floating vehicle. The step of given length (s) starts
    from ``state``; ``context`` lacks the clamp on a vehicle.
    """
    acting = ActingForces.of(forces, clamped(context, forces, base, stage.time, servo))
    held = None if forces.vehicle is not None else base.prescribe(stage.time, servo)
    rows: tuple[Array, ...] = (stage.position, stage.velocity, stage.acceleration)
    width = stage.position.shape[1]
    if held is not None:
        position = held.position
        if held.frame is not None:
            frames = stage.frames
            assert frames is not None
            spin = frames.spin_to(ROOT, held.frame[0], held.frame[1])
            position = jnp.c_[position, jnp.stack([jnp.zeros(()), spin])]
        values = (position, held.velocity, held.acceleration)
        rows = tuple(with_first_rows(value, row) for row, value in zip(rows, values, strict=True))
    obstacles = forces.obstacles
    if obstacles is not None:
        water = state.motion.flow_velocity[forces.rows.obstacles]
        positions, velocity = obstacles.prescribed_motion(
            state.obstacle_position,
            water,
            lambda points: forces.flow_velocity(points, stage.time),
            step,
        )
        values = (positions, velocity, jnp.zeros_like(positions))
        at = forces.rows.obstacle(obstacles.prescribed)
        rows = tuple(
            row.at[at].set(pad_columns(value[obstacles.prescribed], width), unique_indices=True)
            for row, value in zip(rows, values, strict=True)
        )
    position, velocity, acceleration = rows
    stage = replace(stage, position=position, velocity=velocity, acceleration=acceleration)
    return acting, held, stage


_GUESSES = np.array(
    [[1.0, 0.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0, 0.0], [1.0, 2.0, -2.0, -1.0, 1.0]]
)
"""Three predictions of an acceleration from those of the five steps before, the last one first.

The trapezoid rule does not damp stiff motion; its acceleration alternates in sign (Hairer and
Wanner 1996, section IV.3), as in the second prediction. The means ``(a + 2 a' + a'') / 4`` over
three steps do not alternate: they are the second differences of its positions, over the step
squared. The third prediction extrapolates these by a parabola, and the alternation as well, for
steps of equal length.
"""
_CAUTION = np.array([1.0, 2.0, 16.0])
"""Weights of the squared errors of three predictions; the last one assumes smooth motion."""


def expected_acceleration(forces: Forces, state: State) -> Rows:
    """Predict the acceleration at the end of the next step (m/s2).

    It stays constant, returns to that of one step ago, or is extrapolated smoothly: the prediction
    that would have been best one step ago, by the differences of its error between neighbouring
    nodes, which stretch and bend the arm.

    If Newton's method accepted the last prediction unchanged, its error is unknown; then the
    acceleration stays constant.
    """
    known = jnp.concatenate([state.motion.acceleration[None], state.acceleration_history])
    past = known[1:].reshape(5, -1)
    guesses = product(jnp.asarray(_GUESSES), past).reshape(-1, *known.shape[1:])
    errors = (known[0] - guesses)[:, forces.rows.nodes]
    unlike = jnp.sum((errors[:, 1:] - errors[:, :-1]) ** 2, axis=(1, 2))
    best = jnp.where(state.predictor_accepted, 0, jnp.argmin(_CAUTION * unlike))
    now = known[:-1].reshape(5, -1)
    return product(jnp.asarray(_GUESSES)[best], now).reshape(known.shape[1:])


def first_guess(
    forces: Forces, held: Prescribed, stage: StepMap, state: State, usual: Rows
) -> Rows:
    """Return the initial correction of Newton's method (m), zero on prescribed nodes.

    The ``usual`` prediction ignores a base that each new command jerks: the nodes next to it would
    stay behind, bent and stretched far too much. Then the arm moves rigidly with its base, without
    bending or damping.

    ``held`` is the motion of the base at the stage, ``state`` the start of the step.
    """
    nodes = forces.nodes(stage.position)
    count = nodes.shape[0]
    follows = (rigid_body_velocity(held, nodes) - stage.velocity[:count]) / stage.by_velocity
    rigid = jnp.concatenate([usual[:BOUNDARY_NODES], follows[BOUNDARY_NODES:], usual[count:]])
    return jnp.where(_is_jerky(state, held, count), rigid, usual)


def _is_jerky(state: State, held: Prescribed, count: int) -> Bool[Array, ""]:
    """Return whether the base's acceleration jumps, at the end of a step and in the last ones."""
    past = (*state.acceleration_history[1::-1], state.motion.acceleration)
    root = jnp.stack([*(each[:BOUNDARY_NODES] for each in past), held.acceleration])
    # the ghost node, for the rotation of the base: the swing of the tip
    root = jnp.stack([(root[:, 0] - root[:, 1]) * count, root[:, 1]], axis=1)
    return jnp.sum(jnp.diff(root, axis=0) ** 2) > JERKY * jnp.sum(root**2)


def undeformed(
    reference: Reference, base: Base, forces: Forces, time: Float[Array, ""]
) -> tuple[Rows, Frames | None]:
    """Return the undeformed positions of all rows (m), and in space the frames."""
    pose, _, _ = base.pose(time, base.servo.at_rest())
    held = base.hold(pose)
    if forces.axes == 2:
        shape, frames = reference.rest_shape(base.angles[0] + pose[2]), None
        rows = jnp.concatenate([held[:1], held[1] + shape])
    else:
        assert reference.rest_twist is not None
        clamp = base.frame(pose)
        shape, directors = reference.rest_frames(clamp)
        rows = pad_columns(jnp.concatenate([held[:1], held[1] + shape]), 4)
        directors = jnp.concatenate([clamp[1:2], clamp[1:2], directors])
        # nothing twists at the tip
        twists = jnp.pad((reference.rest_twist * reference.voronoi_length)[:-1], (1, 1))
        known = Frames.of(rows, Orientation(directors, twists, jnp.zeros_like(directors)))
        frames = Frames.of(rows, known.at(rows))
    parts, width = [rows], rows.shape[1]
    if (obstacles := forces.obstacles) is not None:
        parts.append(pad_columns(obstacles.position + time * obstacles.drift, width))
        if obstacles.bodies is not None:
            parts.append(jnp.zeros_like(parts[-1]))
    if forces.vehicle is not None:
        middle = pad_columns(forces.vehicle.offset[None], width)
        parts += [middle, jnp.zeros_like(middle)]
    return jnp.concatenate(parts), frames


def with_clamp_spin(base: Base, time: Float[Array, ""], rows: Rows, frames: Frames | None) -> Rows:
    """Return the rows with the spin of the clamp from its frame: zero, with a derivative.

    The frames from which statics starts have none.
    """
    if frames is None:
        return rows
    pose, _, _ = base.pose(time, base.servo.at_rest())
    frame = base.frame(pose)
    spin = jax.lax.stop_gradient(frames).spin_to(ROOT, frame[0], frame[1])
    return rows.at[ROOT, SPIN].set(spin)


def rigid_body_velocity(held: Prescribed, nodes: Float[Array, "n b"]) -> Float[Array, "n b"]:
    """Return the velocities of nodes that move rigidly with the base (m/s, spins rad/s)."""
    axes = held.position.shape[1]
    lever = held.position[GHOST] - held.position[ROOT]
    swing = (held.velocity[GHOST] - held.velocity[ROOT])[:axes]
    arm = nodes[:, :axes] - held.position[ROOT]
    reach = jnp.sum(lever**2)
    if held.frame is None:
        spin = (lever[0] * swing[1] - lever[1] * swing[0]) / reach
        return held.velocity[ROOT] + spin * jnp.stack([-arm[:, 1], arm[:, 0]], axis=1)
    turning = cross(lever, swing) / reach + held.velocity[ROOT, SPIN] * held.frame[0]
    velocity = held.velocity[ROOT, :3] + cross(turning, arm)
    return jnp.concatenate([velocity, dot(tangents(nodes), turning)[:, None]], axis=1)


def clamped(
    context: Context, forces: Forces, base: Base, time: Array, servo: ServoState
) -> Context:
    """Return a context with the clamp on a floating vehicle, if any."""
    if forces.vehicle is None:
        return context
    return replace(context, clamp=forces.vehicle.clamp(base.prescribe(time, servo)))


def begin(
    forces: ActingForces,
    base: Base,
    followers: Sequence[Any],
    time: Float[Array, ""],
    position: Rows,
    frames: Frames | None,
) -> State:
    """Return the state of a shape that starts from rest on its base.

    It moves rigidly with the base, with the acceleration in balance; a floating vehicle starts from
    rest.
    """
    context = clamped(forces.context, forces, base, time, followers[0])
    forces = replace(forces, context=context)
    nodes, held = forces.nodes(position), base.prescribe(time, followers[0])
    moving = [with_first_rows(held.velocity, rigid_body_velocity(held, nodes))]
    obstacles = forces.obstacles
    if obstacles is not None:
        points = position[forces.rows.obstacles, : forces.axes]
        started = obstacles.begin(points, lambda p: forces.flow_velocity(p, time))
        moving.append(pad_columns(started, position.shape[1]))
        if obstacles.bodies is not None:
            moving.append(pad_columns(obstacles.bodies.spin, position.shape[1]))
    velocity = jnp.concatenate(moving)
    velocity = jnp.pad(velocity, ((0, position.shape[0] - velocity.shape[0]), (0, 0)))
    none, zero = jnp.zeros_like(position), jnp.zeros(())
    accelerated = with_first_rows(held.acceleration, none)
    fixed_fields, one = ("position", "velocity"), jnp.ones(())
    stage = StepMap(time, position, velocity, accelerated, zero, zero, one, frames, fixed_fields)
    around = forces.surroundings(stage, none)
    memory = forces.arm.memory_at_start(forces.motion(stage, none, around))
    forces = ActingForces.of(forces, context.remembering(memory, zero))
    acceleration, reaction = _acceleration(Balance(forces, around, stage))
    motion = forces.motion(stage, acceleration, around)
    return State.of(forces, motion, reaction, followers, forces.arm.memory_at_start(motion))


@eqx.filter_custom_jvp
def _acceleration(balance: Balance) -> tuple[Rows, Float[Array, "held b"]]:
    """Return the accelerations in balance, and the forces on the ghost node and the root.

    The forces are affine in the acceleration: one Newton step is exact. Its derivative follows from
    the balance, so the tangent is never differentiated.
    """
    return _one_step(balance)[:2]


@_acceleration.def_jvp
def _acceleration_jvp(primals: Any, tangents: Any) -> Any:
    acceleration, reaction, tangent = _one_step(*primals)
    found = implicit_derivative(primals[0], tangents[0], acceleration, tangent)
    return (acceleration, reaction), found


def _one_step(balance: Balance) -> tuple[Rows, Float[Array, "held b"], Tangent]:
    motion = balance.motion(jnp.zeros_like(balance.stage.position))
    residual, _ = balance.residual(motion)
    tangent = balance.tangent(motion)
    acceleration = tangent.solve(-residual)
    return acceleration, residual[:BOUNDARY_NODES] + tangent.on_held(acceleration), tangent
