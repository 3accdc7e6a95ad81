"""Newton's method on the balance of forces, with the derivative of its solution."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from crinoid import chain
from crinoid.dynamics.forces import Forces
from crinoid.dynamics.integrator import Stage
from crinoid.rod import Rod

Nodes = Float[Array, "n b"]

HELD = 2
"""The ghost node and the root: their motion is prescribed, not solved for."""


class Outcome(eqx.Module):
    """How a solve ended."""

    converged: Bool[Array, ""]
    iterations: Int[Array, ""]
    residual: Float[Array, ""]
    """Largest imbalance of a node (N)."""
    scale: Float[Array, ""]
    """Largest single force in the balance (N)."""
    worst_node: Int[Array, ""]
    """Node with the largest imbalance; the root is 0."""

    @staticmethod
    def of_nothing(*, converged: bool) -> "Outcome":
        """Return the outcome of no iterations, to start a loop with."""
        none, zero = jnp.asarray(0), jnp.zeros(())
        return Outcome(jnp.asarray(converged), none, zero, zero, none)


class Settings(eqx.Module):
    """When Newton's method is done, and when it gives up."""

    tolerance: Float[Array, ""]
    """Largest imbalance over the largest force in it."""
    floor: Float[Array, ""]
    """Imbalance below which round-off rules (N)."""
    max_iterations: Int[Array, ""]
    max_turn: Float[Array, ""] | None = None
    """Largest relative displacement of neighbours in one iteration, over their distance.

    Keeps edges from flipping in a static solve from a distant guess; a time step needs no limit.
    """

    @staticmethod
    def for_rod(rod: Rod, tolerance: float | Array, max_iterations: int | Array) -> "Settings":
        """Set the floor to the round-off of the forces that stretch and bend a rod."""
        length = rod.rest_length
        stretching = jnp.max(rod.EA / length)
        bending = 4.0 * jnp.max(rod.EI) / jnp.min(length) ** 3
        floor = 16 * jnp.finfo(float).eps * (stretching + bending) * rod.length
        return Settings(jnp.asarray(tolerance), floor, jnp.asarray(max_iterations))


@eqx.filter_custom_jvp
def solve(
    forces: Forces, stage: Stage, guess: Nodes, settings: Settings, load_factor: Array | None
) -> tuple[Nodes, Outcome]:
    """Find the correction of the free nodes that balances the forces at a stage.

    Convergence is judged by the residual, relative to the largest force in it. The derivative of
    the solution comes from the converged tangent, solved once (implicit function theorem), so
    iterations are never differentiated.

    Returns the correction (m, zero on the nodes that the base holds) and the outcome; a failure
    is an outcome, never an exception.
    """

    def evaluate(correction: Nodes) -> tuple[Nodes, Outcome]:
        residual, scale = forces.residual(forces.motion(stage, correction), load_factor)
        imbalance = jnp.max(jnp.abs(residual[HELD:]), axis=1)
        worst = jnp.argmax(imbalance)
        return residual, Outcome(
            imbalance[worst] <= settings.tolerance * scale + settings.floor,
            jnp.asarray(0),
            imbalance[worst],
            scale,
            worst + HELD - 1,
        )

    def unfinished(carry: tuple[Nodes, Nodes, Outcome]) -> Bool[Array, ""]:
        _, _, outcome = carry
        return (
            ~outcome.converged
            & (outcome.iterations < settings.max_iterations)
            & jnp.isfinite(outcome.residual)
        )

    def iterate(carry: tuple[Nodes, Nodes, Outcome]) -> tuple[Nodes, Nodes, Outcome]:
        correction, residual, before = carry
        change = _newton_step(forces, stage, correction, residual, load_factor)
        if settings.max_turn is not None:
            change *= jnp.minimum(1.0, settings.max_turn / _largest_turn(stage, change))
        correction = correction + change
        residual, outcome = evaluate(correction)
        counted = eqx.tree_at(lambda o: o.iterations, outcome, before.iterations + 1)
        return correction, residual, counted

    correction, _, outcome = jax.lax.while_loop(unfinished, iterate, (guess, *evaluate(guess)))
    return correction, outcome


@solve.def_jvp
def _solve_jvp(primals: Any, tangents: Any) -> Any:
    forces, stage, guess, settings, load_factor = primals
    t_forces, t_stage, _, _, t_load_factor = tangents
    correction, outcome = solve(forces, stage, guess, settings, load_factor)
    tangent = implied((forces, stage, load_factor), (t_forces, t_stage, t_load_factor), correction)
    return (correction, outcome), (tangent, constant(outcome))


def implied(primals: Any, tangents: Any, correction: Nodes) -> Nodes:
    """Return how a converged correction follows forces, stage and load factor."""

    def residual(forces: Forces, stage: Stage, load_factor: Array | None) -> Nodes:
        return forces.residual(forces.motion(stage, correction), load_factor)[0]

    _, t_residual = eqx.filter_jvp(residual, primals, tangents)
    forces, stage, load_factor = primals
    return _newton_step(forces, stage, correction, t_residual, load_factor)


def constant(outcome: Outcome) -> Any:
    """Return the tangent of what does not depend on anything."""
    return jax.tree.map(lambda x: jnp.zeros_like(x) if eqx.is_inexact_array(x) else None, outcome)


def _newton_step(
    forces: Forces, stage: Stage, correction: Nodes, residual: Nodes, load_factor: Array | None
) -> Nodes:
    bands = forces.tangent(stage, forces.motion(stage, correction), load_factor)
    free = chain.solve(bands[HELD:], -residual[HELD:])
    return jnp.pad(free, ((HELD, 0), (0, 0)))


def _largest_turn(stage: Stage, change: Nodes) -> Float[Array, ""]:
    apart = stage.position[1:] - stage.position[:-1]
    moved = stage.by_position * (change[1:] - change[:-1])
    ratio = jnp.sum(moved**2, axis=1) / jnp.sum(apart**2, axis=1)
    return jnp.sqrt(jnp.max(ratio)) + jnp.finfo(float).tiny
