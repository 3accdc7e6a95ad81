"""States of the actuators during a log: commands that they follow, and measured drives."""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from crinoid.actuation import FollowerState, followed
from crinoid.assembly.arrays import array
from crinoid.assembly.plan import AssembledScenario
from crinoid.base import ServoState
from crinoid.compilation import ONCE, compiled
from crinoid.control import Playback
from crinoid.dynamics import System, numbers_of
from crinoid.inverse.readings import ReadingRecord
from crinoid.scenario import refusal


def actuator_motion(
    plan: AssembledScenario, record: ReadingRecord, time: Float[np.ndarray, " tick"]
) -> Float[np.ndarray, "tick s"]:
    """Return the numbers in the states of all actuators at some times of a record (s).

    Commands are followed from rest, at t = 0 or at the first time of a record that starts later
    than the scenario ends. Actuators without commands and measured states stay at rest.
    """
    system, step = plan.system, plan.scenario.simulation.time_step
    within = 0.0 <= time[0] <= plan.scenario.simulation.duration
    begin = 0.0 if within else float(time[0])
    rows = np.ceil((time - begin) / step - 1e-6).astype(int)
    commands = jnp.zeros((rows[-1] + 1, len(plan.inputs)))
    if record.commands is not None:
        player = Playback(*map(array, record.commands))
        commands = _played(player, array(begin + step * np.arange(rows[-1] + 1)))
    states = _follow(system, commands, jax.device_put(rows))
    for name, measured in record.states.items():
        values = np.interp(time, measured.time, measured.values[:, 0])
        states = _with_measured(plan, states, name, values)
    return np.asarray(jax.vmap(lambda each: numbers_of(each)[0])(states))


@compiled(**ONCE)
def _played(player: Playback, time: Float[Array, " step"]) -> Float[Array, "step input"]:
    return jax.vmap(player.at)(time)


@compiled(**ONCE)
def _follow(
    system: System, commands: Float[Array, "step input"], rows: Int[Array, " tick"]
) -> tuple[Any, ...]:
    """Return the states of all actuators before some of the steps."""

    def follow(states: tuple[Any, ...], command: Array) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
        return tuple(followed(system.followers, states, command, system.time_step)), states

    rest = tuple(each.at_rest() for each in system.followers)
    rest = jax.tree.map(lambda leaf: jax.lax.convert_element_type(leaf, leaf.dtype), rest)
    every = jax.lax.scan(follow, rest, commands)[1]
    return jax.tree.map(lambda leaf: leaf[rows], every)


def _with_measured(
    plan: AssembledScenario, states: tuple[Any, ...], name: str, values: Float[np.ndarray, " tick"]
) -> tuple[Any, ...]:
    """Return the states with that of an input as measured."""
    for place, follower in enumerate(plan.system.followers):
        names = [each.name for each in follower.inputs]
        if name not in names:
            continue
        row, state = names.index(name), states[place]
        speed = np.gradient(values, plan.period)
        if isinstance(state, ServoState):
            rate = np.gradient(speed, plan.period)
            parts = {"position": values, "velocity": speed, "acceleration": rate, "mean": rate}
        elif isinstance(state, FollowerState):
            parts = {"drive": values, "held": values}
        else:
            text = f"has measured states of {name}, an actuator of a package"
            raise refusal("RECORD", text, "have its commands")
        changed = [getattr(state, part).at[:, row].set(array(each)) for part, each in parts.items()]
        state = eqx.tree_at(lambda s: [getattr(s, part) for part in parts], state, changed)  # noqa: B023
        return (*states[:place], state, *states[place + 1 :])
    raise AssertionError("a record has states of inputs alone")
