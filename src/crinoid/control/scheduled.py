"""Predictive control of an arm that turns far, on models of several poses of its base."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.control.controller import Controller
from crinoid.control.mpc import Mpc, MpcMemory, Planned
from crinoid.control.seen import Command, Seen
from crinoid.control.target import pose_error
from crinoid.control.turned import Turned
from crinoid.products import product

Channels = Float[Array, " channel"]
Pose = Float[Array, " pose"]

_SHARPNESS = 3
"""Power of the squared distance from a model by which its weight falls."""
_AT_ONE = 1e-4
"""Distance from a model that counts as none (rad)."""
_ROUNDS = 4
"""Times that the commands for a pose are corrected for what is not linear."""


class ScheduledMpc(Controller):
    """Predictive controllers of several poses of the base, one command.

    Each has its own linear model, observer, horizon and cost of what comes after it, all of the
    same pose of the base. At each call all of them take in what is seen. The moves are those that
    cost least by the sum of their costs, within the limits; the nearer the base is to the pose of a
    model, the more its cost counts (local models: Johansen and Foss 1993; gain scheduling: Rugh and
    Shamma 2000). A cost is never made of the model of one pose and the estimate of another.

    What is not linear in the turn of a rigid arm is known: each model is told of a tip, and of a
    target, without it.
    """

    models: Mpc
    """The controllers, stacked."""
    turned: Turned
    """Part of the turn that each model lacks away from its pose, stacked."""
    at: Float[Array, "model channel"]
    """Displacement of the channels at the pose of each (m, rad)."""
    around: Float[Array, "model input"]
    """Commands there."""
    standing: Float[Array, "model z s"]
    """Estimate at rest, by the actuators: where an observer starts away from its pose."""
    turns: Float[Array, " channel"]
    """Which channels turn the arm (0, 1)."""

    def start(self, seen: Seen) -> MpcMemory:
        memory = jax.vmap(lambda model: model.start(seen))(self.models)
        estimate = jax.vmap(product)(self.standing, memory.observed.actuators)
        return eqx.tree_at(lambda each: each.observed.estimate, memory, estimate)

    def command(self, memory: MpcMemory, seen: Seen) -> tuple[Command, MpcMemory]:
        rows = jnp.asarray(self.models.rows, int)
        lower, upper = seen.lower[rows], seen.upper[rows]
        poses = jax.vmap(seen.target.in_frame)(seen.time + self.models.lead[0])

        def plan(model: Mpc, turned: Turned, around: Command, before: MpcMemory) -> Planned:
            room = lower - around[rows], upper - around[rows]
            aims, beyond = commands_at(model, turned, poses, *room)
            return model.plan(before, _told(seen, beyond[0], around), aims)

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


def _told(seen: Seen, beyond: Pose, around: Command) -> Seen:
    """Return what a model is to see: all less what is not linear, and less its own commands."""
    return eqx.tree_at(
        lambda each: (each.measured, each.command),
        seen,
        (seen.measured - beyond, seen.command - around),
    )


def commands_at(
    model: Mpc,
    turned: Turned,
    poses: Float[Array, "look pose"],
    lower: Float[Array, " driven"],
    upper: Float[Array, " driven"],
) -> tuple[Float[Array, "look driven"], Float[Array, "look pose"]]:
    """Return the commands, from those of a model, at which the tip would stand still at poses.

    In the linear model. What is not linear at the commands, as far as they are within the limits
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
