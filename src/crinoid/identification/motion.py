"""The motion of the tip, and how it depends on numbers of the scenario."""

from __future__ import annotations

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from crinoid.assembly.parameters import Parameters
from crinoid.dynamics import Outcome, State, System
from crinoid.programs import OFTEN, compiled
from crinoid.simulation import Loop, rollout, with_parameters


class Motion(NamedTuple):
    """The motion of the tip over a run."""

    path: Float[Array, "instant seen"]
    """Pose of the tip, place of the root (m) and length (m) at the ends of the time steps."""
    slope: Float[Array, "parameter instant seen"]
    """Its derivatives by the parameters."""
    at_rest: Bool[Array, ""]
    """Whether the state at the start was found."""
    converged: Bool[Array, ""]
    reason: Int[Array, ""]
    """Why the first time step that did not converge failed (`crinoid.dynamics.Reason`)."""
    steps: Int[Array, ""]
    """Time steps that succeeded."""


@compiled(**OFTEN)
def motion(
    loop: Loop, parameters: Parameters, tangents: Parameters, steps: int, *, still: bool
) -> Motion:
    """Run a loop with other numbers, forward in time with all derivatives at once.

    Parameters
    ----------
    loop
        As `crinoid.closed_loop` gives it.
    parameters
        Numbers that it is to have.
    tangents
        Derivatives of their arrays by the parameters, those in front; None for other leaves.
    steps
        Number of time steps.
    still
        Whether the arm starts in equilibrium, and not at rest without loads.
    """
    numbers, others = eqx.partition(parameters, eqx.is_inexact_array)

    def run(numbers: Parameters) -> tuple[Array, tuple[Outcome, Outcome, Array]]:
        changed = with_parameters(loop, eqx.combine(numbers, others))
        system = changed.system
        state, found = (
            system.find_equilibrium()
            if still
            else (system.rest(), Outcome.of_nothing(converged=True))
        )
        done = rollout(changed, state, steps, observe=lambda _, now: _seen(system, now.state))
        path = jnp.concatenate([_seen(system, state)[None], done.kept])
        return path, (found, done.outcome, done.end.steps)

    def along(tangent: Parameters) -> tuple[Array, Array, tuple[Outcome, Outcome, Array]]:
        return jax.jvp(run, (numbers,), (tangent,), has_aux=True)

    # the motion itself is computed once for all directions
    path, slope, (found, outcome, count) = jax.vmap(along, out_axes=(None, 0, None))(tangents)
    return Motion(path, slope, found.converged, outcome.converged, outcome.reason, count)


def _seen(system: System, state: State) -> Float[Array, " seen"]:
    nodes = state.position[1:]  # one lies behind the root
    length = jnp.linalg.norm(jnp.diff(nodes, axis=0), axis=1).sum()
    return jnp.concatenate([system.tip(state), system.forces.origin + nodes[0], length[None]])
