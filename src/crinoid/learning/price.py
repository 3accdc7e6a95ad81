"""The price of a time step: the error of the tip, and what the inputs do."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from crinoid.assembly.known import fastest
from crinoid.assembly.numbers import array
from crinoid.assembly.observables import Observables
from crinoid.assembly.plan import Plan
from crinoid.assembly.regulator import EFFORT

_KNEE = 4.0
"""Error, over the one that counts as much as an input at its greatest speed, from which on it is
charged for its size and no more for its square: one that is far off should not drown all others."""


class Price(eqx.Module):
    """The cost of time steps, without unit.

    It is that of LQG (`crinoid.assembly.regulator.Regulator`) but for the integral of the error:
    the square of the error of what is controlled over the scenario's smoothness, and the squares
    of the speeds of the commands over the greatest ones.
    """

    weight: Float[Array, " pose"]
    """Over the error of each coordinate that is controlled; 0 for the others (1/m, 1/rad)."""
    speed: Float[Array, " input"]
    """One over the largest move of each command in a control period, 0 for one that stays."""
    held: Float[Array, " input"]
    """Over each command (1/its unit)."""
    per_step: Float[Array, ""]
    """Control periods in a time step."""
    unit: Float[Array, ""]
    """Cost that counts as one."""

    @staticmethod
    def of(plan: Plan, observables: Observables) -> Price:
        """Return the prices of a scenario."""
        scenario, rows = plan.scenario, np.array(observables.driven)
        columns, scale = plan.controlled
        worth = scenario.control.lqg.smoothness_on(scenario.arm.length)
        weight = np.zeros(plan.sensors[0].noise.shape[0])
        weight[columns] = scale / worth
        speed, held = np.zeros((2, len(plan.inputs)))
        speed[rows] = 1 / (plan.period * fastest(plan)[rows])
        held[rows] = [2 * EFFORT / (each.upper - each.lower) for each in observables.actions]
        step = float(plan.system.time_step)
        return Price(*map(array, (weight, speed, held, step / plan.period, 1.0)))

    def __call__(
        self,
        error: Float[Array, "steps pose"],
        command: Float[Array, "steps input"],
        before: Float[Array, " input"],
    ) -> Float[Array, " steps"]:
        """Return the cost of each of some time steps.

        Parameters
        ----------
        error
            Wanted pose less that of the tip at the end of each (m, rad).
        command
            Commands during each, in the units of the inputs.
        before
            Commands before the first one.
        """
        off = jnp.sum((self.weight * error) ** 2, axis=1)
        off = 2 * _KNEE**2 * (jnp.sqrt(1 + off / _KNEE**2) - 1)
        moves = jnp.diff(jnp.concatenate([before[None], command]), axis=0)
        # a command is held for a period, in which it counts once
        effort = jnp.sum((self.speed * moves) ** 2, axis=1) / self.per_step
        return (off + effort + jnp.sum((self.held * command) ** 2, axis=1)) / self.unit
