"""Compiled chunk of a run, and its record."""

from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from crinoid.actuation import drives
from crinoid.compilation import OFTEN, SOMETIMES, Program, compiled
from crinoid.dynamics import ActingForces, FarEdges, Forces, Hull, Outcome, State, StepStatistics
from crinoid.results.record import Record
from crinoid.simulation.loop import Loop, LoopState

_MANY = 30_000  # time steps from which a faster program pays for its longer compilation
CAPACITY = 512
"""Instants of a chunk; few enough that its loop over a long arm stays one function."""


def record(loop: Loop, carry: LoopState) -> Record:
    """Return the recorded quantities of the present instant, by their names in `Record`."""
    system, state, books, tally = loop.system, carry.state, carry.books, carry.tally
    assert books is not None
    pose, _, _ = system.base.pose(state.time, state.servo)
    strains, forces = system.strains(state), ActingForces.of(system.forces, state.context)
    channels = state.servo.position.shape[0]
    drive = drives(system.actuators, state.actuators)
    readings = [
        sensor.reading(samples, state.time).value
        for sensor, samples in zip(loop.sensors, carry.sensors, strict=True)
    ]
    spatial = state.frames is not None
    touches = {type(each): each.touch(state.motion, forces.heading) for each in forces.far_contacts}
    estimate, estimate_time = loop.estimate(carry)
    vehicle = None
    if system.forces.vehicle is not None and state.attitude is not None:
        vehicle = system.forces.vehicle.vehicle_output(state.motion, state.attitude)
    return Record(
        time=state.time,
        position=state.position[1:],
        velocity=state.velocity[1:],
        acceleration=state.acceleration[1:],
        flow_velocity=state.flow_velocity[1:],
        curvature=strains[:, :2] if spatial else strains[:, 0],
        moment=forces.arm.moments(state.motion, forces.num_nodes(state.motion.position))[1:],
        tip=system.tip(state),
        reference=loop.target(state.time),
        command=carry.command[:channels],
        servo=state.servo.position,
        pose=pose,
        drive_command=None if drive is None else carry.command[channels:],
        drive=drive,
        reading=jnp.concatenate(readings),
        base_force=state.base_force,
        base_moment=state.base_moment,
        energy=jnp.concatenate([system.energy(state), books.work]),
        steps=tally.steps,
        iterations=tally.iterations,
        residual=tally.residual,
        error=tally.error,
        obstacle_position=state.obstacle_position,
        obstacle_velocity=state.obstacle_velocity,
        obstacle_spin=state.obstacle_spin,
        obstacle_axis=_obstacle_axes(system.forces, state),
        gap=state.gap,
        touch=books.contact,
        director=None if state.frames is None else state.frames.director[2:],
        twist=strains[:, 2] if spatial else None,
        branch_tension=forces.arm.branch_tension(),
        line=state.motion.line,
        vortices=forces.arm.vortex_forces(state.motion),
        self_touch=touches.get(FarEdges),
        hull_touch=touches.get(Hull),
        vehicle=vehicle,
        estimate=estimate,
        estimate_time=estimate_time,
        held=forces.arm.tool_factor(state.time),
    )


def start_loop(loop: Loop, state: State) -> tuple[LoopState, Record]:
    """Close a loop around a state; return the loop's state and its first instant."""
    carry = loop.start(state)
    # without weak types, as a state from a file: both use the same compiled chunk
    carry = jax.tree.map(lambda x: jax.lax.convert_element_type(x, x.dtype), carry)
    return carry, record(loop, carry)


def one_instant(record: Record) -> Record:
    """Return a record with a single instant."""
    return jax.tree.map(lambda x: np.asarray(x)[None], record)


def _advance_to_instant(
    loop: Loop, carry: LoopState, outcome: Outcome, end: Int[Array, ""], stride: Int[Array, ""]
) -> tuple[LoopState, Record, Bool[Array, ""], Outcome]:
    """Run to the next instant to save, to the time step ``end``, or until a step fails.

    Returns the loop's new state, its record, whether to save it, and the outcome of the last solve.
    """
    due = (carry.steps // stride + 1) * stride

    def unfinished_stride(inner: tuple[LoopState, Outcome]) -> Bool[Array, ""]:
        carry, outcome = inner
        return (carry.steps < jnp.minimum(due, end)) & outcome.converged

    carry, outcome = jax.lax.while_loop(
        unfinished_stride, lambda inner: loop.tick(inner[0]), (carry, outcome)
    )
    now = record(loop, carry)
    is_due = carry.steps == due
    tally = jax.tree.map(
        lambda none, some: jnp.where(is_due, none, some), StepStatistics.of_nothing(), carry.tally
    )
    return replace(carry, tally=tally), now, is_due, outcome


def run_chunk(
    loop: Loop, carry: LoopState, end: Int[Array, ""], stride: Int[Array, ""], capacity: int
) -> tuple[LoopState, Record, Int[Array, ""], Outcome]:
    """Run to the time step ``end``, or until one fails; save every ``stride``-th instant.

    These are at most ``capacity``. Returns the loop's new state, a record with one place more, the
    number of its places that are filled, and the outcome of the last solve.
    """
    Outer = tuple[LoopState, Record, Array, Outcome]

    def run_to_next(outer: Outer) -> Outer:
        carry, kept, filled, outcome = outer
        carry, now, is_due, outcome = _advance_to_instant(loop, carry, outcome, end, stride)
        kept = jax.tree.map(
            lambda all_, one: jax.lax.dynamic_update_index_in_dim(all_, one, filled, 0), kept, now
        )
        return carry, kept, filled + is_due, outcome

    def unfinished(outer: Outer) -> Bool[Array, ""]:
        carry, _, _, outcome = outer
        return (carry.steps < end) & outcome.converged

    room = jax.tree.map(
        # an instant that is not due is written too, and overwritten by the next one
        lambda x: jnp.zeros((capacity + 1, *x.shape), x.dtype),
        jax.eval_shape(lambda: record(loop, carry)),
    )
    started = Outcome.of_nothing(converged=True)
    return jax.lax.while_loop(unfinished, run_to_next, (carry, room, jnp.asarray(0), started))


fast_chunk = compiled(**OFTEN)(run_chunk)
_quick_chunk = compiled(**SOMETIMES)(run_chunk)


def chunk_program(steps: int) -> Program[..., tuple[LoopState, Record, Array, Outcome]]:
    """Return `run_chunk` as a program: quick to compile for few time steps, else fast to run."""
    return fast_chunk if steps >= _MANY else _quick_chunk


@compiled(**OFTEN)
def run_chunks(
    loops: Loop,
    carries: LoopState,
    outcomes: Outcome,
    ends: Int[Array, " run"],
    strides: Int[Array, " run"],
    count: int,
) -> tuple[LoopState, Record, Bool[Array, "run count"], Outcome]:
    """Run many loops in one batch, each as `run_chunk` does, for ``count`` instants to save.

    A loop that has ended or failed does not move. All arrays have the runs in front. Returns also,
    for each run, which of the instants to save: the first ones.
    """
    Outer = tuple[LoopState, Outcome]

    def one(
        loop: Loop, carry: LoopState, outcome: Outcome, end: Array, stride: Array
    ) -> tuple[LoopState, Record, Array, Outcome]:
        def run_to_next(outer: Outer, _: None) -> tuple[Outer, tuple[Record, Array]]:
            carry, now, is_due, outcome = _advance_to_instant(loop, *outer, end, stride)
            return (carry, outcome), (now, is_due)

        (carry, outcome), (kept, due) = jax.lax.scan(run_to_next, (carry, outcome), length=count)
        return carry, kept, due, outcome

    return eqx.filter_vmap(one)(loops, carries, outcomes, ends, strides)


def _obstacle_axes(forces: Forces, state: State) -> Float[Array, "m d"] | None:
    """Return the direction of a line fixed to each obstacle, if some are free.

    That is the axis of a capsule or cylinder; otherwise it is along x at the start.
    """
    obstacles = forces.obstacles
    if obstacles is None or state.obstacle_attitude is None:
        return None
    half = obstacles.half_axis
    size = jnp.sqrt(jnp.sum(half**2, axis=1, keepdims=True))
    axis = jnp.where(size > 0, half / jnp.where(size > 0, size, 1.0), jnp.eye(half.shape[1])[0])
    return jnp.sum(state.obstacle_attitude * axis[:, None, :], axis=-1)
