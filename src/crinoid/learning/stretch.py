"""A stretch of an episode: an arm under a policy for some time steps."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from crinoid.control import Controller, Neural, Observation, pose_error
from crinoid.control.policy import Policy
from crinoid.learning.price import Price
from crinoid.programs import OFTEN, compiled
from crinoid.simulation import Loop, LoopState, rollout


class Course(eqx.Module):
    """Everything that all arms have in common in a stretch."""

    observation: Observation
    price: Price
    discount: Float[Array, ""]
    """Weight of a time step over that of the one before."""
    key: PRNGKeyArray
    """Key of all that is random besides the draws."""
    steps: int = eqx.field(static=True)
    """Time steps of the stretch."""


class Stretch(eqx.Module):
    """How an arm fared in a stretch."""

    end: LoopState
    cost: Float[Array, " step"]
    """Cost of each time step."""
    distance: Float[Array, " step"]
    """Distance of the tip from its target at the end of each (m)."""
    kept: Any
    """Memory of the controller at the end of each, or a part of it."""


def run_stretch(course: Course, controller: Controller, loop: Loop, now: LoopState) -> Stretch:
    """Run an arm under a controller, and keep its memory."""
    axes = loop.system.forces.axes

    def look(loop: Loop, now: LoopState) -> tuple[Array, Array, Any]:
        error = pose_error(loop.target(now.state.time), loop.system.tip(now.state))
        return error, now.command, now.memory

    run = rollout(replace(loop, controller=controller), now, course.steps, observe=look)
    error, command, memory = run.kept
    cost = course.price(error, command, now.command)
    distance = jnp.sqrt(jnp.sum(jax.lax.stop_gradient(error[:, :axes]) ** 2, axis=1))
    return Stretch(run.end, cost, distance, memory)


class Trial(eqx.Module):
    """How a policy fared in a whole episode."""

    cost: Float[Array, ""]
    """Mean cost of a time step."""
    error: Float[Array, ""]
    """Mean square of the distance of the tip from its target (m2)."""


@compiled(**OFTEN)
def trial(shared: tuple[Course, Policy], arm: tuple[Loop, LoopState]) -> Trial:
    """Run a policy through an episode."""
    course, policy = shared
    found = run_stretch(course, Neural(course.observation, policy), *arm)
    return Trial(jnp.mean(found.cost), jnp.mean(found.distance**2))
