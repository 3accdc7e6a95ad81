"""Newton's method on the balance of forces."""

from dataclasses import replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.ad_checkpoint import checkpoint_name
from jax.custom_batching import sequential_vmap
from jaxtyping import Array, Bool, Float, Int

from crinoid.dynamics.acting import ActingForces
from crinoid.dynamics.balance import Balance, implicit_derivative, zero_tangents
from crinoid.dynamics.bordered import TangentFactors
from crinoid.dynamics.outcome import Outcome
from crinoid.dynamics.rows import BOUNDARY_NODES, Rows
from crinoid.foundation.fixed_numbers import (
    AGED_CONTRACTION,
    CHORD_MARGIN,
    NOISE,
    ROUNDING,
    STALLED,
)
from crinoid.rod import Rod

SOLVED = "solved"
"""Name of solutions under `jax.checkpoint`, for a policy that saves them."""


class Settings(eqx.Module):
    """Criteria of convergence and failure of Newton's method."""

    tolerance: Float[Array, ""]
    """Largest imbalance over the largest force."""
    max_iterations: Int[Array, ""]
    weights: Float[Array, " b"]
    """Factor from the imbalance of each coordinate to a force: 1, for a spin 1 over a length."""
    max_turn: Float[Array, ""] | None = None
    """Largest relative displacement of neighbours in one iteration, over their distance; in space
    also the largest spin (rad).

    It keeps edges from flipping in a static solve from a distant guess; time steps need no limit.
    """
    max_move: Float[Array, ""] | None = None
    """Largest displacement in one iteration (m), so that statics jumps over no obstacle."""

    @staticmethod
    def for_rod(rod: Rod, tolerance: float | Array, max_iterations: int | Array) -> "Settings":
        """Return the settings for a rod, whose spins count as couples on the ends of an edge."""
        weights = jnp.ones(rod.axes)
        if rod.axes == 3:
            weights = jnp.append(weights, 1.0 / jnp.mean(rod.rest_length))
        return Settings(jnp.asarray(tolerance), jnp.asarray(max_iterations), weights)


class ReusedTangent(eqx.Module):
    """Factorised tangent reused by the next solve (modified Newton method)."""

    tangent: TangentFactors
    contraction: Float[Array, ""]
    """Factor on the imbalance in an iteration with it; 1 without a tangent, infinite where far
    parts touch."""
    by_acceleration: Float[Array, ""]
    """Factor of the acceleration in its stage (1/s2), which detects another step length."""
    floor: Rows
    """Imbalance of each row below which round-off may dominate (N, N m), and progress is not
    required."""

    @staticmethod
    def none(forces: ActingForces, rows: Rows) -> "ReusedTangent":
        """Return the tangent before the first solve: none."""
        nodes, size = forces.nodes(rows).shape
        lines = 0 if forces.lines is None else forces.lines.rest.size
        tangent = TangentFactors.blank(nodes, size, forces.extra(size), lines)
        return ReusedTangent(tangent, jnp.ones(()), jnp.zeros(()), jnp.zeros_like(rows))


class _Iteration(eqx.Module):
    """State of Newton's method."""

    correction: Rows
    """Next correction to evaluate; the result at the end."""
    residual: Rows
    """Residual of the correction evaluated last."""
    outcome: Outcome
    """Outcome of that correction; its iterations are in ``count``."""
    count: Int[Array, ""]
    tangent: TangentFactors
    """Tangent of the last iteration, perhaps good enough for the next."""
    floor: Rows
    """Round-off of each row of the residual, from the last tangent that was assembled."""
    contraction: Float[Array, ""]
    """Factor on the imbalance in the last iteration."""
    touches: Bool[Array, ""]
    """Whether that iteration had contact of far parts, with which no tangent serves again."""
    refresh: Bool[Array, ""]
    """Whether the tangent must be, or is, one of this step."""
    done: Bool[Array, ""]
    change: Rows | None
    """Change that led to the next correction, for a line search; None without one."""


Solution = tuple[Rows, Float[Array, "held b"], Outcome, ReusedTangent]


@eqx.filter_custom_jvp
def solve(balance: Balance, guess: Rows, settings: Settings, reused: ReusedTangent) -> Solution:
    """Find the correction of the unknowns that balances the forces at a stage.

    Convergence is judged by the residual, relative to the largest force in it; where round-off may
    dominate, iterations go on while they gain anything. The tangent of one iteration serves the
    next one if that suffices (chord method), and ``reused``, from the solve before, the first ones.
    The derivative of the solution follows from the converged tangent, solved once (implicit
    function theorem), so iterations are never differentiated.

    Returns the correction (m, zero on prescribed nodes), the forces that hold the ghost node and
    the root if they are prescribed (N), the outcome, and the tangent for the next solve; a failure
    is an outcome, never an exception.

    In a batch on a CPU each solution is found separately: together all would need as many
    iterations as the slowest, a tangent in each, and more memory than a cache has.
    """
    arrays, rest = eqx.partition((balance, guess, settings, reused), eqx.is_array)

    def search(arrays: Any) -> Solution:
        return _iterate(*eqx.combine(arrays, rest))

    alone = jax.default_backend() == "cpu"
    return (sequential_vmap(search) if alone else search)(arrays)


def _iterate(balance: Balance, guess: Rows, settings: Settings, reused: ReusedTangent) -> Solution:
    forces, stage = balance.forces, balance.stage
    # friction of the arm on itself, or of a free body, lets whole steps alternate between two
    # shapes where it sticks; a static solve, which has none, limits its turns and must pass larger
    # imbalances
    searches = (bool(forces.far_contacts) or forces.turns) and settings.max_turn is None
    none = Outcome.of_nothing(converged=False)
    start = _Iteration(
        guess,
        jnp.zeros_like(guess),
        replace(none, residual=jnp.asarray(jnp.inf)),
        jnp.asarray(0),
        reused.tangent,
        reused.floor,
        jnp.where(reused.by_acceleration == stage.by_acceleration, reused.contraction, 1.0),
        jnp.asarray(False),
        jnp.asarray(False),
        jnp.asarray(False),
        jnp.zeros_like(guess) if searches else None,
    )
    wasted, again = jnp.asarray(0), jnp.asarray(False)
    if forces.far_contacts and searches:
        # XLA makes one kernel of a loop without the scatters and the dense solver of far parts: so
        # first without them, unless some touched before. In statics an arm could pass itself
        alone = replace(balance, forces=replace(forces, far_contacts=()))
        touched = jnp.isinf(reused.contraction)
        found = _loop(alone, guess, settings, replace(start, done=touched))
        again = touched | _touches(balance, found.correction) | ~found.outcome.converged
        wasted = jnp.where(again, found.count, 0)
        start = replace(
            found,
            correction=jnp.where(again, guess, found.correction),
            count=jnp.where(again, 0, found.count),
            contraction=jnp.where(again, 1.0, found.contraction),
            refresh=found.refresh & ~again,
            done=~again,
        )
    end = _loop(balance, guess, settings, start)
    outcome = replace(end.outcome, iterations=end.count + wasted)
    # contact of far parts is not in the factors that are kept; a good guess needs none
    touches = end.touches
    if forces.far_contacts and searches:
        touches |= jax.lax.cond(again, lambda: _touches(balance, end.correction), lambda: again)
    contraction = jnp.where(touches, jnp.inf, jnp.maximum(end.contraction, AGED_CONTRACTION))
    reused = ReusedTangent(end.tangent, contraction, stage.by_acceleration, end.floor)
    return end.correction, end.residual[:BOUNDARY_NODES], outcome, reused


def _loop(balance: Balance, guess: Rows, settings: Settings, start: _Iteration) -> _Iteration:
    forces, stage = balance.forces, balance.stage
    searches = start.change is not None

    def iterate(carry: _Iteration) -> _Iteration:
        # evaluated in one place, for the guess and its successors: elements are most of a program
        correction, before = carry.correction, carry.outcome
        motion = balance.motion(correction)
        residual, largest = balance.residual(motion)
        unbalanced, floor = (_as_forces(balance, settings, r) for r in (residual, carry.floor))
        outcome = _outcome(unbalanced, floor, settings, jnp.max(settings.weights * largest))
        # the same tangent contracts about twice less in the next iteration
        contraction = jnp.where(
            carry.count > 0, outcome.residual / before.residual, carry.contraction
        )
        allowed = settings.tolerance * outcome.scale + NOISE * floor
        # a reused tangent may need two iterations: they cost less than one with a new tangent
        left_over = jnp.where(carry.count > 0, contraction, contraction**2) * unbalanced
        suffices = jnp.all(CHORD_MARGIN * left_over <= allowed) & ~carry.touches
        stalled = outcome.converged & carry.refresh & (contraction > STALLED)
        # corrections below round-off, which change nothing
        stalled |= carry.refresh & jnp.all(residual == carry.residual)
        # the tangent of an earlier step failed: back to the guess, with one of this step
        astray = (carry.count > 0) & ~carry.refresh & ~(contraction < 1.0)
        sound = jnp.isfinite(outcome.residual) | astray
        left = (carry.count < settings.max_iterations) & sound
        done = jnp.all(unbalanced <= allowed) | stalled | ~left

        # back by half of the last change, while it gains nothing
        worse = searches & (carry.count > 0) & carry.refresh & ~done & ~(contraction < 1.0)

        def correct(one: tuple[Rows, TangentFactors, Rows, Array, Array]) -> Any:
            correction, tangent, floor, _, _ = one

            def renewed() -> tuple[TangentFactors, Rows, Rows | None, Array]:
                whole = balance.tangent(motion)
                # a prediction and its correction may be far larger than their sum
                rounded = jnp.abs(motion.position) + jnp.abs(correction)
                floor = ROUNDING * np.finfo(float).eps * whole.times_sizes(rounded)
                return whole.factorise(), floor, whole.solve_touching(-residual), whole.touches

            def kept() -> tuple[TangentFactors, Rows, Rows | None, Array]:
                apart = jnp.zeros_like(residual) if forces.far_contacts else None
                return tangent, floor, apart, jnp.asarray(False)

            tangent, floor, touching, touches = jax.lax.cond(suffices, kept, renewed)
            change = tangent.solve(-residual)
            if touching is not None:
                change = jnp.where(touches, touching, change)
            if settings.max_turn is not None:
                nodes = forces.nodes(stage.position)
                turn = _largest_turn(nodes, forces.nodes(change), forces.axes)
                change *= jnp.minimum(1.0, settings.max_turn / turn)
            if settings.max_move is not None:
                change *= jnp.minimum(1.0, settings.max_move / _largest(change[:, : forces.axes]))
            return correction + change, tangent, floor, touches, jnp.asarray(False)

        # a loop of one pass or none: `cond` in a batch would compute both branches
        following, tangent, rounding, touches, _ = jax.lax.while_loop(
            lambda one: one[4],
            correct,
            (correction, carry.tangent, carry.floor, carry.touches, ~(done | astray | worse)),
        )
        back = astray & ~done
        following = jnp.where(back, guess, following)
        change = None
        if carry.change is not None:
            following = jnp.where(worse, correction - 0.5 * carry.change, following)
            change = jnp.where(worse, 0.5 * carry.change, following - correction)
            outcome = jax.tree.map(lambda x, y: jnp.where(worse, x, y), before, outcome)
            contraction = jnp.where(worse, carry.contraction, contraction)
        # without a known contraction then
        outcome = replace(outcome, residual=jnp.where(back, jnp.nan, outcome.residual))
        refresh = carry.refresh | astray | ~suffices
        count = carry.count + ~done
        return _Iteration(
            following,
            residual,
            outcome,
            count,
            tangent,
            rounding,
            contraction,
            touches,
            refresh,
            done,
            change,
        )

    return jax.lax.while_loop(lambda carry: ~carry.done, iterate, start)


@solve.def_jvp
def _solve_jvp(primals: Any, tangents: Any) -> Any:
    *found, reused = solve(*primals)  # nothing that is differentiated needs the tangent
    correction, held, outcome = jax.tree.map(lambda x: checkpoint_name(x, SOLVED), found)
    tangent = primals[0].tangent(primals[0].motion(correction))
    t_correction, t_held = implicit_derivative(primals[0], tangents[0], correction, tangent)
    values = (correction, held, outcome, reused)
    return values, (t_correction, t_held, zero_tangents(outcome), zero_tangents(reused))


def _as_forces(balance: Balance, settings: Settings, rows: Rows) -> Float[Array, "unknown b"]:
    """Return the sizes of the unknown rows of a residual, torques as forces (N)."""
    forces = balance.forces
    return settings.weights * jnp.abs(forces.unknown(rows, 1 / forces.reach))


def _outcome(
    unbalanced: Float[Array, "unknown b"],
    floor: Float[Array, "unknown b"],
    settings: Settings,
    scale: Float[Array, ""],
) -> Outcome:
    """Return the outcome of a motion by the sizes of its residual."""
    of_rows = jnp.max(unbalanced, axis=1)
    return replace(
        Outcome.of_nothing(converged=False),
        converged=jnp.all(unbalanced <= settings.tolerance * scale + floor),
        residual=jnp.max(of_rows),
        scale=scale,
        worst_node=jnp.argmax(of_rows) + BOUNDARY_NODES - 1,
    )


def _touches(balance: Balance, correction: Rows) -> Bool[Array, ""]:
    """Return whether far parts of the arm are in contact."""
    return balance.forces.touches(balance.motion(correction).position)


def _largest_turn(position: Rows, change: Rows, axes: int) -> Float[Array, ""]:
    apart, moved = (jnp.diff(rows[:, :axes], axis=0) for rows in (position, change))
    ratio = jnp.sum(moved**2, axis=1) / jnp.sum(apart**2, axis=1)
    turn = jnp.sqrt(jnp.max(ratio)) + jnp.finfo(float).tiny
    return turn if change.shape[1] == axes else jnp.maximum(turn, _largest(change[:, axes:]))


def _largest(change: Rows) -> Float[Array, ""]:
    return jnp.max(jnp.abs(change))
