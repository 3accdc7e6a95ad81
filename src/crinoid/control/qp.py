"""Quadratic program of a receding horizon: the best moves of inputs within their limits."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from crinoid.control.braking import Braking, displacements
from crinoid.numerics.small_matrices import inverse, product

Moves = Float[Array, "input move"]
Inputs = Float[Array, " input"]
Rows = Float[Array, "side input row"]
Limits = Float[Array, "input row"]

_TO_BOUNDARY = 0.995  # share of the way to the nearest limit that a step of the interior point goes
_CENTRED = 1e-13  # complementarity over that of the start at which the interior point has arrived
_NEAR = 1e-6  # share of it below which it may only fall
_STIFFEST = 1e12
"""Weight of a limit over the curvature of the costs, beyond which round-off would win."""
_PENALTY = 1e3
"""Weight of an active limit in the polish, over the curvature of the costs; more adds round-off."""
_POLISHES = 3
_REFINEMENTS = 8
_EXACT = 1e-9
"""Violation over the width of a limit, and gradient over that of the start, that count as none."""
_NARROWEST = 1e-9  # width between two limits, over the widest, that is left where they meet


class Solution(NamedTuple):
    """Moves of the inputs, and the quality of the optimum."""

    moves: Moves
    """Change of each input per control period, in its unit; within all limits."""
    optimal: Bool[Array, ""]
    """Whether the conditions of an optimum are met (to 1e-9); if not, it is nearly one."""
    residual: Float[Array, ""]
    """Largest entry of the remaining gradient, over that of the gradient without moves."""


class HorizonQp(eqx.Module):
    """Minimise ``m H m / 2 + g m`` over the moves ``m`` of inputs, within their limits.

    A move is the change of an input per control period; it lasts for one period or, farther out,
    for a block of several (move blocking). Limited are each input's value, its moves (speed), and
    the difference between one move and the next (acceleration). Standing still or, in motion,
    braking is always allowed, so that there is always a solution.

    Solved by a primal-dual interior point (Mehrotra 1992; Nocedal and Wright 2006, algorithm 16.4)
    with a fixed number of iterations: the sums of moves are the unknowns, in which each limit
    concerns three neighbours at most. From the limits that are active there an augmented
    Lagrangian finds the optimum to round-off; it counts only if it meets all limits and its
    multipliers have the right signs. Remaining excess over a limit is clipped (``Braking``).
    An iteration of operator splitting (Stellato et al. 2020) is much cheaper, but after hundreds of
    iterations it is still some percent away where limits on acceleration are active.
    """

    hessian: Float[Array, "unknown unknown"]
    """Hessian by the displacements of scaled inputs at the end of each move."""
    scale: Inputs
    """Unit of each input in which its moves have a curvature of one on average."""
    rows: Float[Array, "row move"]
    """Displacement, its change over each move, and the changes of moves, of displacements."""
    squares: Float[Array, "offset row move"]
    """Products of each row's entries with themselves and with those one and two moves later."""
    increments: Float[Array, "move move"]
    """Moves per period, of displacements."""
    lengths: Float[Array, " move"]
    """Periods that each move lasts."""
    braking: Braking
    """Limits on moves and their changes."""
    iterations: int = eqx.field(static=True)

    @staticmethod
    def of(
        hessian: Float[np.ndarray, "input move input move"],
        *,
        rate: Float[np.ndarray, " input"],
        acceleration: Float[np.ndarray, " input"],
        lengths: Float[np.ndarray, " move"],
        iterations: int = 14,
    ) -> "HorizonQp":
        """Build the program from its positive definite Hessian and limits of a period.

        ``rate`` is the largest move, ``acceleration`` the largest change from one period to the
        next, both in the unit of the input and above zero; infinite where there is none.
        ``lengths`` are the whole numbers of periods that the moves last; the first one is 1.
        """
        count, moves = hessian.shape[:2]
        difference = np.eye(moves) - np.eye(moves, k=-1)
        increments = difference / lengths[:, None]
        curvature = np.einsum("ikik->i", hessian) / moves
        scale = 1 / np.sqrt(curvature)
        scaled = hessian * scale[:, None, None, None] * scale[:, None]
        by_displacement = np.einsum("ka,ikjl,lb->iajb", increments, scaled, increments)
        size = count * moves
        rows = np.concatenate([np.eye(moves), difference, difference @ increments])
        later = [np.pad(rows, ((0, 0), (0, 2)))[:, offset : offset + moves] for offset in range(3)]
        return HorizonQp(
            jax.device_put(by_displacement.reshape(size, size)),
            jax.device_put(scale),
            jax.device_put(rows),
            jax.device_put(rows * np.stack(later)),
            jax.device_put(increments),
            jax.device_put(lengths.astype(float)),
            Braking.of(rate, acceleration, lengths),
            iterations,
        )

    def solve(
        self, gradient: Moves, *, lower: Inputs, upper: Inputs, last: Inputs, moving: Inputs
    ) -> Solution:
        """Return the best moves for a gradient ``g`` at no moves at all.

        ``lower`` and ``upper`` are the limits of the values, ``last`` is the last value and
        ``moving`` the last move of each input, all in its unit. Where the last value or move is
        beyond a limit, or moves too fast to stop in time, the limits on values come first, then
        those on speed, then those on acceleration.
        """
        safe = self.braking.within(jnp.zeros_like(gradient), lower - last, upper - last, moving)
        low, high = self._bounds(lower - last, upper - last, moving, safe)
        by_displacement = product(gradient * self.scale[:, None], self.increments)
        inside = self._interior(by_displacement, low, high)
        found, optimal, residual = self._polished(by_displacement, low, high, *inside)
        moves = product(found, self.increments.T) * self.scale[:, None]
        moves = jnp.where(jnp.isfinite(moves), moves, safe)
        within = self.braking.within(moves, lower - last, upper - last, moving)
        return Solution(within, optimal, residual)

    def blended(self, weights: Float[Array, " program"]) -> "HorizonQp":
        """Return the program of a weighted sum of the costs of programs stacked in ``self``.

        All have the same limits and lengths; the weights add up to 1.
        """
        scale = 1 / jnp.sqrt(product(weights, 1 / self.scale**2))
        ratio = jnp.repeat(scale / self.scale, self.lengths.shape[-1], axis=1)
        scaled = self.hessian * ratio[:, :, None] * ratio[:, None, :]
        hessian = jnp.sum(weights[:, None, None] * scaled, axis=0)
        first = jax.tree.map(lambda each: each[0], self)
        return eqx.tree_at(lambda each: (each.hessian, each.scale), first, (hessian, scale))

    def _bounds(
        self, lower: Inputs, upper: Inputs, moving: Inputs, safe: Moves
    ) -> tuple[Limits, Limits]:
        """Return the scaled bounds of all rows, wide enough for the moves that are always safe."""
        speed, change = self.braking.rate[:, None] * self.lengths, self.braking.change
        begin = jnp.zeros_like(safe).at[:, 0].set(moving)

        def bounds(side: float, value: Inputs) -> Limits:
            fastest = jnp.minimum(self.braking.rate, self.braking.stoppable(side * value))
            values = jnp.broadcast_to(value[:, None], safe.shape)
            rates = side * speed.at[:, 0].set(fastest)
            return jnp.concatenate([values, rates, begin + side * change], axis=1)

        sides = bounds(-1.0, lower), bounds(1.0, upper)
        kept = product(displacements(safe, self.lengths), self.rows.T)
        low = jnp.minimum(sides[0], kept) / self.scale[:, None]
        high = jnp.maximum(sides[1], kept) / self.scale[:, None]
        spare = 0.5 * jnp.maximum(_NARROWEST * jnp.max(high - low) - (high - low), 0.0)
        return low - spare, high + spare

    def _inverse(self, weights: Limits) -> Float[Array, "unknown unknown"]:
        """Return the inverse of the Hessian with ``weights`` on the squares of the rows."""
        matrix, size = self.hessian, self.hessian.shape[0]
        for offset in range(3):
            band = product(weights, self.squares[offset]).reshape(-1)[:, None]
            upper = band * jnp.eye(size, k=offset)
            matrix += upper if offset == 0 else upper + upper.T
        return inverse(matrix)

    def _interior(self, gradient: Moves, low: Limits, high: Limits) -> tuple[Moves, Rows, Rows]:
        """Return displacements, slacks and multipliers of the lower and the upper bounds."""
        side, bound = jnp.array([-1.0, 1.0])[:, None, None], jnp.stack([-low, high])

        def rows(displacements: Moves) -> Rows:
            return side * product(displacements, self.rows.T)

        def back(multipliers: Rows) -> Moves:
            return product(jnp.sum(side * multipliers, axis=0), self.rows)

        def step(_: Array, carry: tuple[Moves, Rows, Rows]) -> tuple[Moves, Rows, Rows]:
            x, slack, dual = carry
            uphill = _applied(self.hessian, x) + gradient + back(dual)
            beyond = rows(x) + slack - bound
            weight = jnp.minimum(dual / slack, _STIFFEST)
            inverted = self._inverse(jnp.sum(weight, axis=0))
            gap = jnp.mean(slack * dual)

            def towards(target: Rows) -> tuple[Moves, Rows, Rows]:
                wanted = target / slack - dual
                right = -uphill - back(wanted + dual * beyond / slack)
                move = _applied(inverted, right)
                # once more, against round-off
                left = right - _applied(self.hessian, move) - back(weight * rows(move))
                move += _applied(inverted, left)
                opened = -rows(move) - beyond
                return move, opened, wanted - dual * opened / slack

            def room(values: Rows, change: Rows) -> Float[Array, ""]:
                shrinks = change < 0
                share = jnp.where(shrinks, -values / jnp.where(shrinks, change, -1.0), 1.0)
                return jnp.minimum(jnp.min(share), 1.0)

            _, opened, raised = towards(jnp.zeros_like(slack))
            first, second = room(slack, opened), room(dual, raised)
            reached = jnp.mean((slack + first * opened) * (dual + second * raised))
            centred = gap * (reached / gap) ** 3 - opened * raised
            move, opened, raised = towards(centred)
            share = _TO_BOUNDARY * jnp.minimum(room(slack, opened), room(dual, raised))
            after = x + share * move, slack + share * opened, dual + share * raised
            # near the optimum round-off may drive it away again
            nearer = (jnp.mean(after[1] * after[2]) < gap) | (gap > _NEAR * begin)
            good = (gap > _CENTRED * begin) & nearer & jnp.all(jnp.isfinite(after[0]))
            return jax.tree.map(lambda new, old: jnp.where(good, new, old), after, carry)

        width = high - low
        slack = jnp.maximum(bound, 0.5 * width)
        begin = 3.0 * jnp.median(width) * (jnp.max(jnp.abs(gradient)) + _NARROWEST * jnp.max(width))
        carry = jnp.zeros_like(gradient), slack, begin / slack
        return jax.lax.fori_loop(0, self.iterations, step, carry)

    def _polished(
        self, gradient: Moves, low: Limits, high: Limits, x: Moves, slack: Rows, dual: Rows
    ) -> tuple[Moves, Bool[Array, ""], Float[Array, ""]]:
        """Return displacements with the active limits met exactly, if these are the right ones."""
        steep, width = jnp.max(jnp.abs(gradient)) + jnp.finfo(float).tiny, high - low

        def uphill(x: Moves, pull: Limits) -> Moves:
            return _applied(self.hessian, x) + gradient + product(pull, self.rows)

        def polish(_: Array, carry: tuple[Array, ...]) -> tuple[Array, ...]:
            x, best, active, force, optimal, residual = carry
            bound = jnp.where(active > 0, high, low)
            weight = jnp.where(active != 0, _PENALTY, 0.0)
            inverted, force = self._inverse(weight), jnp.where(active != 0, force, 0.0)

            def refine(_: Array, inner: tuple[Array, Array]) -> tuple[Array, Array]:
                x, force = inner
                pull = force + weight * (product(x, self.rows.T) - bound)
                x -= _applied(inverted, uphill(x, pull))
                return x, force + weight * (product(x, self.rows.T) - bound)

            x, force = jax.lax.fori_loop(0, _REFINEMENTS, refine, (x, force))
            values = product(x, self.rows.T)
            above, below = values > high + _EXACT * width, values < low - _EXACT * width
            wrong = force * active < -_EXACT * steep
            left = jnp.max(jnp.abs(uphill(x, force))) / steep
            good = ~jnp.any(above | below | wrong) & (left <= _EXACT)
            take = good & ~optimal
            best, residual = jnp.where(take, x, best), jnp.where(take, left, residual)
            active = jnp.where(wrong, 0.0, jnp.where(above, 1.0, jnp.where(below, -1.0, active)))
            return x, best, active, force, optimal | good, residual

        force = dual[1] - dual[0]
        left = jnp.max(jnp.abs(uphill(x, force))) / steep
        upper, lower = dual[1] > slack[1], dual[0] > slack[0]
        active = jnp.where(upper, 1.0, jnp.where(lower, -1.0, 0.0))
        begin = x, x, active, force, jnp.asarray(False), left
        _, best, _, _, optimal, residual = jax.lax.fori_loop(0, _POLISHES, polish, begin)
        return best, optimal, residual


def _applied(symmetric: Float[Array, "unknown unknown"], moves: Moves) -> Moves:
    # from the left: XLA adds up whole rows together
    return product(moves.reshape(-1), symmetric).reshape(moves.shape)
