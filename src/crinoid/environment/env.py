"""One arm as an environment of Gymnasium."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, ClassVar

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.spaces import Box
from jaxtyping import Array, Float

from crinoid.assembly.observables import Entry
from crinoid.dynamics import Outcome
from crinoid.environment.draws import Drawn, Draws
from crinoid.environment.episode import Case, Episode, Rules, Told
from crinoid.environment.named import Named
from crinoid.environment.program import Form, Numbers, numbers_of, often
from crinoid.environment.reward import Moment, closeness
from crinoid.environment.success import Success
from crinoid.scenario import Mistake, Scenario, ScenarioError, one_of, shown
from crinoid.simulation.failure import short_step_failure
from crinoid.simulation.together import on_processor
from crinoid.status import Status

Reward = Callable[[Moment], Float[Array, ""]]
RENDER_MODES = ("rgb_array",)


class ArmEnv(Named, gymnasium.Env[np.ndarray, np.ndarray]):
    """The closed loop of a scenario, of which the controller stands outside.

    Made by `crinoid.make_env`. A step is a control period: servos and actuators follow the action
    in their own time, and what is observed is what the sensors give, late and noisy as they are.
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": list(RENDER_MODES)}

    def __init__(
        self,
        scenario: Scenario,
        *,
        draw: Mapping[str, Any] | None = None,
        reward: Reward = closeness,
        success: Success | None = None,
        render_mode: str | None = None,
    ) -> None:
        if render_mode is not None and render_mode not in RENDER_MODES:
            text = f"got {shown(render_mode)}, takes {one_of(RENDER_MODES)} or None"
            raise ScenarioError([Mistake("render_mode", text)])
        self.render_mode = render_mode
        self._draws = draws = Draws(scenario, draw)
        self._rules = rules_of(draws, reward, success)
        rate = draws.scenario.control_rate_hz
        self.metadata = {**type(self).metadata, "render_fps": round(rate)}
        self.action_space = space_of(draws.observables.actions, np.float32)
        self.observation_space = space_of(draws.observables.entries, np.float64)
        case, rules = draws.first.case, self._rules
        cases = Form(case)
        with on_processor():
            episodes = Form(jax.eval_shape(rules.begin, case))
        self._form = episodes

        def begin(numbers: Numbers) -> Numbers:
            return numbers_of(rules.begin(cases.tree(numbers)))

        def go_on(
            numbers: Numbers, episode: Numbers, action: Array, commands: Array
        ) -> tuple[Numbers, Array, Numbers]:
            after, told, outcome = rules.go_on(
                cases.tree(numbers), episodes.tree(episode), action, commands
            )
            return numbers_of(after), told.row(), numbers_of(outcome)

        self._begin, self._go_on = often(begin), often(go_on)
        self._idle = np.zeros(len(draws.observables.driven))
        self._drawn: Drawn | None = None
        self._case: Numbers = []
        self._episode: Numbers = []
        self._outcome: Numbers = []
        self._commands, self._over = 0, True
        self._painter: Any = None

    @property
    def scenario(self) -> Scenario:
        """The scenario of this episode, with what was drawn."""
        return (self._drawn or self._draws.first).scenario

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin another episode.

        Parameters
        ----------
        seed
            Seed of everything random, the scenario's ``seed`` among it; drawn if left out.
        options
            ``set``: values of keys of the scenario for this episode; ``draw``: keys with the
            smallest and the largest value to draw from. Dotted keys, as ``--set`` takes them.

        Raises
        ------
        RuntimeError
            If the arm finds no equilibrium to start from.
        ScenarioError
            If a key, a value or a range is not what it takes, or changes the compiled program or
            the limits of actions or observations.
        """
        super().reset(seed=seed)
        self._drawn = self._draws.draw(seed, self.np_random, options)
        with on_processor():
            self._case = numbers_of(self._drawn.case)
            self._episode = self._begin(self._case)
            told = self._advanced(self._idle, 0)
        self._commands, self._painter = 0, None
        return told.observation, self._info(told)

    def step(self, action: Any) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Hold a command for one control period.

        Parameters
        ----------
        action
            The command of each input that can move (``action_names``), in its unit; what goes
            beyond the limits is cut off.

        Raises
        ------
        gymnasium.error.ResetNeeded
            If the episode is over, or none has begun.
        ValueError
            If the action has another shape, or is no number.
        """
        if self._over:
            raise ResetNeeded("the episode is over, or none has begun: takes reset()")
        command = checked(action, self._idle.shape)
        self._commands += 1
        with on_processor():
            told = self._advanced(command, self._commands)
        ended = bool(told.failed or told.success)
        late = bool(told.over) and not ended
        self._over = ended or late
        return told.observation, float(told.reward), ended, late, self._info(told)

    def render(self) -> Any:
        """Return a picture of this instant (height, width, red green blue); None without a mode.

        Raises
        ------
        gymnasium.error.ResetNeeded
            If no episode has begun.
        """
        if self.render_mode is None:
            return None
        if self._drawn is None:
            raise ResetNeeded("no episode has begun: takes reset()")
        from crinoid.environment.picture import Painter  # matplotlib, slow to load

        with on_processor():
            if self._painter is None:
                start = self._form.tree(self._begin(self._case)).now
                self._painter = Painter(self._drawn, start)
            now = self._form.tree(self._episode).now
            return self._painter.at(now, float(self.metadata["render_fps"]))

    def _advanced(self, action: np.ndarray, commands: int) -> Told:
        self._episode, row, self._outcome = self._go_on(
            self._case, self._episode, action, np.asarray(commands)
        )
        self._over = False
        return Told.of(np.asarray(row))

    def _info(self, told: Told) -> dict[str, Any]:
        assert self._drawn is not None
        status = Status.OK.value
        if told.failed:
            status = failure(self._drawn, self._form.tree(self._episode), self._outcome)
        return {
            "time": float(told.time),
            "error": float(told.distance),
            "status": status,
            "is_success": bool(told.success),
        }


def failure(drawn: Drawn, episode: Episode, outcome: Numbers) -> str:
    """Say why an episode could not go on."""
    form = jax.tree.structure(Outcome.of_nothing(converged=True))
    told: Outcome = jax.tree.unflatten(form, outcome)
    return short_step_failure(drawn.scenario, drawn.case.loop.system, episode.now.state, told)


def rules_of(draws: Draws, reward: Reward, success: Success | None) -> Rules:
    """Return the rules of an environment."""
    plan = draws.first.setup.plan
    scale = np.zeros(len(plan.system.tip(plan.state)))
    scale[plan.controlled[0]] = 1.0
    rules = Rules(draws.observables, scale, reward, success)
    case = draws.first.case

    def tried(case: Case) -> Any:
        episode = rules.begin(case)
        return rules.told(case, episode, episode.now, failed=jnp.asarray(False))[1].reward

    shape = jax.eval_shape(tried, case).shape
    if shape:
        text = f"got an array of shape {shape}, takes a function that gives one number"
        raise ScenarioError([Mistake("reward", text)])
    return rules


def space_of(entries: tuple[Entry, ...], kind: Any) -> Box:
    """Return the space of some numbers."""
    limits = np.array([(entry.lower, entry.upper) for entry in entries]).T.astype(kind)
    return Box(limits[0], limits[1], dtype=kind)


def checked(action: Any, shape: tuple[int, ...]) -> np.ndarray:
    """Return an action as numbers."""
    found = np.asarray(action, float)
    if found.shape != shape:
        raise ValueError(f"action: got the shape {found.shape}, takes {shape}")
    if np.isnan(found).any():
        raise ValueError(f"action: got {found.tolist()}, takes numbers")
    return found
