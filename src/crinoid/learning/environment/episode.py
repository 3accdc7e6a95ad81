"""Episodes as pure functions, from an action to the time of the next one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from crinoid.assembly.neural import Observables
from crinoid.control import pose_error
from crinoid.dynamics import Outcome, State
from crinoid.learning.environment.reward import RewardInput, Success
from crinoid.simulation import Loop, LoopState
from crinoid.simulation.external import ExternalCommand


class EpisodeParameters(eqx.Module):
    """Constants of an episode."""

    loop: Loop
    state: State  # state of the arm at the start
    end: Int[Array, ""]  # number of time steps
    length: Float[Array, ""]  # length of the arm (m)


class Episode(eqx.Module):
    """State of an episode between two actions."""

    now: LoopState
    measured: Float[Array, " pose"]  # pose of the tip that was measured last
    time_at_target: Float[Array, ""]  # time that the tip has been at its target (s)


class StepOutput(NamedTuple):
    """Output of a step, or of many: arrays with leading axes."""

    observation: Any
    reward: Any
    time: Any  # s
    distance: Any  # distance of the tip from its target (m)
    failed: Any
    success: Any
    over: Any  # whether the time of the episode is over

    def row(self) -> Float[Array, " number"]:
        """Return one array of all numbers, which a device transfers in one piece."""
        numbers = [jnp.asarray(each, float) for each in self[1:]]
        return jnp.concatenate([self.observation, jnp.stack(numbers)])

    @staticmethod
    def of(rows: Float[np.ndarray, "*many number"]) -> StepOutput:
        """Return the output in rows of `row`."""
        count = len(StepOutput._fields) - 1
        reward, time, distance, *flags = np.moveaxis(rows[..., -count:], -1, 0)
        return StepOutput(
            rows[..., :-count].copy(), reward, time, distance, *(f > 0 for f in flags)
        )


@dataclass(frozen=True)
class Rules:
    """Observation, reward and end of an environment's episodes."""

    observables: Observables  # observations and actions
    scale: np.ndarray
    """Weight of each coordinate in the deviation, times the length of the arm for positions."""
    reward: Callable[[RewardInput], Float[Array, ""]]  # the reward, traceable
    success: Success | None  # condition under which the task is done; None: never

    def begin(self, case: EpisodeParameters) -> Episode:
        """Return an episode at the start of its arm."""
        loop = case.loop
        now = loop.start(case.state)
        # strong types, as a step returns them: both then use the same program
        now = jax.tree.map(lambda x: jax.lax.convert_element_type(x, x.dtype), now)
        seen = loop.seen(now.state, now.sensors, now.command)
        return Episode(now, seen.measured, jnp.zeros(()))

    def advance(
        self,
        case: EpisodeParameters,
        before: Episode,
        action: Float[Array, " driven"],
        first: Bool[Array, ""],
    ) -> tuple[Episode, StepOutput, Outcome]:
        """Run until the next command is due, and return the outcome of the last solve as well.

        ``action`` are the commands until then, in the units of the driven inputs. ``first``
        says whether to run to the first command only.
        """
        driven = np.array(self.observables.driven)
        count = before.now.command.shape[0]
        command = jnp.zeros(count).at[driven].set(action)
        loop = replace(case.loop, controller=ExternalCommand(command))
        end = jnp.minimum(loop.command_step(before.now.ticks + ~first), case.end)
        Inner = tuple[LoopState, Outcome]

        def unfinished(inner: Inner) -> Bool[Array, ""]:
            now, outcome = inner
            return (now.steps < end) & outcome.converged

        def step(inner: Inner) -> Inner:
            return loop.tick(inner[0])

        start = before.now, Outcome.of_nothing(converged=True)
        now, outcome = jax.lax.while_loop(unfinished, step, start)
        return *self.output(case, before, now, failed=~outcome.converged), outcome

    def output(
        self, case: EpisodeParameters, before: Episode, now: LoopState, *, failed: Bool[Array, ""]
    ) -> tuple[Episode, StepOutput]:
        """Return the episode at a command, and the output of the step that led to it."""
        loop, axes = case.loop, self.observables.axes
        driven = np.array(self.observables.driven)
        seen = loop.seen(now.state, loop.sensed(now), now.command)
        # before the first command nothing has changed
        last = jnp.where(now.ticks > 0, before.measured, seen.measured)
        error = pose_error(loop.target(now.state.time), loop.system.tip(now.state))
        distance = jnp.sqrt(jnp.sum(error[:axes] ** 2))
        at_target, success = jnp.zeros(()), jnp.asarray(False)
        if self.success is not None:
            if axes == 2:
                angle = jnp.abs(error[2])
            else:  # between two directions, from the chord
                chord = jnp.sqrt(jnp.sum(error[axes:] ** 2))
                angle = 2 * jnp.arcsin(jnp.clip(0.5 * chord, 0.0, 1.0))
            near = self.success.near(distance, angle, case.length)
            spent = now.state.time - before.now.state.time
            at_target = jnp.where(near & (now.ticks > 0), before.time_at_target + spent, 0.0)
            success = (at_target >= self.success.time - 1e-9) & (now.ticks > 0) & near & ~failed
        scale = self.scale * jnp.where(np.arange(error.size) < axes, 1 / case.length, 1.0)
        limits = self.observables.actions
        spans = np.array([each.upper - each.lower for each in limits])
        changed = now.command - before.now.command
        steps = loop.clock.period / loop.system.time_step
        reward = self.reward(
            RewardInput(
                time=now.state.time,
                error=error,
                deviation=jnp.sqrt(jnp.sum((scale * error) ** 2)),
                command=now.command[driven],
                change=changed[driven] / spans,
                left=(case.end - now.steps) / jnp.maximum(steps, 1.0),
                failed=failed,
                success=success,
            )
        )
        output = StepOutput(
            self.observables.observation(seen, last),
            jnp.asarray(reward, float),
            now.state.time,
            distance,
            failed,
            success,
            now.steps >= case.end,
        )
        return Episode(now, seen.measured, at_target), output
