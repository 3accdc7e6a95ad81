"""Limits on value, speed and acceleration of inputs that always leave room to stop."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from crinoid.numerics.small_matrices import product

Moves = Float[Array, "input move"]
Inputs = Float[Array, " input"]
Carry = tuple[Inputs, Inputs, Inputs]

_UNLIMITED = 4.0  # change of moves over the largest move that no two moves can have


class Braking(eqx.Module):
    """Limits on the moves of inputs: their changes per control period, each over its block."""

    rate: Inputs
    """Largest move."""
    acceleration: Inputs
    """Largest change of the move from one period to the next."""
    change: Float[Array, "input move"]
    """Largest change to each move from the one before."""
    spared: Float[Array, "input move move"]
    """Distance that braking saves against equal moves, by first move and number of moves;
    infinite past the horizon."""
    lasting: Float[Array, "move move"]
    """Periods that as many moves last."""
    lengths: Float[Array, " move"]

    @staticmethod
    def of(
        rate: Float[np.ndarray, " input"],
        acceleration: Float[np.ndarray, " input"],
        lengths: Float[np.ndarray, " move"],
    ) -> "Braking":
        """Build it from the largest move, its largest change over a period, and the blocks.

        Between two blocks a move may change by the largest change between their middles.
        """
        limited = np.minimum(acceleration, _UNLIMITED * rate)
        before = np.concatenate([[1.0], lengths[:-1]])
        change = limited[:, None] * (0.5 * (before + lengths))
        count = lengths.size
        lasting, spared = np.ones((count, count)), np.full((rate.size, count, count), np.inf)
        for move in range(count):
            lost = np.cumsum(change[:, move:], axis=1) - change[:, move : move + 1]
            spared[:, move, : count - move] = np.cumsum(lost * lengths[move:], axis=1)
            lasting[move, : count - move] = np.cumsum(lengths[move:])
        numbers = (rate, limited, change, spared, lasting, lengths.astype(float))
        return Braking(*(jax.device_put(each) for each in numbers))

    def within(self, moves: Moves, lower: Inputs, upper: Inputs, moving: Inputs) -> Moves:
        """Return the moves that come next to ``moves``, one after the other, and keep to limits.

        ``lower`` and ``upper`` are how far each input may still go, ``moving`` is its last move.
        Each move is one from which the input can stop within the horizon, the first one from which
        it can stop at all. Where limits contradict each other those on the way come first, then
        those on speed, then those on changes.
        """

        def cut(carry: Carry, now: tuple[Array, ...]) -> tuple[Carry, Inputs]:
            up, down, before = carry
            wanted, change, spared, lasting, length, stops = now
            move = jnp.clip(wanted, before - change, before + change)
            move = jnp.clip(move, -self.rate, self.rate)
            fastest = [
                jnp.minimum(
                    jnp.min((room[:, None] + spared) / lasting, axis=1),
                    jnp.where(stops, self.stoppable(room), jnp.inf),
                )
                for room in (down, up)
            ]
            move = jnp.clip(move, -fastest[0], fastest[1])
            move = jnp.clip(move, -down / length, up / length)  # from beyond a limit immediately
            return (up - length * move, down + length * move, move), move

        first = jnp.arange(self.lengths.size) == 0
        each = (moves.T, self.change.T, jnp.moveaxis(self.spared, 1, 0), self.lasting)
        kept: Array
        _, kept = jax.lax.scan(cut, (upper, -lower, moving), (*each, self.lengths, first))
        return kept.T

    def next(self, moving: Inputs, down: Inputs, up: Inputs) -> tuple[Inputs, Inputs]:
        """Return the least and the largest move of one period from which each input can stop.

        ``moving`` is the last move, ``down`` and ``up`` are how far each may still go.
        """
        ends = jnp.stack([moving - self.acceleration, moving + self.acceleration])
        ends = jnp.clip(ends, -self.rate, self.rate)
        ends = jnp.clip(ends, -self.stoppable(down), self.stoppable(up))
        return ends[0], ends[1]

    def stoppable(self, room: Inputs) -> Inputs:
        """Return the largest move after which full braking, period by period, ends in ``room``."""
        ratio = jnp.maximum(room, 0.0) / self.acceleration
        # k moves d, d - a, d - 2a ... go k d - a k (k - 1) / 2, and do for d up to k a
        periods = jnp.maximum(jnp.ceil(0.5 * (jnp.sqrt(1 + 8 * ratio) - 1)), 1.0)
        return room / periods + 0.5 * self.acceleration * (periods - 1)


def displacements(moves: Moves, lengths: Float[Array, " move"]) -> Moves:
    """Return the displacement at the end of each move."""
    return product(moves * lengths, jnp.triu(jnp.ones((lengths.size, lengths.size))))
