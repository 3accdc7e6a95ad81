"""The compiled stretch of time between two looks at a run, and what it keeps."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from crinoid.dynamics import Outcome
from crinoid.record import Record
from crinoid.simulation.loop import Loop, LoopState


class Tally(eqx.Module):
    """What a stretch of steps cost, and how its last solve ended."""

    steps: Int[Array, ""]
    iterations: Int[Array, ""]
    residual: Float[Array, ""]
    outcome: Outcome


def start_tally() -> Tally:
    """Return the tally of no steps."""
    none = jnp.asarray(0)
    return Tally(none, none, jnp.zeros(()), Outcome.of_nothing(converged=True))


def record(loop: Loop, carry: LoopState, tally: Tally) -> Record:
    """Keep the present instant."""
    state = carry.state
    pose, _, _ = loop.system.base.pose(state.time, state.servo)
    return Record(
        state.time,
        state.position[1:],
        state.velocity[1:],
        state.acceleration[1:],
        state.flow_velocity[1:],
        loop.system.tip(state),
        loop.target(state.time),
        carry.command,
        pose,
        state.base_force,
        state.base_moment,
        jnp.concatenate([state.energy, state.work]),
        tally.steps,
        tally.iterations,
        tally.residual,
        state.obstacle_position,
        state.obstacle_velocity,
        state.touch,
    )


@eqx.filter_jit
def stretch(
    loop: Loop, carry: LoopState, records: Int[Array, ""], stride: Int[Array, ""], capacity: int
) -> tuple[LoopState, Record, Int[Array, ""], Outcome]:
    """Run on for ``records`` instants, ``stride`` time steps apart, or until a step fails.

    Returns the loop's new state, room for ``capacity`` instants of which the first ones are
    filled, how many are, and the outcome of the last solve. A stretch cut short by a failure ends
    with the last good state as an instant of its own.
    """

    def step(inner: tuple[LoopState, Tally, Array]) -> tuple[LoopState, Tally, Array]:
        carry, tally, done = inner
        carry, progress = loop.tick(carry)
        outcome = progress.outcome
        residual = jnp.where(outcome.converged, outcome.residual, 0.0)
        tally = Tally(
            tally.steps + progress.steps,
            tally.iterations + progress.iterations,
            jnp.maximum(tally.residual, residual),
            outcome,
        )
        return carry, tally, done + 1

    def unfinished_stride(inner: tuple[LoopState, Tally, Array]) -> Bool[Array, ""]:
        _, tally, done = inner
        return (done < stride) & tally.outcome.converged

    Outer = tuple[LoopState, Record, Array, Outcome]

    def instant(outer: Outer) -> Outer:
        carry, kept, filled, _ = outer
        carry, tally, _ = jax.lax.while_loop(
            unfinished_stride, step, (carry, start_tally(), jnp.asarray(0))
        )
        now = record(loop, carry, tally)
        kept = jax.tree.map(lambda all_, one: all_.at[filled].set(one), kept, now)
        # a failure at the very first step leaves nothing new to keep
        good = tally.outcome.converged | (tally.steps > 0)
        return carry, kept, filled + good, tally.outcome

    def unfinished(outer: Outer) -> Bool[Array, ""]:
        _, _, filled, outcome = outer
        return (filled < records) & outcome.converged

    tally = start_tally()
    room = jax.tree.map(
        lambda x: jnp.zeros((capacity, *x.shape), x.dtype),
        jax.eval_shape(lambda: record(loop, carry, tally)),
    )
    return jax.lax.while_loop(unfinished, instant, (carry, room, jnp.asarray(0), tally.outcome))
