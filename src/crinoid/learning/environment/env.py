"""One arm as an environment of Gymnasium, and the program that it shares with many arms."""

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

from crinoid.assembly.neural import Entry
from crinoid.compilation import OFTEN, require_own_process
from crinoid.dynamics import Outcome
from crinoid.foundation.representation import with_units
from crinoid.foundation.status import Status
from crinoid.learning.environment import TASKS
from crinoid.learning.environment.draws import (
    Arrays,
    EpisodeDraw,
    EpisodeSampler,
    NamedBoxes,
    TreeForm,
    arrays_of,
)
from crinoid.learning.environment.episode import EpisodeParameters, Rules, StepOutput
from crinoid.learning.environment.reward import RewardInput, Success, closeness
from crinoid.scenario import Scenario, got, one_of, refusal
from crinoid.scenario.library import Source, load, scenario_of
from crinoid.simulation.batch import on_processor
from crinoid.simulation.conclusion import short_step_failure
from crinoid.simulation.external import numbers

Reward = Callable[[RewardInput], Float[Array, ""]]
RENDER_MODES = ("rgb_array",)


class EpisodeProgram:
    """Rules, spaces and compiled functions of a scenario's episodes."""

    def __init__(
        self, scenario: Source, draw: Mapping[str, Any] | None, reward: Reward, success: Any
    ) -> None:
        self.sampler = sampler = EpisodeSampler(scenario_of(scenario), draw)
        self._rules = _rules(sampler, reward, success)
        self.action_space = _space(sampler.observables.actions, np.float32)
        self.observation_space = _space(sampler.observables.entries, np.float64)
        self._cases = TreeForm(sampler.first.case)
        with on_processor():
            self.form = TreeForm(jax.eval_shape(self._rules.begin, sampler.first.case))
        self.begin = jax.jit(self._begin, compiler_options=OFTEN)

    def _begin(self, case: Arrays) -> Arrays:
        return arrays_of(self._rules.begin(self._cases.tree(case)))

    def advance(
        self, case: Arrays, episode: Arrays, action: Array, first: Array
    ) -> tuple[Arrays, Array, Arrays]:
        """Return the arrays of `Rules.advance`; traceable."""
        after, output, outcome = self._rules.advance(
            self._cases.tree(case), self.form.tree(episode), action, first
        )
        return arrays_of(after), output.row(), arrays_of(outcome)

    def failure(self, drawn: EpisodeDraw, episode: Arrays, outcome: Arrays) -> str:
        """Return why an episode failed."""
        form = jax.tree.structure(Outcome.of_nothing(converged=True))
        state = self.form.tree(episode).now.state
        solved: Outcome = jax.tree.unflatten(form, outcome)
        return short_step_failure(drawn.scenario, drawn.case.loop.system, state, solved)


class ArmEnv(NamedBoxes, gymnasium.Env[np.ndarray, np.ndarray]):
    """The closed loop of a scenario as an environment: the controller is outside.

    Made by `crinoid.make_env`. A step is a control period. Servos and actuators follow the action
    with their lags, and observations are those of the sensors, late and noisy.
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": list(RENDER_MODES)}

    def __init__(self, program: EpisodeProgram, render_mode: str | None = None) -> None:
        if render_mode is not None and render_mode not in RENDER_MODES:
            raise refusal("render_mode", got(render_mode, f"be {one_of(RENDER_MODES)} or None"))
        self.render_mode = render_mode
        self._program, self._sampler = program, program.sampler
        rate = self._sampler.scenario.control_rate_hz
        self.metadata = {**type(self).metadata, "render_fps": round(rate)}
        self.action_space, self.observation_space = program.action_space, program.observation_space
        self._advance = jax.jit(program.advance, compiler_options=OFTEN)
        self._words = with_units(self.action_names, self.action_units, "share")
        self._idle = np.zeros(len(self._sampler.observables.driven))
        self._drawn: EpisodeDraw | None = None
        self._case: Arrays = []
        self._episode: Arrays = []
        self._outcome: Arrays = []
        self._over = True
        self._painter: Any = None

    @property
    def scenario(self) -> Scenario:
        """Scenario of this episode, with the values drawn."""
        return (self._drawn or self._sampler.first).scenario

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Start another episode.

        Parameters
        ----------
        seed
            Seed of everything random, including the scenario's ``seed``; drawn if None.
        options
            ``set``: values of keys of the scenario for this episode; ``draw``: keys to draw, with
            the smallest and the largest value. Keys are dotted, as in ``--set``.

        Raises
        ------
        RuntimeError
            If the arm has no equilibrium to start from.
        ScenarioError
            If a key, a value or a range is wrong, or changes the compiled program or the limits of
            actions or observations.
        """
        super().reset(seed=seed)
        self._drawn = self._sampler.draw(seed, self.np_random, options)
        with on_processor():
            self._case = arrays_of(self._drawn.case)
            self._episode = self._program.begin(self._case)
        output = self._output(self._idle, first=True)
        self._painter = None
        return output.observation, self._info(output)

    def step(self, action: Any) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Apply a command for one control period.

        Parameters
        ----------
        action
            The command of each driven input (``action_names``), in its unit; limited to its range.

        Raises
        ------
        gymnasium.error.ResetNeeded
            If the episode is over, or none has started.
        ValueError
            If the action has another shape, or is not finite numbers.
        """
        if self._over:
            raise ResetNeeded("the episode is over, or none has started. Call reset().")
        output = self._output(numbers("action", action, self._idle.shape, self._words), first=False)
        ended = bool(output.failed or output.success)
        late = bool(output.over) and not ended
        self._over = ended or late
        return output.observation, float(output.reward), ended, late, self._info(output)

    def render(self) -> Any:
        """Return a picture of this instant (height, width, red green blue); None without a mode.

        Raises
        ------
        gymnasium.error.ResetNeeded
            If no episode has started.
        """
        if self.render_mode is None:
            return None
        if self._drawn is None:
            raise ResetNeeded("no episode has started. Call reset().")
        from crinoid.learning.environment.picture import EpisodePainter  # matplotlib, slow to load

        form = self._program.form
        with on_processor():
            if self._painter is None:
                start = form.tree(self._program.begin(self._case)).now
                self._painter = EpisodePainter(self._drawn, start)
            now = form.tree(self._episode).now
            return self._painter.at(now, float(self.metadata["render_fps"]))

    def _output(self, action: np.ndarray, *, first: bool) -> StepOutput:
        require_own_process()
        with on_processor():
            self._episode, row, self._outcome = self._advance(
                self._case, self._episode, action, np.asarray(first)
            )
        self._over = False
        return StepOutput.of(np.asarray(row))

    def _info(self, output: StepOutput) -> dict[str, Any]:
        assert self._drawn is not None
        status = Status.OK.value
        if output.failed:
            status = self._program.failure(self._drawn, self._episode, self._outcome)
        return {
            "time": float(output.time),
            "error": float(output.distance),
            "status": status,
            "is_success": bool(output.success),
        }


def _rules(sampler: EpisodeSampler, reward: Reward, success: Success | None) -> Rules:
    plan, case = sampler.first.setup.plan, sampler.first.case
    scale = np.zeros(len(plan.system.tip(plan.state)))
    scale[plan.controlled[0]] = 1.0
    rules = Rules(sampler.observables, scale, reward, success)

    def value(case: EpisodeParameters) -> Any:
        episode = rules.begin(case)
        return rules.output(case, episode, episode.now, failed=jnp.asarray(False))[1].reward

    shape = jax.eval_shape(value, case).shape
    if shape:
        raise refusal("reward", f"got an array of shape {shape}; must return a single number")
    return rules


def _space(entries: tuple[Entry, ...], kind: Any) -> Box:
    limits = np.array([(entry.lower, entry.upper) for entry in entries]).T.astype(kind)
    return Box(limits[0], limits[1], dtype=kind)


def make_env(
    scenario: Source,
    *,
    draw: Mapping[str, tuple[float, float]] | None = None,
    reward: Reward = closeness,
    success: Success | None = None,
    render_mode: str | None = None,
) -> ArmEnv:
    """Make an environment of Gymnasium from a scenario; it needs ``crinoid[learn]``.

    The action replaces ``control.kind``: it commands all driven inputs, once a control period.

    Parameters
    ----------
    scenario : Scenario, str or path
        One case (`crinoid.Scenario.cases`), the name of a built-in scenario, or a file.
    draw : mapping of str to pair of float
        Keys that every episode draws, each with the smallest and the largest value. Keys are
        dotted, as in ``--set``.
    reward : function
        From a `crinoid.learning.environment.reward.RewardInput` to a number: a function that JAX
        can trace.
    success : Success
        When the task is done; None: never.
    render_mode : str
        ``rgb_array`` or None.

    Returns
    -------
    crinoid.learning.environment.env.ArmEnv

    Raises
    ------
    ImportError
        If Gymnasium is not installed.
    RuntimeError
        If the arm has no equilibrium to start from.
    ScenarioError
        If anything is wrong with the scenario or the ranges, or an input has no limits.

    Examples
    --------
    >>> scenario = crinoid.load("still-water", ["arm.nodes=5", "control.start=0"])
    >>> env = crinoid.make_env(scenario, draw={"load.0.force.1": (0.1, 0.3)})
    >>> observation, info = env.reset(seed=0)
    >>> observation, reward, terminated, truncated, info = env.step([0.0, 0.1])  # m, rad
    >>> observation.shape, info["time"]  # s
    ((15,), 0.01)
    """
    return ArmEnv(EpisodeProgram(scenario, draw, reward, success), render_mode)


def make_task(task: str, values: Mapping[str, Any] | None = None, **options: Any) -> ArmEnv:
    """Make the environment of a task; ``values`` change keys of its scenario."""
    return make_env(**task_arguments(task, values) | options)


def task_arguments(name: str, values: Mapping[str, Any] | None) -> dict[str, Any]:
    """Return the arguments of `make_env` for a task."""
    task = TASKS[name]
    scenario = load(task.scenario).with_values(task.values).with_values(values or {})
    success = None if task.success is None else Success(**task.success)
    return {"scenario": scenario, "draw": task.draw, "success": success}
