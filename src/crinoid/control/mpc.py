"""Model predictive control, on one linear model or on models of several poses of the base."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.base import Base
from crinoid.control.controller import Channels, Command, Controller, ControllerInput
from crinoid.control.forecast import Forecast
from crinoid.control.lqg import ModelBased, ObserverState
from crinoid.control.qp import HorizonQp
from crinoid.control.target import Pose, pose_error
from crinoid.numerics.small_matrices import product

Driven = Float[Array, " driven"]

_AT_LIMIT = 1e-6  # relative distance from a limit that counts as zero


class MpcMemory(eqx.Module):
    """Memory of a predictive controller."""

    observed: ObserverState
    integral: Float[Array, " controlled"]
    """Integral of the error of the controlled coordinates (m s)."""
    moving: Driven
    """Last change of the commands."""
    passed: Any


class HorizonProblem(eqx.Module):
    """Data of one optimisation: the estimate and the gradient of the cost."""

    gradient: Float[Array, "driven move"]
    """Gradient of the cost at no moves at all."""
    observed: ObserverState
    passed: Any


class Mpc(ModelBased):
    """Model predictive control: a receding horizon on a linear model, within limits.

    An observer estimates the arm and the water. At each call the changes of the commands over the
    horizon are found that cost least: errors of the tip, their integral and speeds of the inputs,
    and for all that comes after the horizon what a regulator without limits would spend. They keep
    to the limits of each input on value, speed and acceleration, and anticipate the target and
    the forecast of the water (Rawlings, Mayne and Diehl 2017, chapters 1 and 2). Only the first
    change is applied.

    The servos follow commands within their limits without meeting them, so that a linear model
    applies to them.
    """

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
    forecast: Forecast | None
    """Forecast of the water, if there is one."""

    def start(self, seen: ControllerInput) -> MpcMemory:
        none, still = jnp.zeros(self.integrating.shape[0]), jnp.zeros(len(self.rows))
        passed = None if self.forecast is None else self.forecast.start(seen)
        return MpcMemory(self.observer.start(seen), none, still, passed)

    def command(self, memory: MpcMemory, seen: ControllerInput) -> tuple[Command, MpcMemory]:
        rows = jnp.asarray(self.rows, int)
        planned = self.plan(memory, seen, self.wanted_commands(seen))
        found = self.qp.solve(
            planned.gradient,
            lower=seen.lower[rows],
            upper=seen.upper[rows],
            last=seen.command[rows],
            moving=memory.moving,
        )
        return self.make(memory, seen, planned, found.moves[:, 0])

    def plan(
        self, memory: MpcMemory, seen: ControllerInput, aims: Float[Array, "look driven"]
    ) -> HorizonProblem:
        """Return the estimate and the gradient of the cost by the moves.

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
        return HorizonProblem(gradient + product(self.by_state, full), observed, passed)

    def make(
        self, memory: MpcMemory, seen: ControllerInput, planned: HorizonProblem, move: Driven
    ) -> tuple[Command, MpcMemory]:
        """Return the command after a move, and the memory for the next."""
        rows = jnp.asarray(self.rows, int)
        last, lower, upper = seen.command[rows], seen.lower[rows], seen.upper[rows]
        held = jnp.clip(last + move, lower, upper)
        error = product(self.integrating, pose_error(seen.measured, seen.reference))
        # no wind-up of the integral at a limit
        room = jnp.minimum(upper - held, held - lower) > _AT_LIMIT * (upper - lower)
        free = jnp.all(room & (jnp.abs(move) < (1 - _AT_LIMIT) * self.qp.braking.rate))
        integral = memory.integral + jnp.where(free, self.period, 0.0) * error
        command = jnp.zeros_like(seen.command).at[rows].set(held)
        return command, MpcMemory(planned.observed, integral, held - last, planned.passed)


class RigidRotationCorrection(eqx.Module):
    """Nonlinear part of the tip's displacement under a rigid rotation of the base.

    The arm is rigid in the shape of the linearisation, as its deflection changes little.
    """

    base: Base
    """Base with the set angles of the linearisation."""
    lever: Float[Array, " d"]
    """From the root to the tip there (m)."""
    pointing: Float[Array, " pointing"]
    """Pose of the tip there behind its position: an angle, or a unit vector."""
    slope: Float[Array, "pose channel"]
    """Linear part, by the displacement of the channels."""

    def __call__(self, channels: Channels) -> Pose:
        """Return that part (m, rad, 1) for a displacement of the channels from there (m, rad)."""
        return self.swung(channels) - product(self.slope, channels)

    def swung(self, channels: Channels) -> Pose:
        """Return how far the tip of the rigid arm goes as the channels that turn do."""
        turn = self.base.rotation(channels)
        moved = product(turn, self.lever) - self.lever
        if self.base.axes == 2:  # an angle is linear in the turn
            return jnp.concatenate([moved, channels[2:]])
        return jnp.concatenate([moved, product(turn, self.pointing) - self.pointing])


_SHARPNESS = 3  # exponent of the weight's decay with the squared distance from a model
_AT_ONE = 1e-4  # distance from a model that counts as zero (rad)
_ROUNDS = 4  # number of corrections of the commands for a pose by the nonlinear part


class ScheduledMpc(Controller):
    """Gain-scheduled predictive control: models of several poses of the base, one command.

    Each has its own linear model, observer, horizon and cost of what comes after it, all of the
    same pose of the base. All of them observe at each call. The moves have the least weighted sum
    of their costs, within the limits; the nearer the base is to the pose of a
    model, the more its cost counts (local models: Johansen and Foss 1993; gain scheduling: Rugh and
    Shamma 2000). A cost is never made of the model of one pose and the estimate of another.

    The part that is not linear in the rotation of a rigid arm is known, and subtracted from the
    tip and the target of each model.
    """

    models: Mpc
    """Controllers, stacked."""
    turned: RigidRotationCorrection
    """Part of the turn that each model lacks away from its pose, stacked."""
    at: Float[Array, "model channel"]
    """Displacement of the channels at the pose of each (m, rad)."""
    around: Float[Array, "model input"]
    """Commands there."""
    standing: Float[Array, "model z s"]
    """Estimate at rest, by the actuators: where an observer starts away from its pose."""
    turns: Float[Array, " channel"]
    """Channels that turn the arm (0, 1)."""

    def start(self, seen: ControllerInput) -> MpcMemory:
        memory = jax.vmap(lambda model: model.start(seen))(self.models)
        estimate = jax.vmap(product)(self.standing, memory.observed.actuators)
        return eqx.tree_at(lambda each: each.observed.estimate, memory, estimate)

    def command(self, memory: MpcMemory, seen: ControllerInput) -> tuple[Command, MpcMemory]:
        rows = jnp.asarray(self.models.rows, int)
        lower, upper = seen.lower[rows], seen.upper[rows]
        poses = jax.vmap(seen.target.in_frame)(seen.time + self.models.lead[0])

        def plan(
            model: Mpc, turned: RigidRotationCorrection, around: Command, before: MpcMemory
        ) -> HorizonProblem:
            room = lower - around[rows], upper - around[rows]
            aims, beyond = commands_at(model, turned, poses, *room)
            # without the nonlinear part, and relative to the commands of the model
            given = seen.measured - beyond[0], seen.command - around
            own = eqx.tree_at(lambda each: (each.measured, each.command), seen, given)
            return model.plan(before, own, aims)

        planned = jax.vmap(plan)(self.models, self.turned, self.around, memory)
        weights = self.weights(seen.actuators[0].position)
        found = self.models.qp.blended(weights).solve(
            jnp.sum(weights[:, None, None] * planned.gradient, axis=0),
            lower=lower,
            upper=upper,
            last=seen.command[rows],
            moving=memory.moving[0],
        )
        commands, after = jax.vmap(
            lambda model, before, made: model.make(before, seen, made, found.moves[:, 0])
        )(self.models, memory, planned)
        return commands[0], after

    def weights(self, channels: Channels) -> Float[Array, " model"]:
        """Return how much each model counts for a displacement of the channels (m, rad)."""
        away = self.turns * (channels - self.at)
        squared = jnp.sum(away**2, axis=1) + _AT_ONE**2
        share = (jnp.min(squared) / squared) ** _SHARPNESS
        return share / jnp.sum(share)


def commands_at(
    model: Mpc,
    turned: RigidRotationCorrection,
    poses: Float[Array, "look pose"],
    lower: Float[Array, " driven"],
    upper: Float[Array, " driven"],
) -> tuple[Float[Array, "look driven"], Float[Array, "look pose"]]:
    """Return the commands, from those of a model, at which the tip would stand still at poses.

    In the linear model. The nonlinear part at the commands, as far as they are within the limits
    ``lower`` and ``upper``, is left out of the poses, and comes second.
    """
    start = model.observer.values[: poses.shape[1]]
    channels = turned.slope.shape[1]
    base = [(place, row) for place, row in enumerate(model.rows) if row < channels]
    places, rows = (jnp.asarray([pair[end] for pair in base], int) for end in (0, 1))

    def of(pose: Pose) -> tuple[Float[Array, " driven"], Pose]:
        def corrected(_: Array, beyond: Pose) -> Pose:
            commands = product(model.mapping, pose_error(pose, start + beyond))
            within = jnp.clip(commands, lower, upper)
            return turned(jnp.zeros(channels).at[rows].set(within[places]))

        beyond = jax.lax.fori_loop(0, _ROUNDS, corrected, jnp.zeros_like(pose))
        return product(model.mapping, pose_error(pose, start + beyond)), beyond

    return jax.vmap(of)(poses)
