"""Newton's method on the balance of forces, with the derivative of its solution."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.ad_checkpoint import checkpoint_name
from jax.custom_batching import sequential_vmap
from jaxtyping import Array, Bool, Float, Int

from crinoid.dynamics.forces import Forces
from crinoid.dynamics.integrator import Stage
from crinoid.dynamics.outcome import Outcome
from crinoid.dynamics.surroundings import Surroundings
from crinoid.dynamics.tangent import HELD, Factorised, Tangent
from crinoid.rod import Rod

Rows = Float[Array, "rows b"]

SOLVED = "solved"
"""Name of solutions under `jax.checkpoint`: a policy that saves them spares solving again."""
_NOISE = 1 / 16
"""Share of the floor that round-off makes up in any case."""
_MARGIN = 4.0
"""Factor by which an iteration with an old tangent must be expected to suffice."""
_AGED = 1e-3
"""Least share of the imbalance that an iteration with the tangent of an earlier step may leave.

One with a new tangent may leave far less, by which nothing can be told of the next step.
"""
_STALLED = 0.5
"""Share of the imbalance from which on what an iteration leaves of it is no progress."""


class Settings(eqx.Module):
    """When Newton's method is done, and when it gives up."""

    tolerance: Float[Array, ""]
    """Largest imbalance over the largest force in it."""
    floor: Float[Array, ""]
    """Imbalance below which round-off may rule (N): there an iteration need not gain anything."""
    max_iterations: Int[Array, ""]
    """Iterations after which a solve has failed."""
    weights: Float[Array, " b"]
    """Factors from the imbalance of each coordinate to a force: 1, of a spin one over a length."""
    max_turn: Float[Array, ""] | None = None
    """Largest relative displacement of neighbours in one iteration, over their distance; in space
    also the largest spin (rad).

    Keeps edges from flipping in a static solve from a distant guess; a time step needs no limit.
    """
    max_move: Float[Array, ""] | None = None
    """Largest displacement in one iteration (m), so that a static solve jumps over no obstacle."""

    @staticmethod
    def for_rod(
        rod: Rod,
        tolerance: float | Array,
        max_iterations: int | Array,
        lines: float | Array = 0.0,
    ) -> "Settings":
        """Set the floor to the round-off of the forces that stretch, bend and twist a rod.

        A position on a rod of length L is known to about eps L, so the strain of an edge l to
        eps L / l, and that of a line along the rod to eps; ``lines`` is the largest stiffness of
        one (N). The floor is well above that.
        """
        length = rod.rest_length
        stretching = jnp.max(rod.EA / length) * rod.length
        bending = 4.0 * jnp.max(rod.EI) / jnp.min(length) ** 3 * rod.length
        twisting = 0.0 if rod.GJ is None else jnp.max(rod.GJ) / jnp.min(length) ** 2
        floor = jnp.finfo(float).eps / _NOISE * (stretching + bending + twisting + lines)
        weights = jnp.ones(rod.axes)
        if rod.axes == 3:
            weights = jnp.append(weights, 1.0 / jnp.mean(length))  # a couple on the ends of an edge
        return Settings(jnp.asarray(tolerance), floor, jnp.asarray(max_iterations), weights)


class Kept(eqx.Module):
    """A tangent that one solve leaves to the next: most of what an iteration costs."""

    tangent: Factorised
    share: Float[Array, ""]
    """Share of the imbalance that an iteration with it leaves; 1 where there is none."""
    by_acceleration: Float[Array, ""]
    """Factor of the acceleration in the stage that it was made for (1/s2), by which a step of
    another length is told."""

    @staticmethod
    def nothing(forces: Forces, rows: Rows) -> "Kept":
        """Return the place for what will be kept."""
        nodes, size = forces.nodes(rows).shape
        lines = 0 if forces.lines is None else forces.lines.rest.size
        tangent = Factorised.blank(nodes, size, forces.extra(size), lines)
        return Kept(tangent, jnp.ones(()), jnp.zeros(()))


class _Search(eqx.Module):
    """How far Newton's method is."""

    correction: Rows
    """To be judged next; the result, once that is done."""
    residual: Rows
    """Imbalance of the correction judged last."""
    outcome: Outcome
    """Outcome of that correction; its iterations are in ``count``."""
    count: Int[Array, ""]
    """Iterations so far."""
    tangent: Factorised
    """The one of the last iteration, which may do for the next."""
    share: Float[Array, ""]
    """Share of the imbalance that it left."""
    anew: Bool[Array, ""]
    """Whether the tangent is not, or no longer to be, that of an earlier step."""
    done: Bool[Array, ""]


@eqx.filter_custom_jvp
def solve(
    forces: Forces,
    around: Surroundings,
    stage: Stage,
    guess: Rows,
    settings: Settings,
    load_factor: Array | None,
    kept: Kept,
) -> tuple[Rows, Float[Array, "held b"], Outcome, Kept]:
    """Find the correction of what is free to move that balances the forces at a stage.

    The water is that of ``around``. Convergence is judged by the residual, relative to the
    largest force in it; where round-off may rule, iterations go on as long as they gain anything.
    The tangent of one iteration serves the next one where that will do (chord method), and the one
    ``kept`` from the solve before the first ones.
    The derivative of the solution comes from the converged tangent, solved once (implicit
    function theorem), so iterations are never differentiated.

    Returns the correction (m, zero on what is prescribed), the forces that hold the ghost node and
    the root where they are prescribed to be (N), the outcome, and what the next solve may use; a
    failure is an outcome, never an exception.

    In a batch on a processor each solution is found by itself: together all would take as many
    iterations as the slowest, a tangent in each, and as much memory as no cache has.
    """
    arrays, rest = eqx.partition(
        (forces, around, stage, guess, settings, load_factor, kept), eqx.is_array
    )

    def search(given: Any) -> tuple[Rows, Float[Array, "held b"], Outcome, Kept]:
        return _search(*eqx.combine(given, rest))

    alone = jax.default_backend() == "cpu"
    return (sequential_vmap(search) if alone else search)(arrays)


def _search(
    forces: Forces,
    around: Surroundings,
    stage: Stage,
    guess: Rows,
    settings: Settings,
    load_factor: Array | None,
    kept: Kept,
) -> tuple[Rows, Float[Array, "held b"], Outcome, Kept]:
    """Do what `solve` does, for one."""

    def unfinished(carry: _Search) -> Bool[Array, ""]:
        return ~carry.done

    def iterate(carry: _Search) -> _Search:
        # what is judged here, the guess or what the last iteration made of it, is described once:
        # the elements are most of a program
        correction, before = carry.correction, carry.outcome
        residual, outcome = imbalance(forces, around, stage, correction, settings, load_factor)
        # an iteration with the same tangent leaves about twice the share that the last one left
        share = jnp.where(carry.count > 0, outcome.residual / before.residual, carry.share)
        allowed = settings.tolerance * outcome.scale + _NOISE * settings.floor
        # a kept tangent may take two iterations: they cost less than one with a new one
        left_over = jnp.where(carry.count > 0, share, share**2) * outcome.residual
        suffices = _MARGIN * left_over <= allowed
        stalled = outcome.converged & carry.anew & (share > _STALLED)
        # the tangent of an earlier step led astray: back to the guess, with one of this step
        astray = (carry.count > 0) & ~carry.anew & ~(share < 1.0)
        sound = jnp.isfinite(outcome.residual) | astray
        left = (carry.count < settings.max_iterations) & sound
        done = (outcome.residual <= allowed) | stalled | ~left

        def correct(one: tuple[Rows, Factorised, Array]) -> tuple[Rows, Factorised, Array]:
            correction, tangent, _ = one
            tangent = jax.lax.cond(
                suffices,
                lambda: tangent,
                lambda: tangent_at(forces, around, stage, correction, load_factor).factorised(),
            )
            change = tangent.solve(-residual)
            if settings.max_turn is not None:
                nodes = forces.nodes(stage.position)
                turn = _largest_turn(nodes, forces.nodes(change), forces.axes)
                change *= jnp.minimum(1.0, settings.max_turn / turn)
            if settings.max_move is not None:
                change *= jnp.minimum(1.0, settings.max_move / _largest(change[:, : forces.axes]))
            return correction + change, tangent, jnp.asarray(False)

        # a loop of one turn or none, not a choice: in a batch that goes together all would do both
        following, tangent, _ = jax.lax.while_loop(
            lambda one: one[2], correct, (correction, carry.tangent, ~(done | astray))
        )
        back = astray & ~done
        following = jnp.where(back, guess, following)
        # of which no share is known then
        outcome = eqx.tree_at(
            lambda o: o.residual, outcome, jnp.where(back, jnp.nan, outcome.residual)
        )
        anew = carry.anew | astray | ~suffices
        count = carry.count + ~done
        return _Search(following, residual, outcome, count, tangent, share, anew, done)

    nothing = Outcome.of_nothing(converged=False)
    start = _Search(
        guess,
        jnp.zeros_like(guess),
        eqx.tree_at(lambda o: o.residual, nothing, jnp.asarray(jnp.inf)),
        jnp.asarray(0),
        kept.tangent,
        jnp.where(kept.by_acceleration == stage.by_acceleration, kept.share, 1.0),
        jnp.asarray(False),
        jnp.asarray(False),
    )
    end = jax.lax.while_loop(unfinished, iterate, start)
    outcome = eqx.tree_at(lambda o: o.iterations, end.outcome, end.count)
    kept = Kept(end.tangent, jnp.maximum(end.share, _AGED), stage.by_acceleration)
    return end.correction, end.residual[:HELD], outcome, kept


@solve.def_jvp
def _solve_jvp(primals: Any, tangents: Any) -> Any:
    forces, around, stage, _, _, load_factor, _ = primals
    t_forces, t_around, t_stage, _, _, t_load_factor, _ = tangents
    *found, kept = solve(*primals)  # which nothing needs that is differentiated
    correction, held, outcome = jax.tree.map(lambda x: checkpoint_name(x, SOLVED), found)
    t_correction, t_held = implied(
        (forces, around, stage, load_factor),
        (t_forces, t_around, t_stage, t_load_factor),
        correction,
        tangent_at(forces, around, stage, correction, load_factor),
    )
    given = (correction, held, outcome, kept)
    return given, (t_correction, t_held, constant(outcome), constant(kept))


@eqx.filter_jit
def imbalance(
    forces: Forces,
    around: Surroundings,
    stage: Stage,
    correction: Rows,
    settings: Settings,
    load_factor: Array | None,
) -> tuple[Rows, Outcome]:
    """Return the residual of a correction, and how near to a balance that is."""
    residual, largest = forces.residual(forces.motion(stage, correction, around), load_factor)
    scale = jnp.max(settings.weights * largest)
    lacking = jnp.abs(forces.unknown(residual, 1 / forces.reach))
    unbalanced = jnp.max(settings.weights * lacking, axis=1)
    most = jnp.max(unbalanced)
    return residual, Outcome(
        converged=most <= settings.tolerance * scale + settings.floor,
        iterations=jnp.asarray(0),
        residual=most,
        scale=scale,
        worst_node=jnp.argmax(unbalanced) + HELD - 1,
        resolved=jnp.asarray(True),
        folded=jnp.asarray(False),
        error=jnp.zeros(()),
    )


def implied(
    primals: Any, tangents: Any, correction: Rows, tangent: Tangent
) -> tuple[Rows, Float[Array, "held b"]]:
    """Return how a converged correction follows forces, water, stage and load factor.

    And how the forces on what is prescribed do. ``tangent`` is the one at the correction.
    """

    def residual(forces: Forces, around: Surroundings, stage: Stage, factor: Array | None) -> Rows:
        return forces.residual(forces.motion(stage, correction, around), factor)[0]

    _, t_residual = eqx.filter_jvp(residual, primals, tangents)
    followed = tangent.solve(-t_residual)
    return followed, t_residual[:HELD] + tangent.on_held(followed)


def constant(known: Any) -> Any:
    """Return the tangent of what does not depend on anything."""
    return jax.tree.map(lambda x: jnp.zeros_like(x) if eqx.is_inexact_array(x) else None, known)


@eqx.filter_jit
def tangent_at(
    forces: Forces,
    around: Surroundings,
    stage: Stage,
    correction: Rows,
    load_factor: Array | None,
) -> Tangent:
    """Return d(residual)/d(correction) at a correction."""
    return forces.tangent(stage, forces.motion(stage, correction, around), around, load_factor)


def _largest_turn(position: Rows, change: Rows, axes: int) -> Float[Array, ""]:
    apart, moved = (jnp.diff(rows[:, :axes], axis=0) for rows in (position, change))
    ratio = jnp.sum(moved**2, axis=1) / jnp.sum(apart**2, axis=1)
    turn = jnp.sqrt(jnp.max(ratio)) + jnp.finfo(float).tiny
    return turn if change.shape[1] == axes else jnp.maximum(turn, _largest(change[:, axes:]))


def _largest(change: Rows) -> Float[Array, ""]:
    return jnp.max(jnp.abs(change))
