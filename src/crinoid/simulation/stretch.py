"""The compiled stretch of time between two looks at a run, and what it keeps."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Int

from crinoid.actuation import drives
from crinoid.dynamics import Outcome, State, carried
from crinoid.programs import OFTEN, compiled
from crinoid.record import Record
from crinoid.simulation.loop import Loop, LoopState, Tally

CAPACITY = 512
"""Instants of a chunk: of a long arm too few to make its loop too large for one function."""


def record(loop: Loop, carry: LoopState) -> Record:
    """Keep the present instant."""
    state, books, tally = carry.state, carry.books, carry.tally
    assert books is not None
    pose, _, _ = loop.system.base.pose(state.time, state.servo)
    strains = loop.system.strains(state)
    channels = state.servo.position.shape[0]
    drive = drives(loop.system.actuators, state.actuators)
    readings = [
        sensor.reading(samples, state.time).value
        for sensor, samples in zip(loop.sensors, carry.sensors, strict=True)
    ]
    spatial = state.frames is not None
    return Record(
        state.time,
        state.position[1:],
        state.velocity[1:],
        state.acceleration[1:],
        state.flow_velocity[1:],
        strains[:, :2] if spatial else strains[:, 0],
        loop.system.tip(state),
        loop.target(state.time),
        carry.command[:channels],
        state.servo.position,
        pose,
        None if drive is None else carry.command[channels:],
        drive,
        jnp.concatenate(readings),
        state.base_force,
        state.base_moment,
        jnp.concatenate([loop.system.energy(state), books.work]),
        tally.steps,
        tally.iterations,
        tally.residual,
        tally.error,
        state.obstacle_position,
        state.obstacle_velocity,
        state.gap,
        books.touch,
        None if state.frames is None else state.frames.director[2:],
        strains[:, 2] if spatial else None,
        state.motion.line,
        loop.system.voyage(state),
        carried(loop.system.forces, state.grip, state.time),
    )


def begun_with(loop: Loop, state: State) -> tuple[LoopState, Record]:
    """Close a loop around a state; return that with its first instant."""
    carry = loop.start(state)
    # of no weak type, as what comes back from a file: both take the same compiled stretch
    carry = jax.tree.map(lambda x: jax.lax.convert_element_type(x, x.dtype), carry)
    return carry, record(loop, carry)


def one_instant(record: Record) -> Record:
    """Return an instant as a record of one."""
    return jax.tree.map(lambda x: np.asarray(x)[None], record)


def _to_next(
    loop: Loop,
    carry: LoopState,
    outcome: Outcome,
    end: Int[Array, ""],
    stride: Int[Array, ""],
) -> tuple[LoopState, Record, Bool[Array, ""], Outcome]:
    """Run on to the next instant to keep, to the time step ``end``, or until one fails.

    Returns the loop's new state, its record, whether that is to be kept, and the outcome of the
    last solve.
    """
    Inner = tuple[LoopState, Outcome]

    def step(inner: Inner) -> Inner:
        carry, progress = loop.tick(inner[0])
        return carry, progress.outcome

    due = (carry.steps // stride + 1) * stride

    def unfinished_stride(inner: Inner) -> Bool[Array, ""]:
        carry, outcome = inner
        return (carry.steps < jnp.minimum(due, end)) & outcome.converged

    carry, outcome = jax.lax.while_loop(unfinished_stride, step, (carry, outcome))
    now = record(loop, carry)
    is_due = carry.steps == due
    tally = jax.tree.map(
        lambda none, some: jnp.where(is_due, none, some), Tally.of_nothing(), carry.tally
    )
    return eqx.tree_at(lambda c: c.tally, carry, tally), now, is_due, outcome


@compiled(**OFTEN)
def stretch(
    loop: Loop, carry: LoopState, end: Int[Array, ""], stride: Int[Array, ""], capacity: int
) -> tuple[LoopState, Record, Int[Array, ""], Outcome]:
    """Run on to the time step ``end``, or until one fails; keep every ``stride``-th instant.

    There are at most ``capacity`` of these. Returns the loop's new state, room for them and one
    more, of which the first ones are filled, how many are, and the outcome of the last solve.
    """
    Outer = tuple[LoopState, Record, Array, Outcome]

    def run_to_next(outer: Outer) -> Outer:
        carry, kept, filled, outcome = outer
        carry, now, is_due, outcome = _to_next(loop, carry, outcome, end, stride)
        kept = jax.tree.map(
            lambda all_, one: jax.lax.dynamic_update_index_in_dim(all_, one, filled, 0), kept, now
        )
        return carry, kept, filled + is_due, outcome

    def unfinished(outer: Outer) -> Bool[Array, ""]:
        carry, _, _, outcome = outer
        return (carry.steps < end) & outcome.converged

    room = jax.tree.map(
        # an instant that is not to be kept is written as well, and written over by the next one
        lambda x: jnp.zeros((capacity + 1, *x.shape), x.dtype),
        jax.eval_shape(lambda: record(loop, carry)),
    )
    started = Outcome.of_nothing(converged=True)
    return jax.lax.while_loop(unfinished, run_to_next, (carry, room, jnp.asarray(0), started))


@compiled(**OFTEN)
def stretches(
    loops: Loop,
    carries: LoopState,
    outcomes: Outcome,
    ends: Int[Array, " run"],
    strides: Int[Array, " run"],
    count: int,
) -> tuple[LoopState, Record, Bool[Array, "run count"], Outcome]:
    """Run many loops on together, each as `stretch` does, for ``count`` instants to keep.

    One that is at its end, or had failed before, stays where it is. All arrays have the runs in
    front. Returns also, for each run, which of the instants are to be kept: the first ones.
    """
    Outer = tuple[LoopState, Outcome]

    def one(
        loop: Loop, carry: LoopState, outcome: Outcome, end: Array, stride: Array
    ) -> tuple[LoopState, Record, Array, Outcome]:
        def run_to_next(outer: Outer, _: None) -> tuple[Outer, tuple[Record, Array]]:
            carry, now, is_due, outcome = _to_next(loop, *outer, end, stride)
            return (carry, outcome), (now, is_due)

        (carry, outcome), (kept, due) = jax.lax.scan(run_to_next, (carry, outcome), length=count)
        return carry, kept, due, outcome

    return eqx.filter_vmap(one)(loops, carries, outcomes, ends, strides)
