"""Model predictive control: the best moves over a horizon, of which the first one is made."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.control.controller import Controller
from crinoid.control.forecast import Forecast
from crinoid.control.lqg import wanted_commands
from crinoid.control.observer import Observer, ObserverState
from crinoid.control.qp import HorizonQp
from crinoid.control.seen import Command, Seen
from crinoid.control.target import pose_error
from crinoid.products import product

Driven = Float[Array, " driven"]

_AT_LIMIT = 1e-6
"""Distance from a limit, over it, that counts as none."""


class MpcMemory(eqx.Module):
    """Numbers that a predictive controller carries from one call to the next."""

    observed: ObserverState
    integral: Float[Array, " controlled"]
    """Integral of the error of what is controlled (m s)."""
    moving: Driven
    """Last change of the commands."""
    passed: Any


class Planned(eqx.Module):
    """Estimate and gradient from which a predictive controller looks for moves."""

    gradient: Float[Array, "driven move"]
    """Gradient of the cost at no moves at all."""
    observed: ObserverState
    passed: Any


class Mpc(Controller):
    """Model predictive control: a receding horizon on a linear model, within limits.

    An observer estimates the arm and the water. At each call the changes of the commands over the
    horizon are found that cost least: errors of the tip, their integral and speeds of the inputs,
    and for all that comes after the horizon what a regulator without limits would spend. They keep
    to the limits of each input on value, speed and acceleration, and know the target and what is
    known of the water ahead (Rawlings, Mayne and Diehl 2017, chapters 1 and 2). The first change is
    made.

    Commands that keep to the limits of the servos are followed by these without meeting them: a
    linear model tells where they are.
    """

    observer: Observer
    qp: HorizonQp
    by_state: Float[Array, "driven move full"]
    """Gradient of the cost by the moves, for each number known: estimate of arm and water,
    actuators, commands, integral."""
    by_aim: Float[Array, "driven move look driven"]
    """And for the commands at which the tip would stand still where it is wanted, now and later."""
    by_water: Float[Array, "driven move ahead w"]
    """And for the water at each time for which it is foreseen."""
    pushed: Float[Array, "z w"]
    """Effect of foreseen water on the estimate over a period."""
    integrating: Float[Array, "controlled pose"]
    """Error that is integrated, in metres, by the error of the pose."""
    mapping: Float[Array, "driven pose"]
    """Command for a displacement of the tip."""
    lead: Float[Array, " look"]
    """How far it looks ahead to the target (s), first not at all."""
    period: Float[Array, ""]
    """Time between two commands (s)."""
    forecast: Forecast | None
    """Forecast of the water ahead; None: there is none."""
    rows: tuple[int, ...] = eqx.field(static=True)
    """Which inputs are driven."""

    def start(self, seen: Seen) -> MpcMemory:
        none, still = jnp.zeros(self.integrating.shape[0]), jnp.zeros(len(self.rows))
        passed = None if self.forecast is None else self.forecast.start(seen)
        return MpcMemory(self.observer.start(seen), none, still, passed)

    def command(self, memory: MpcMemory, seen: Seen) -> tuple[Command, MpcMemory]:
        rows = jnp.asarray(self.rows, int)
        aims = wanted_commands(seen, self.mapping, self.observer.values, self.lead)
        planned = self.plan(memory, seen, aims)
        found = self.qp.solve(
            planned.gradient,
            lower=seen.lower[rows],
            upper=seen.upper[rows],
            last=seen.command[rows],
            moving=memory.moving,
        )
        return self.make(memory, seen, planned, found.moves[:, 0])

    def plan(self, memory: MpcMemory, seen: Seen, aims: Float[Array, "look driven"]) -> Planned:
        """Return what is estimated, and how the cost follows the moves from there.

        ``aims`` are the commands at which the tip would stand still where it is wanted.
        """
        pushed, passed = None, memory.passed
        gradient = jnp.sum(self.by_aim * aims, axis=(2, 3))
        if self.forecast is not None:
            passed, ahead = self.forecast.ahead(memory.passed, seen)
            pushed = product(self.pushed, ahead[0])
            gradient += jnp.sum(self.by_water * ahead, axis=(2, 3))
        observed = self.observer.update(memory.observed, seen, pushed)
        last = seen.command[jnp.asarray(self.rows, int)]
        full = jnp.concatenate([observed.estimate, observed.actuators, last, memory.integral])
        return Planned(gradient + product(self.by_state, full), observed, passed)

    def make(
        self, memory: MpcMemory, seen: Seen, planned: Planned, move: Driven
    ) -> tuple[Command, MpcMemory]:
        """Return the command after a move, and the memory for the next."""
        rows = jnp.asarray(self.rows, int)
        last, lower, upper = seen.command[rows], seen.lower[rows], seen.upper[rows]
        held = jnp.clip(last + move, lower, upper)
        error = product(self.integrating, pose_error(seen.measured, seen.wanted))
        # at a limit an integral would only wind up
        room = jnp.minimum(upper - held, held - lower) > _AT_LIMIT * (upper - lower)
        free = jnp.all(room & (jnp.abs(move) < (1 - _AT_LIMIT) * self.qp.braking.rate))
        integral = memory.integral + jnp.where(free, self.period, 0.0) * error
        command = jnp.zeros_like(seen.command).at[rows].set(held)
        return command, MpcMemory(planned.observed, integral, held - last, planned.passed)
