"""An episode as a pure function: from an action to the next instant that one is due."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from crinoid.assembly.observables import Observables
from crinoid.control import pose_error
from crinoid.dynamics import Outcome, State
from crinoid.environment.given import Given
from crinoid.environment.reward import Moment
from crinoid.environment.success import Success
from crinoid.simulation import Loop, LoopState


class Case(eqx.Module):
    """The numbers of an episode that stay."""

    loop: Loop
    state: State
    """The arm at the start."""
    end: Int[Array, ""]
    """Time steps until the episode is over."""
    length: Float[Array, ""]
    """Length of the arm (m)."""


class Episode(eqx.Module):
    """The numbers of an episode that change."""

    now: LoopState
    seen: Float[Array, " pose"]
    """Pose of the tip that was seen last."""
    held: Float[Array, ""]
    """For how long the tip has been at its target (s)."""


class Told(NamedTuple):
    """A step as it is told, or many of them: what is before the last axis of the numbers stays."""

    observation: Any
    reward: Any
    time: Any
    """Time (s)."""
    distance: Any
    """Distance of the tip from its target (m)."""
    failed: Any
    success: Any
    over: Any
    """Whether the time is up."""

    def row(self) -> Float[Array, " number"]:
        """Return all of it as one array, which is fetched at once."""
        numbers = [jnp.asarray(each, float) for each in self[1:]]
        return jnp.concatenate([self.observation, jnp.stack(numbers)])

    @staticmethod
    def of(rows: Float[np.ndarray, "*many number"]) -> Told:
        """Return what rows tell."""
        count = len(Told._fields) - 1
        reward, time, distance, *flags = np.moveaxis(rows[..., -count:], -1, 0)
        return Told(rows[..., :-count].copy(), reward, time, distance, *(f > 0 for f in flags))


@dataclass(frozen=True)
class Rules:
    """How an environment goes on, observes and rewards; the same in all its episodes.

    Parameters
    ----------
    observables
        Its observations.
    scale
        What makes the error of each coordinate one of the arm's deviation, times the length of the
        arm for positions; 0 where it does not count.
    reward
        From a `Moment` to a number, traceable.
    success
        When the task is done; None where it never is.
    """

    observables: Observables
    scale: np.ndarray
    reward: Callable[[Moment], Float[Array, ""]]
    success: Success | None

    def begin(self, case: Case) -> Episode:
        """Close the loop around the arm at the start."""
        loop = case.loop
        now = loop.start(case.state)
        # of no weak type, as what comes back from a step: both take the same program
        now = jax.tree.map(lambda x: jax.lax.convert_element_type(x, x.dtype), now)
        seen = loop.seen(now.state, now.sensors, now.command)
        return Episode(now, seen.measured, jnp.zeros(()))

    def go_on(
        self,
        case: Case,
        before: Episode,
        action: Float[Array, " driven"],
        commands: Int[Array, ""],
    ) -> tuple[Episode, Told, Outcome]:
        """Run on until the next command is due.

        Parameters
        ----------
        case, before
            The episode.
        action
            The command until then, in the units of the inputs that are driven.
        commands
            How many commands are to have been given by then: one more than before, or, to go on to
            the first one, none.

        Returns
        -------
        episode, told, outcome
            Where it is then, what is told of it, and the outcome of the last solve.
        """
        driven = np.array(self.observables.driven)
        count = before.now.command.shape[0]
        command = jnp.zeros(count).at[driven].set(action)
        loop = replace(case.loop, controller=Given(command))
        Inner = tuple[LoopState, Outcome]

        def unfinished(inner: Inner) -> Bool[Array, ""]:
            now, outcome = inner
            due = loop.clock.due(now.ticks, now.state.time - loop.switched_on)
            due &= now.ticks >= commands
            return ~due & (now.steps < case.end) & outcome.converged

        def step(inner: Inner) -> Inner:
            now, progress = loop.tick(inner[0])
            return now, progress.outcome

        start = before.now, Outcome.of_nothing(converged=True)
        now, outcome = jax.lax.while_loop(unfinished, step, start)
        return *self.told(case, before, now, failed=~outcome.converged), outcome

    def told(
        self, case: Case, before: Episode, now: LoopState, *, failed: Bool[Array, ""]
    ) -> tuple[Episode, Told]:
        """Tell of an instant at which a command is due, and of the step that led to it."""
        loop, axes = case.loop, self.observables.axes
        driven = np.array(self.observables.driven)
        seen = loop.seen(now.state, loop.sensed(now), now.command)
        # before the first command nothing has changed
        last = jnp.where(now.ticks > 0, before.seen, seen.measured)
        error = pose_error(loop.target(now.state.time), loop.system.tip(now.state))
        distance = jnp.sqrt(jnp.sum(error[:axes] ** 2))
        held, success = jnp.zeros(()), jnp.asarray(False)
        if self.success is not None:
            angle = jnp.abs(error[2]) if axes == 2 else _angle_of(error[axes:])
            near = self.success.near(distance, angle, case.length)
            spent = now.state.time - before.now.state.time
            held = jnp.where(near & (now.ticks > 0), before.held + spent, 0.0)
            success = (held >= self.success.time - 1e-9) & (now.ticks > 0) & near & ~failed
        scale = self.scale * jnp.where(np.arange(error.size) < axes, 1 / case.length, 1.0)
        limits = self.observables.actions
        spans = np.array([each.upper - each.lower for each in limits])
        changed = now.command - before.now.command
        steps = loop.clock.period / loop.system.time_step
        moment = Moment(
            time=now.state.time,
            error=error,
            deviation=jnp.sqrt(jnp.sum((scale * error) ** 2)),
            command=now.command[driven],
            change=changed[driven] / spans,
            left=(case.end - now.steps) / jnp.maximum(steps, 1.0),
            failed=failed,
            success=success,
        )
        told = Told(
            self.observables.observation(seen, last),
            jnp.asarray(self.reward(moment), float),
            now.state.time,
            distance,
            failed,
            success,
            now.steps >= case.end,
        )
        return Episode(now, seen.measured, held), told


def _angle_of(chord: Float[Array, " d"]) -> Float[Array, ""]:
    """Return the angle between two directions (rad) by the chord between them."""
    return 2 * jnp.arcsin(jnp.clip(0.5 * jnp.sqrt(jnp.sum(chord**2)), 0.0, 1.0))
