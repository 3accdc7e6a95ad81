"""The compiled stretch of time between two looks at a run, and what it keeps."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int

from crinoid.actuation import drives
from crinoid.dynamics import Outcome, carried
from crinoid.programs import OFTEN, compiled
from crinoid.record import Record
from crinoid.simulation.loop import Loop, LoopState, Tally


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
        jnp.concatenate([books.energy, books.work]),
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


@compiled(**OFTEN)
def stretch(
    loop: Loop, carry: LoopState, end: Int[Array, ""], stride: Int[Array, ""], capacity: int
) -> tuple[LoopState, Record, Int[Array, ""], Outcome]:
    """Run on to the time step ``end``, or until one fails; keep every ``stride``-th instant.

    Returns the loop's new state, room for ``capacity`` instants of which the first ones are
    filled, how many are, and the outcome of the last solve.
    """
    Inner = tuple[LoopState, Outcome]

    def step(inner: Inner) -> Inner:
        carry, progress = loop.tick(inner[0])
        return carry, progress.outcome

    Outer = tuple[LoopState, Record, Array, Outcome]

    def run_to_next(outer: Outer) -> Outer:
        carry, kept, filled, outcome = outer
        due = (carry.steps // stride + 1) * stride

        def unfinished_stride(inner: Inner) -> Bool[Array, ""]:
            carry, outcome = inner
            return (carry.steps < jnp.minimum(due, end)) & outcome.converged

        carry, outcome = jax.lax.while_loop(unfinished_stride, step, (carry, outcome))
        now = record(loop, carry)
        kept = jax.tree.map(lambda all_, one: all_.at[filled].set(one), kept, now)
        is_due = carry.steps == due
        tally = jax.tree.map(
            lambda none, some: jnp.where(is_due, none, some), Tally.of_nothing(), carry.tally
        )
        carry = eqx.tree_at(lambda c: c.tally, carry, tally)
        return carry, kept, filled + is_due, outcome

    def unfinished(outer: Outer) -> Bool[Array, ""]:
        carry, _, _, outcome = outer
        return (carry.steps < end) & outcome.converged

    room = jax.tree.map(
        lambda x: jnp.zeros((capacity, *x.shape), x.dtype),
        jax.eval_shape(lambda: record(loop, carry)),
    )
    started = Outcome.of_nothing(converged=True)
    return jax.lax.while_loop(unfinished, run_to_next, (carry, room, jnp.asarray(0), started))
