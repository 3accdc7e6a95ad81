"""Many arms as one vector environment of Gymnasium, with automatic resets."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from jaxtyping import Array

from crinoid.compilation import OFTEN, require_own_process
from crinoid.foundation.cores import cores
from crinoid.foundation.status import Status
from crinoid.learning.environment.draws import Arrays, EpisodeDraw, NamedBoxes, arrays_of
from crinoid.learning.environment.env import EpisodeProgram, Reward, task_arguments
from crinoid.learning.environment.episode import StepOutput
from crinoid.learning.environment.reward import Success, closeness
from crinoid.scenario import Scenario, got, refusal
from crinoid.scenario.library import Source
from crinoid.simulation.external import numbers

_FEWEST = 16  # least default number of episodes that a reset prepares


class ArmVectorEnv(NamedBoxes, VectorEnv[np.ndarray, np.ndarray, np.ndarray]):
    """Many arms of one scenario; made by `crinoid.make_vec_env`.

    The step after the last one of an episode starts the next episode: it ignores its action, and
    its reward is 0.
    """

    metadata: ClassVar[dict[str, Any]] = {"autoreset_mode": AutoresetMode.NEXT_STEP}

    def __init__(self, program: EpisodeProgram, num_envs: int, draws: int | None = None) -> None:
        self.num_envs = count = _count("num_envs", num_envs)
        self._draws = max(num_envs, _FEWEST) if draws is None else _count("draws", draws)
        self._program, self._sampler = program, program.sampler
        self.single_action_space = program.action_space
        self.single_observation_space = program.observation_space
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self._shape = num_envs, len(self._sampler.observables.driven)
        # on a processor a batch costs as much as its arms alone, and waits for the slowest
        alone = not on_accelerator()

        def advance(
            pool: Arrays, starts: Arrays, rows: Array, fresh: Array, some: Arrays, acts: Array
        ) -> tuple[Arrays, Array, Arrays]:
            def one(own: Any) -> tuple[Arrays, Array, Arrays]:
                row, fresh, episode, action = own
                case = [array[row] for array in pool]
                episode = jax.lax.cond(
                    fresh, lambda: [array[row] for array in starts], lambda: episode
                )
                return program.advance(case, episode, action, fresh)

            every = rows, fresh, some, acts
            return jax.lax.map(one, every) if alone else jax.vmap(one)(every)

        most = min(cores(), num_envs) if alone else 1
        parts = next(k for k in range(most, 0, -1) if count % k == 0)
        self._threads = ThreadPoolExecutor(parts)
        self._slices = [slice(k * count // parts, (k + 1) * count // parts) for k in range(parts)]
        self._advance = jax.jit(advance, compiler_options=OFTEN)
        self._pool: list[EpisodeDraw] = []

    @property
    def scenarios(self) -> list[Scenario]:
        """The scenarios that were drawn."""
        return [drawn.scenario for drawn in self._pool]

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Start an episode of each arm, and prepare the next ones.

        Parameters
        ----------
        seed
            Seed of the first draw, one more for each further draw; drawn if None.
        options
            As for `crinoid.learning.environment.env.ArmEnv.reset`, for all draws.

        Raises
        ------
        RuntimeError
            If an arm has no equilibrium to start from.
        ScenarioError
            As `crinoid.learning.environment.env.ArmEnv.reset` does.
        """
        super().reset(seed=seed)
        first = int(self.np_random.integers(2**31)) if seed is None else seed
        pool = [
            self._sampler.draw(first + k, seeding.np_random(first + k)[0], options)
            for k in range(self._draws)
        ]
        cases = [arrays_of(drawn.case) for drawn in pool]
        starts = [self._program.begin(case) for case in cases]
        self._pool, self._cases, self._starts = pool, _stack(cases), _stack(starts)
        self._rows = np.arange(self.num_envs) % self._draws
        self._fresh = np.ones(self.num_envs, bool)
        self._parts = [[array[self._rows[s]] for array in self._starts] for s in self._slices]
        output, _ = self._output(np.zeros(self._shape))
        self._fresh = np.zeros(self.num_envs, bool)
        return output.observation, self._info(output, [])

    def step(
        self, actions: Any
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Apply a command of each arm for one control period.

        Parameters
        ----------
        actions
            The commands, a row for each arm, in the units of the inputs.

        Raises
        ------
        gymnasium.error.ResetNeeded
            If there was no reset before.
        ValueError
            If the actions have another shape, or one is not a number.
        """
        if not self._pool:
            raise ResetNeeded("no episode has started. Call reset().")
        commands = numbers("action", actions, self._shape)
        fresh = self._fresh
        self._rows = np.where(fresh, (self._rows + self.num_envs) % self._draws, self._rows)
        output, outcomes = self._output(commands)
        ended = (output.failed | output.success) & ~fresh
        late = output.over & ~ended & ~fresh
        self._fresh = ended | late
        reward = np.where(fresh, 0.0, output.reward)
        return output.observation, reward, ended, late, self._info(output, outcomes)

    def close_extras(self, **kwargs: Any) -> None:
        """Stop the threads."""
        self._threads.shutdown()

    def _output(self, commands: np.ndarray) -> tuple[StepOutput, list[Arrays]]:
        def run(part: int) -> tuple[Arrays, np.ndarray, Arrays]:
            here, own = self._slices[part], self._parts[part]
            own, rows, outcomes = self._advance(
                self._cases, self._starts, self._rows[here], self._fresh[here], own, commands[here]
            )
            return own, np.asarray(rows), outcomes

        require_own_process()
        found = list(self._threads.map(run, range(len(self._slices))))
        self._parts = [own for own, _, _ in found]
        output = StepOutput.of(np.concatenate([rows for _, rows, _ in found]))
        return output, [outcome for _, _, outcome in found]

    def _info(self, output: StepOutput, outcomes: Sequence[Arrays]) -> dict[str, Any]:
        status = np.full(self.num_envs, Status.OK.value, object)
        for arm in np.flatnonzero(output.failed):
            part = next(k for k, s in enumerate(self._slices) if s.start <= arm < s.stop)
            row = arm - self._slices[part].start
            episode, outcome = (
                [array[row] for array in arrays] for arrays in (self._parts[part], outcomes[part])
            )
            status[arm] = self._program.failure(self._pool[self._rows[arm]], episode, outcome)
        values = {
            "time": output.time,
            "error": output.distance,
            "status": status,
            "is_success": output.success,
        }
        return values | {f"_{name}": np.ones(self.num_envs, bool) for name in values}


def on_accelerator() -> bool:
    """Return whether JAX computes elsewhere than on the processor."""
    return jax.default_backend() != "cpu"


def _stack(every: Sequence[Arrays]) -> Arrays:
    return [
        jnp.asarray(np.stack([np.asarray(x) for x in same])) for same in zip(*every, strict=True)
    ]


def _count(name: str, given: Any) -> int:
    if not isinstance(given, int) or isinstance(given, bool) or given < 1:
        raise refusal(name, got(given, "be a whole number of at least 1"))
    return given


def make_vec_env(
    scenario: Source,
    num_envs: int,
    *,
    draw: Mapping[str, tuple[float, float]] | None = None,
    reward: Reward = closeness,
    success: Success | None = None,
    draws: int | None = None,
) -> ArmVectorEnv:
    """Make many environments of a scenario that step in one call.

    Episodes restart automatically (``AutoresetMode.NEXT_STEP``), each from the next of some draws
    that a reset prepares. Episode ``k`` of environment ``i`` is draw ``(i + k num_envs) % draws``,
    which is that of `make_env` after ``reset(seed=seed + draw)``.

    Parameters
    ----------
    scenario, draw, reward, success
        As for `make_env`.
    num_envs : int
        Number of environments. On a CPU they are spread over threads, on an accelerator they step
        as a batch.
    draws : int
        Number of episodes that a reset prepares; ``num_envs`` and at least 16 if None.

    Returns
    -------
    crinoid.learning.environment.vector.ArmVectorEnv

    Raises
    ------
    ImportError
        If Gymnasium is not installed.
    RuntimeError
        If the arm has no equilibrium to start from.
    ScenarioError
        If anything is wrong with the scenario, the ranges or the numbers.

    Examples
    --------
    >>> scenario = crinoid.load("still-water", ["arm.nodes=5", "control.start=0"])
    >>> envs = crinoid.make_vec_env(scenario, num_envs=2)
    >>> observations, info = envs.reset(seed=0)
    >>> observations, rewards, terminated, truncated, info = envs.step(np.zeros((2, 2)))
    >>> observations.shape, terminated.tolist()
    ((2, 15), [False, False])
    """
    return ArmVectorEnv(EpisodeProgram(scenario, draw, reward, success), num_envs, draws)


def make_vec_task(
    task: str, num_envs: int, values: Mapping[str, Any] | None = None, **options: Any
) -> ArmVectorEnv:
    """Make many environments of a task."""
    return make_vec_env(num_envs=num_envs, **task_arguments(task, values) | options)
