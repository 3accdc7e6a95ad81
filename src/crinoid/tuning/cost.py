"""The cost of a controller over one run, and its slope."""

from __future__ import annotations

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from crinoid.control import Controller
from crinoid.dynamics import State
from crinoid.programs import OFTEN, compiled
from crinoid.scenario import Scenario
from crinoid.simulation import Loop, rollout
from crinoid.space import POSE

_EFFORT_TIME = 0.01
"""Time over which the speed of inputs counts like an error of the tip (s)."""
_FEW = 3
"""How many numbers forward mode is faster for: it takes half a run for each, reverse mode two runs
for all of them."""


class Weights(NamedTuple):
    """Lengths that turn what is compared into metres."""

    pose: Float[np.ndarray, " pose"]
    """Weights of the errors of the tip's pose; 0 for what is not controlled."""
    inputs: Float[np.ndarray, " input"]
    """Weights of the inputs."""

    @staticmethod
    def of(scenario: Scenario, loop: Loop) -> Weights:
        """Return those of a scenario: an angle and a share count over the arm's length."""
        length, axes = scenario.arm.length, scenario.arm.dimension
        controlled = scenario.control.controlled
        pose = [
            (1.0 if index < axes else length) * (name.partition("_")[0] in controlled)
            for index, name in enumerate(POSE[axes])
        ]
        inputs = [1.0 if each.unit == "m" else length for each in loop.system.inputs]
        return Weights(np.array(pose), np.array(inputs))


class Cost(eqx.Module):
    """The cost of a controller over one run."""

    total: Float[Array, ""]
    """Mean squared error of what is controlled, and the penalty on the speed of inputs (m2)."""
    slope: Float[Array, " number"]
    """Its slope by the logarithm of each number that is tuned (m2)."""
    error: Float[Array, ""]
    """Mean squared distance of the tip from its target (m2)."""
    converged: Bool[Array, ""]
    """Whether all time steps succeeded."""
    reason: Int[Array, ""]
    """Why the first one that did not failed (`crinoid.dynamics.Reason`)."""
    steps: Int[Array, ""]
    """Time steps that succeeded."""


@compiled(**OFTEN)
def cost(
    controller: Controller, slopes: Any, loop: Loop, state: State, weights: Weights, steps: int
) -> Cost:
    """Run a loop with another controller, and return what it costs.

    ``slopes`` are the derivatives of the controller's numbers by the logarithms
    (`crinoid.tuning.design.Around`).
    """
    count = jax.tree.leaves(slopes)[0].shape[0]

    def of(logs: Array) -> tuple[Array, Cost]:
        moved = jax.tree.map(lambda each: jnp.tensordot(logs, each, 1), slopes)
        changed = eqx.apply_updates(controller, moved)
        run = rollout(eqx.tree_at(lambda x: x.controller, loop, changed), state, steps)
        seen, axes = run.kept, loop.system.forces.axes
        error = jnp.mean(jnp.sum((weights.pose * seen.error) ** 2, axis=1))
        moves = jnp.diff(seen.command, axis=0, prepend=0.0) * weights.inputs
        # a command is held for a period of the controller
        speed = jnp.sum(moves**2) / (loop.clock.period * steps * loop.system.time_step)
        total = error + _EFFORT_TIME**2 * speed
        distance = jnp.mean(jnp.sum(seen.error[:, :axes] ** 2, axis=1))
        outcome = run.outcome
        return total, Cost(total, logs, distance, outcome.converged, outcome.reason, run.end.steps)

    derivative = jax.jacfwd if count <= _FEW else jax.grad
    slope, found = derivative(of, has_aux=True)(jnp.zeros(count))
    return eqx.tree_at(lambda x: x.slope, found, slope)
