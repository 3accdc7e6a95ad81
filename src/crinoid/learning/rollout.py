"""Rollouts of a policy in training: stage cost, segments of episodes, and a pool of episodes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any, NamedTuple, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from crinoid.assembly.arrays import array
from crinoid.assembly.control_design import max_speeds
from crinoid.assembly.neural import Observables
from crinoid.assembly.optimal_control import EFFORT
from crinoid.assembly.plan import AssembledScenario
from crinoid.compilation import OFTEN, ONCE, Program, compiled
from crinoid.control import Controller, Neural, Observation, pose_error
from crinoid.control.neural import Policy
from crinoid.dynamics import State
from crinoid.foundation.cores import cores
from crinoid.learning.environment.draws import EpisodeDraw, EpisodeSampler, TreeForm, arrays_of
from crinoid.simulation import Loop, LoopState, rollout

T = TypeVar("T")

_KNEE = 4.0
"""Error, over the error scale, beyond which the cost grows linearly: a diverging arm should not
outweigh all others."""
_HISTORY, _TRIES = 3, 10
"""Segments by which a diverged arm goes back, and how often before its episode is given up; also
the draws in a row that may have no equilibrium."""
_COUNTS = ("numbers", "tries", "ends")


class StageCost(eqx.Module):
    """Cost of a time step, dimensionless.

    It is that of LQG (`crinoid.assembly.optimal_control.Regulator`) without the integral.
    """

    error_weight: Float[Array, " pose"]
    """Weight of the error of each controlled coordinate; 0 for the others (1/m, 1/rad)."""
    speed_weight: Float[Array, " input"]
    """One over the largest change of each command in a control period; 0 for a fixed one."""
    effort_weight: Float[Array, " input"]  # weight of each command (1/its unit)
    periods: Float[Array, ""]  # control periods in a time step
    unit: Float[Array, ""]  # cost that counts as one

    @staticmethod
    def of(plan: AssembledScenario, observables: Observables) -> StageCost:
        """Return the stage cost of a scenario."""
        scenario, rows = plan.scenario, np.array(observables.driven)
        columns, scale = plan.controlled
        error_scale = scenario.control.lqg.smoothness_in(scenario)
        error = np.zeros(plan.sensors[0].noise.shape[0])
        error[columns] = scale / error_scale
        speed, effort = np.zeros((2, len(plan.inputs)))
        speed[rows] = 1 / (plan.period * max_speeds(plan)[rows])
        effort[rows] = [2 * EFFORT / (each.upper - each.lower) for each in observables.actions]
        step = float(plan.system.time_step)
        return StageCost(*map(array, (error, speed, effort, step / plan.period, 1.0)))

    def __call__(
        self,
        error: Float[Array, "steps pose"],
        command: Float[Array, "steps input"],
        before: Float[Array, " input"],
    ) -> Float[Array, " steps"]:
        """Return the cost of each time step.

        ``error`` is target pose minus tip pose at the end of each step (m, rad), ``command`` are
        the commands during each step, and ``before`` those before the first step.
        """
        off = jnp.sum((self.error_weight * error) ** 2, axis=1)
        off = 2 * _KNEE**2 * (jnp.sqrt(1 + off / _KNEE**2) - 1)
        moves = jnp.diff(jnp.concatenate([before[None], command]), axis=0)
        # a command lasts for a control period, in which its change counts once
        speed = jnp.sum((self.speed_weight * moves) ** 2, axis=1) / self.periods
        return (off + speed + jnp.sum((self.effort_weight * command) ** 2, axis=1)) / self.unit


class RolloutSegment(eqx.Module):
    """Settings of a segment of an episode, common to all arms."""

    observation: Observation
    stage_cost: StageCost
    discount: Float[Array, ""]  # weight of a time step over that of the step before
    steps: int = eqx.field(static=True)  # number of time steps


class SegmentResult(eqx.Module):
    """Result of a segment for one arm."""

    end: LoopState
    cost: Float[Array, " step"]  # cost of each time step
    distance: Float[Array, " step"]  # from tip to target at the end of each step (m)
    memory: Any  # memory of the controller at the end of each step, or a part of it


def run_segment(
    segment: RolloutSegment, controller: Controller, loop: Loop, now: LoopState
) -> SegmentResult:
    """Run an arm under a controller for a segment."""
    axes = loop.system.forces.axes

    def observe(loop: Loop, now: LoopState) -> tuple[Array, Array, Any]:
        error = pose_error(loop.target(now.state.time), loop.system.tip(now.state))
        return error, now.command, now.memory

    run = rollout(replace(loop, controller=controller), now, segment.steps, observe=observe)
    error, command, memory = run.kept
    cost = segment.stage_cost(error, command, now.command)
    distance = jnp.sqrt(jnp.sum(jax.lax.stop_gradient(error[:, :axes]) ** 2, axis=1))
    return SegmentResult(run.end, cost, distance, memory)


@compiled(**OFTEN)
def evaluate(
    shared: tuple[RolloutSegment, Policy], arm: tuple[Loop, LoopState]
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Return the mean cost of a time step of a policy, and its mean square error of the tip (m2).

    The segment is a whole episode.
    """
    segment, policy = shared
    found = run_segment(segment, Neural(segment.observation, policy), *arm)
    return jnp.mean(found.cost), jnp.mean(found.distance**2)


class EpisodeState(NamedTuple):
    """Closed loop of an episode, and its present state."""

    loop: Loop
    now: LoopState


class EpisodePool:
    """Arms in training, each within an episode; the next episode starts where one is over.

    Episodes are numbered in the order in which they start. The number is the seed of the draw, so
    that a repeated training gives the same numbers. A diverged arm goes back by some segments until
    the policy controls it: failures are rare, and training would see too few of them.

    ``controller`` sets the type of the loop's memory, ``first`` is the seed of the first episode.
    """

    def __init__(
        self, sampler: EpisodeSampler, count: int, controller: Controller, first: int
    ) -> None:
        self._sampler, self._controller, self._first = sampler, controller, first
        self.steps = sampler.scenario.simulation.steps
        self.started = 0  # number of episodes that have started
        self.numbers, self.tries = np.zeros((2, count), int)
        """Number of the episode of each arm, and how often it went back."""
        # the first episodes end one after another, so that not all restart together
        self.ends = self.steps * (1 + np.arange(count)) // count
        """Time step at which the episode of each arm is over."""
        self.arms: list[EpisodeState] = [self._next(arm) for arm in range(count)]
        self.history = [[arm.now] * _HISTORY for arm in self.arms]
        """States of each arm at the last segments, oldest first."""

    def _next(self, arm: int) -> EpisodeState:
        for _ in range(_TRIES):
            self.numbers[arm], self.tries[arm] = self.started, 0
            self.started += 1
            try:
                return self.start(self._first + int(self.numbers[arm]))
            except RuntimeError as error:  # this draw has no equilibrium
                trouble = error
        raise trouble

    def draw(self, seed: int) -> EpisodeDraw:
        """Draw an episode by the arcsine law, which favours the ends, where policies fail."""
        random = np.random.default_rng(seed)
        values = {
            key: low + (high - low) * random.beta(0.5, 0.5)
            for key, (low, high) in self._sampler.ranges.items()
        }
        return self._sampler.draw(seed, random, {"set": values})

    def start(self, seed: int) -> EpisodeState:
        """Draw an episode, and return its arm at the start."""
        case = self.draw(seed).case
        loop = replace(case.loop, controller=self._controller)
        return EpisodeState(loop, _initial_state(loop, case.state))

    def advance(self, nows: Sequence[LoopState], steps: int, diverged: np.ndarray) -> None:
        """Set the states of the arms after a segment, and start new episodes where one is over.

        The next segment of ``steps`` time steps must fit into the episode. ``diverged`` says which
        arms failed or cost too much.
        """
        for arm, now in enumerate(nows):
            if diverged[arm] and self.tries[arm] < _TRIES:
                self.tries[arm] += 1
                self._set(arm, self.history[arm][0], [self.history[arm][0]] * _HISTORY)
            elif diverged[arm] or int(now.steps) + steps > self.ends[arm]:
                self.arms[arm], self.ends[arm] = self._next(arm), self.steps
                self.history[arm] = [self.arms[arm].now] * _HISTORY
            else:
                self._set(arm, now, [*self.history[arm][1:], self.arms[arm].now])

    def _set(self, arm: int, now: LoopState, history: list[LoopState]) -> None:
        self.arms[arm], self.history[arm] = self.arms[arm]._replace(now=now), history

    def arrays(self) -> dict[str, np.ndarray]:
        """Return the arrays of a checkpoint."""
        nows = [
            arrays_of(now)
            for arm, history in zip(self.arms, self.history, strict=True)
            for now in (*history, arm.now)
        ]
        states = {f"now_{k}": np.stack(each) for k, each in enumerate(zip(*nows, strict=True))}
        counts = {name: getattr(self, name) for name in _COUNTS}
        return states | counts | {"begun": np.array(self.started)}

    def restore(self, saved: Mapping[str, np.ndarray]) -> None:
        """Continue from the arrays of a checkpoint."""
        self.started = int(saved["begun"])
        for name in _COUNTS:
            setattr(self, name, saved[name].copy())
        form = TreeForm(self.arms[0].now)
        rows = [jnp.asarray(saved[f"now_{k}"]) for k in range(len(form.shapes))]
        nows = [form.tree([row[k] for row in rows]) for k in range(len(rows[0]))]
        for arm, number in enumerate(self.numbers):
            *history, now = nows[arm * (_HISTORY + 1) :][: _HISTORY + 1]
            self.arms[arm] = self.start(self._first + int(number))
            self._set(arm, now, history)


@compiled(**ONCE)
def _initial_state(loop: Loop, state: State) -> LoopState:
    return replace(loop.start(state), books=None)


class Learners:
    """Workers that run a program for each arm: threads on a CPU, one batch on an accelerator."""

    def __init__(self) -> None:
        self._pool = ThreadPoolExecutor(cores()) if jax.default_backend() == "cpu" else None

    def run(self, program: Program[[Any, Any], T], shared: Any, arms: Sequence[Any]) -> list[T]:
        """Return ``program(shared, arm)`` for each arm."""
        if self._pool is None:
            stacked = jax.tree.map(lambda *same: jnp.stack(same), *arms)
            found = _batched(program.function, shared, stacked)
            return [jax.tree.map(lambda x, row=row: x[row], found) for row in range(len(arms))]
        futures = [self._pool.submit(program, shared, arm) for arm in arms]
        return [future.result() for future in futures]


@eqx.filter_jit
def _batched(program: Callable[[Any, Any], Any], shared: Any, arms: Any) -> Any:
    return jax.vmap(lambda arm: program(shared, arm))(arms)
