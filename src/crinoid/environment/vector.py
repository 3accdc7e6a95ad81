"""Many arms as one vector environment of Gymnasium, which begins episodes by itself."""

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

from crinoid.environment.draws import Drawn, Draws
from crinoid.environment.env import Reward, checked, failure, rules_of, space_of
from crinoid.environment.episode import Episode, Told
from crinoid.environment.named import Named
from crinoid.environment.program import Form, Numbers, numbers_of, often
from crinoid.environment.reward import closeness
from crinoid.environment.success import Success
from crinoid.scenario import Mistake, Scenario, ScenarioError, shown
from crinoid.simulation.batch import cores
from crinoid.status import Status

_FEWEST = 16
"""Episodes that are prepared at least, where nothing is said."""


class ArmVectorEnv(Named, VectorEnv[np.ndarray, np.ndarray, np.ndarray]):
    """Many arms of one scenario; made by `crinoid.make_vec_env`.

    After the step that ended its episode an arm begins the next one: the action of that step is not
    used, its reward is 0.
    """

    metadata: ClassVar[dict[str, Any]] = {"autoreset_mode": AutoresetMode.NEXT_STEP}

    def __init__(
        self,
        scenario: Scenario,
        num_envs: int,
        *,
        draw: Mapping[str, Any] | None = None,
        reward: Reward = closeness,
        success: Success | None = None,
        draws: int | None = None,
    ) -> None:
        self.num_envs = _count("num_envs", num_envs)
        self._count = max(num_envs, _FEWEST) if draws is None else _count("draws", draws)
        self._draws = source = Draws(scenario, draw)
        rules = rules_of(source, reward, success)
        self.single_action_space = space_of(source.observables.actions, np.float32)
        self.single_observation_space = space_of(source.observables.entries, np.float64)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self._shape = num_envs, len(source.observables.driven)
        case = source.first.case
        cases, episodes = Form(case), Form(jax.eval_shape(rules.begin, case))
        self._form, count = episodes, num_envs

        def begin(numbers: Numbers) -> Numbers:
            return numbers_of(rules.begin(cases.tree(numbers)))

        def one(
            pool: Numbers, starts: Numbers, row: Array, fresh: Array, episode: Numbers, act: Array
        ) -> tuple[Numbers, Array, Numbers]:
            case = cases.tree([number[row] for number in pool])
            episode = jax.lax.cond(
                fresh, lambda: [number[row] for number in starts], lambda: episode
            )
            before = episodes.tree(episode)
            after, told, outcome = rules.go_on(case, before, act, before.now.ticks + ~fresh)
            return numbers_of(after), told.row(), numbers_of(outcome)

        def go_on(
            pool: Numbers, starts: Numbers, rows: Array, fresh: Array, some: Numbers, acts: Array
        ) -> tuple[Numbers, Array, Numbers]:
            # together an arm costs as much as alone on a processor, and waits for the slowest
            def each(own: Any) -> Any:
                return one(pool, starts, *own)

            every = rows, fresh, some, acts
            return jax.lax.map(each, every) if self._alone else jax.vmap(each)(every)

        self._alone = not on_accelerator()
        most = min(cores(), num_envs) if self._alone else 1
        parts = next(k for k in range(most, 0, -1) if count % k == 0)
        self._threads = ThreadPoolExecutor(parts)
        self._slices = [slice(k * count // parts, (k + 1) * count // parts) for k in range(parts)]
        self._begin, self._go_on = often(begin), often(go_on)
        self._pool: list[Drawn] = []
        self._cases: Numbers = []
        self._starts: Numbers = []
        self._parts: list[Numbers] = []
        self._rows, self._fresh = np.arange(count) % self._count, np.ones(count, bool)

    @property
    def scenarios(self) -> list[Scenario]:
        """The scenarios that were drawn."""
        return [drawn.scenario for drawn in self._pool]

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin an episode of each arm, and prepare those that follow.

        Parameters
        ----------
        seed
            Seed of the first draw, that of the others one more each; drawn if left out.
        options
            As `crinoid.environment.env.ArmEnv.reset` takes them, for all draws.

        Raises
        ------
        RuntimeError
            If an arm finds no equilibrium to start from.
        ScenarioError
            As `crinoid.environment.env.ArmEnv.reset` does.
        """
        super().reset(seed=seed)
        first = int(self.np_random.integers(2**31)) if seed is None else seed
        pool = [
            self._draws.draw(first + k, seeding.np_random(first + k)[0], options)
            for k in range(self._count)
        ]
        cases = [numbers_of(drawn.case) for drawn in pool]
        starts = [self._begin(case) for case in cases]
        self._pool, self._cases, self._starts = pool, _stacked(cases), _stacked(starts)
        self._rows = np.arange(self.num_envs) % self._count
        self._fresh = np.ones(self.num_envs, bool)
        self._parts = [[number[self._rows[s]] for number in self._starts] for s in self._slices]
        told, _ = self._advanced(np.zeros(self._shape))
        self._fresh = np.zeros(self.num_envs, bool)
        return told.observation, self._info(told, [])

    def step(
        self, actions: Any
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Hold a command of each arm for one control period.

        Parameters
        ----------
        actions
            The commands, a row an arm, in the units of the inputs.

        Raises
        ------
        gymnasium.error.ResetNeeded
            If there was no reset before.
        ValueError
            If the actions have another shape, or one is no number.
        """
        if not self._pool:
            raise ResetNeeded("no episode has begun: takes reset()")
        commands = checked(actions, self._shape)
        self._rows = np.where(self._fresh, (self._rows + self.num_envs) % self._count, self._rows)
        told, outcomes = self._advanced(commands)
        begun = self._fresh
        ended = (told.failed | told.success) & ~begun
        late = told.over & ~ended & ~begun
        self._fresh = ended | late
        reward = np.where(begun, 0.0, told.reward)
        return told.observation, reward, ended, late, self._info(told, outcomes)

    def close_extras(self, **kwargs: Any) -> None:
        """Let go of the threads."""
        self._threads.shutdown()

    def _advanced(self, commands: np.ndarray) -> tuple[Told, list[Numbers]]:
        def run(part: int) -> tuple[Numbers, np.ndarray, Numbers]:
            here, own = self._slices[part], self._parts[part]
            own, rows, outcomes = self._go_on(
                self._cases, self._starts, self._rows[here], self._fresh[here], own, commands[here]
            )
            return own, np.asarray(rows), outcomes

        found = list(self._threads.map(run, range(len(self._slices))))
        self._parts = [own for own, _, _ in found]
        return Told.of(np.concatenate([rows for _, rows, _ in found])), [o for _, _, o in found]

    def _info(self, told: Told, outcomes: Sequence[Numbers]) -> dict[str, Any]:
        status = np.full(self.num_envs, Status.OK.value, object)
        for arm in np.flatnonzero(told.failed):
            part = next(k for k, s in enumerate(self._slices) if s.start <= arm < s.stop)
            row = arm - self._slices[part].start
            episode: Episode = self._form.tree([number[row] for number in self._parts[part]])
            outcome = [number[row] for number in outcomes[part]]
            status[arm] = failure(self._pool[self._rows[arm]], episode, outcome)
        values = {
            "time": told.time,
            "error": told.distance,
            "status": status,
            "is_success": told.success,
        }
        every = np.ones(self.num_envs, bool)
        return values | {f"_{name}": every for name in values}


def on_accelerator() -> bool:
    """Tell whether JAX computes elsewhere than on the processor."""
    return jax.default_backend() != "cpu"


def _stacked(every: Sequence[Numbers]) -> Numbers:
    return [
        jnp.asarray(np.stack([np.asarray(x) for x in same])) for same in zip(*every, strict=True)
    ]


def _count(name: str, given: Any) -> int:
    if not isinstance(given, int) or isinstance(given, bool) or given < 1:
        text = f"got {shown(given)}, takes a number of 1 or more"
        raise ScenarioError([Mistake(name, text)])
    return given
