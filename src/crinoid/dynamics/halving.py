"""A time step cut into shorter ones where it has to be."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from crinoid.dynamics.outcome import Outcome

_GROWTH = 8.0
"""By how much the local error of a method of order 2 grows when a step is doubled."""


class Progress(eqx.Module):
    """How a step went that was cut into shorter ones where it had to be."""

    outcome: Outcome
    """Outcome of the last solve."""
    residual: Float[Array, ""]
    """Largest imbalance that one of the steps that succeeded ended with (N)."""
    error: Float[Array, ""]
    """Largest estimated local error of one of them (m)."""
    steps: Int[Array, ""]
    """Steps that succeeded."""
    iterations: Int[Array, ""]
    """Newton iterations of all solves, the failed ones too."""


def halve(
    step: Callable[[Any, Array], tuple[Any, Outcome]],
    state: Any,
    length: Float[Array, ""],
    max_halvings: Int[Array, ""],
    max_error: Float[Array, ""],
) -> tuple[Any, Progress]:
    """Advance a state by ``length`` (s), in shorter steps where ``step`` does not converge.

    The state may hold anything. The shortest step is ``2**-max_halvings`` of the length; past that
    the last good state comes back with a failed outcome. A step is doubled again where the longer
    one would be expected to keep within ``max_error`` (m).
    """
    whole = 2**max_halvings  # parts of a step, of which the shortest is one

    def unfinished(carry: tuple[Any, Progress, Array, Array]) -> Bool[Array, ""]:
        _, _, done, part = carry
        return (done < whole) & (part > 0)

    def attempt(
        carry: tuple[Any, Progress, Array, Array],
    ) -> tuple[Any, Progress, Array, Array]:
        state, progress, done, part = carry
        new, outcome = step(state, length * (part / whole))
        good = outcome.converged
        kept = jax.lax.cond(good, lambda: new, lambda: state)
        done = done + jnp.where(good, part, 0)
        # after a success try twice as much again, from a place that twice as much divides
        room = _GROWTH * outcome.error <= max_error
        longer = jnp.where((done % (2 * part) == 0) & (part < whole) & room, 2 * part, part)
        part = jnp.where(good, longer, part // 2)
        return (
            kept,
            Progress(
                outcome,
                jnp.maximum(progress.residual, jnp.where(good, outcome.residual, 0.0)),
                jnp.maximum(progress.error, jnp.where(good, outcome.error, 0.0)),
                progress.steps + good,
                progress.iterations + outcome.iterations,
            ),
            done,
            part,
        )

    nothing, zero = jnp.asarray(0), jnp.zeros(())
    unsolved = Outcome.of_nothing(converged=False)
    state, progress, _, _ = jax.lax.while_loop(
        unfinished,
        attempt,
        (state, Progress(unsolved, zero, zero, nothing, nothing), nothing, whole),
    )
    return state, progress
