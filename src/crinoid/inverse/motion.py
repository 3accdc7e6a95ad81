"""Simulated motions and holds of an arm, with their derivatives by parameters."""

from __future__ import annotations

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from crinoid.assembly.parameters import Parameters
from crinoid.assembly.system import assemble
from crinoid.assembly.threads import ThreadParameters
from crinoid.compilation import ONCE, SOMETIMES, compiled
from crinoid.dynamics import Outcome, State, System
from crinoid.inverse.experiment_record import Holds
from crinoid.inverse.marker import MarkerWeights
from crinoid.simulation import Loop, rollout, with_parameters

Numbers = tuple[Parameters, MarkerWeights]


class ArmPlaces(NamedTuple):
    """Places of the arm at an instant, or at many."""

    marker: Float[Array, "*instant place output"]
    """Pose of the tip (m, rad), and places of the markers (m)."""
    root: Float[Array, "*instant d"]  # place of the root (m)
    length: Float[Array, "*instant"]  # length of the arm (m)

    @staticmethod
    def of(system: System, weights: MarkerWeights, state: State) -> ArmPlaces:
        """Return the places in a state."""
        nodes = state.position[1:]  # the first node is behind the root
        length = jnp.linalg.norm(jnp.diff(nodes, axis=0), axis=1).sum()
        places = weights.places(system, state)
        return ArmPlaces(places, system.forces.origin + nodes[0], length)


class ArmMotion(NamedTuple):
    """Motion of an arm in a run, or its holds one after another, with the sensitivities."""

    places: ArmPlaces  # places at the ends of the time steps, or in the holds
    sensitivity: Float[Array, "parameter instant place output"]
    """Derivatives of the places of the markers by the parameters."""
    at_rest: Bool[Array, ""]  # whether an initial state was found, or the equilibria of all holds
    converged: Bool[Array, ""]
    reason: Int[Array, ""]
    """Why the first time step that did not converge failed (`crinoid.dynamics.Reason`)."""
    steps: Int[Array, ""]  # number of time steps that succeeded, or of holds


@compiled(**ONCE)
def _start(
    parameters: Parameters, tangents: Parameters, *, equilibrium: bool
) -> tuple[State, State, Outcome]:
    """Return the initial state, its derivatives by the parameters, and the solver's outcome.

    The arm starts in equilibrium, or at rest without loads. ``tangents`` are the derivatives of the
    arrays, with the parameters as first axis, and None for constant leaves.
    """
    numbers, others = eqx.partition(parameters, eqx.is_inexact_array)

    def start(numbers: Parameters) -> tuple[State, tuple[State, Outcome]]:
        system = assemble(eqx.combine(numbers, others))
        state, found = (
            system.find_equilibrium()
            if equilibrium
            else (system.rest(), Outcome.of_nothing(converged=True))
        )
        values, rest = eqx.partition(state, eqx.is_inexact_array)
        return values, (rest, found)

    def along(tangent: Parameters) -> tuple[State, State, tuple[State, Outcome]]:
        return jax.jvp(start, (numbers,), (tangent,), has_aux=True)

    values, slope, (rest, found) = jax.vmap(along, out_axes=(None, 0, None))(tangents)
    return eqx.combine(values, rest), slope, found


@compiled(**SOMETIMES)  # a search finds hundreds
def _hold(numbers: Numbers, tangents: Numbers) -> tuple[Array, tuple[ArmPlaces, Array]]:
    """Return an equilibrium: derivatives, places, and whether there is one."""
    numbers, others = eqx.partition(numbers, eqx.is_inexact_array)

    def settle(numbers: Numbers) -> tuple[Array, tuple[ArmPlaces, Array]]:
        parameters, weights = eqx.combine(numbers, others)
        system = assemble(parameters)
        state, found = system.find_equilibrium()
        places = ArmPlaces.of(system, weights, state)
        return places.marker, (places, found.converged)

    def along(tangent: Numbers) -> tuple[Array, tuple[ArmPlaces, Array]]:
        return jax.jvp(settle, (numbers,), (tangent,), has_aux=True)[1:]

    return jax.vmap(along, out_axes=(0, None))(tangents)


@compiled(**SOMETIMES)
def _follow(
    loop: Loop,
    numbers: Numbers,
    tangents: Numbers,
    state: State,
    state_tangents: State,
    at_rest: Bool[Array, ""],
    steps: int,
) -> ArmMotion:
    both, others = eqx.partition((numbers, state), eqx.is_inexact_array)

    def run(both: tuple[Numbers, State]) -> tuple[Array, tuple[ArmPlaces, Outcome, Array]]:
        (parameters, weights), start = eqx.combine(both, others)
        changed = with_parameters(loop, parameters)

        def places(state: State) -> ArmPlaces:
            return ArmPlaces.of(changed.system, weights, state)

        done = rollout(changed, start, steps, observe=lambda _, now: places(now.state))
        path = jax.tree.map(lambda x, y: jnp.concatenate([x[None], y]), places(start), done.kept)
        return path.marker, (path, done.outcome, done.end.steps)

    def along(tangent: tuple[Numbers, State]) -> tuple[Array, tuple[ArmPlaces, Outcome, Array]]:
        return jax.jvp(run, (both,), (tangent,), has_aux=True)[1:]

    # the primal motion is computed once for all directions
    slope, (path, outcome, count) = jax.vmap(along, out_axes=(0, None))((tangents, state_tangents))
    return ArmMotion(path, slope, at_rest, outcome.converged, outcome.reason, count)


def follow(
    loop: Loop, numbers: Numbers, tangents: Numbers, steps: int, *, equilibrium: bool
) -> ArmMotion:
    """Run the loop from rest or from equilibrium.

    ``tangents`` are the derivatives of the arrays, with the parameters as first axis, and None for
    constant leaves.
    """
    state, slope, found = _start(numbers[0], tangents[0], equilibrium=equilibrium)
    run = _follow(loop, numbers, tangents, state, slope, found.converged, steps)
    return jax.tree.map(np.asarray, run)


def settle(numbers: Numbers, tangents: Numbers, holds: Holds) -> ArmMotion:
    """Find the holds, one after another, up to the first one without an equilibrium."""
    slopes, found, converged = [], [], True
    for shares in holds.shares:
        held, along = _under(numbers, holds, shares), _under(tangents, holds, 0 * shares)
        slope, (places, settled) = _hold(held, along)
        slopes.append(slope)
        found.append(places)
        converged = bool(settled)
        if not converged:
            break
    path = jax.tree.map(lambda *each: jnp.stack(each), *found)
    end = (jnp.asarray(x) for x in (converged, converged, 0, len(found)))
    return jax.tree.map(np.asarray, ArmMotion(path, jnp.stack(slopes, axis=1), *end))


def _under(numbers: Numbers, holds: Holds, shares: Float[np.ndarray, " thread"]) -> Numbers:
    """Return the numbers, or their derivatives, with the shares of a hold."""
    if not holds.threads:
        return numbers
    threads = numbers[0].actuator[0]
    assert isinstance(threads, ThreadParameters)
    which = np.array(holds.threads)
    held = threads.shares.at[..., which, :].set(jnp.asarray(shares)[:, None])
    changed = held, threads.constant.at[..., which].set(0.0)
    return eqx.tree_at(
        lambda each: (each[0].actuator[0].shares, each[0].actuator[0].constant), numbers, changed
    )
