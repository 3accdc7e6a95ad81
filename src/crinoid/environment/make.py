"""Environments from scenarios, and from tasks with an id."""

from collections.abc import Mapping
from typing import Any

from crinoid.environment.env import ArmEnv, Reward
from crinoid.environment.reward import closeness
from crinoid.environment.success import Success
from crinoid.environment.tasks import TASKS
from crinoid.environment.vector import ArmVectorEnv
from crinoid.scenario.library import Source, load, scenario_of

__all__ = ["make_env", "make_task", "make_vec_env", "make_vec_task"]


def make_env(
    scenario: Source,
    *,
    draw: Mapping[str, tuple[float, float]] | None = None,
    reward: Reward = closeness,
    success: Success | None = None,
    render_mode: str | None = None,
) -> ArmEnv:
    """Make an environment of Gymnasium of a scenario; it needs ``crinoid[learn]``.

    The action takes the place of ``control.kind``: the commands of all inputs that can move, once
    a control period.

    Parameters
    ----------
    scenario
        One case (`crinoid.Scenario.cases`), the name of a built-in scenario, or a file.
    draw
        Keys that every episode draws, each with the smallest and the largest value: dotted keys, as
        ``--set`` takes them.
    reward
        From a `crinoid.environment.reward.Moment` to a number: a function that JAX can trace.
    success
        When the task is done; never if left out.
    render_mode
        ``rgb_array`` or None.

    Raises
    ------
    ImportError
        If Gymnasium is not installed.
    RuntimeError
        If the arm finds no equilibrium to start from.
    ScenarioError
        If anything is wrong with the scenario or the ranges, or an input has no limits.
    """
    return ArmEnv(
        scenario_of(scenario), draw=draw, reward=reward, success=success, render_mode=render_mode
    )


def make_vec_env(
    scenario: Source,
    num_envs: int,
    *,
    draw: Mapping[str, tuple[float, float]] | None = None,
    reward: Reward = closeness,
    success: Success | None = None,
    draws: int | None = None,
) -> ArmVectorEnv:
    """Make many environments of a scenario that take their steps in one call.

    They begin episodes by themselves (``AutoresetMode.NEXT_STEP``), each from the next of a number
    of draws that are prepared at a reset: episode ``k`` of environment ``i`` is draw
    ``(i + k num_envs) % draws``, which is that of `make_env` after ``reset(seed=seed + draw)``.

    Parameters
    ----------
    scenario, draw, reward, success
        As `make_env` takes them.
    num_envs
        How many, 1 or more. On a CPU their steps are spread over threads, on an accelerator they
        are taken together.
    draws
        How many episodes are prepared; ``num_envs``, or 16 if that is less, if left out.

    Raises
    ------
    ImportError
        If Gymnasium is not installed.
    RuntimeError
        If the arm finds no equilibrium to start from.
    ScenarioError
        If anything is wrong with the scenario, the ranges or the numbers.
    """
    return ArmVectorEnv(
        scenario_of(scenario), num_envs, draw=draw, reward=reward, success=success, draws=draws
    )


def make_task(task: str, values: Mapping[str, Any] | None = None, **given: Any) -> ArmEnv:
    """Make the environment of a task; ``values`` change keys of its scenario."""
    return make_env(**_task(task, values, given))


def make_vec_task(
    task: str, num_envs: int, values: Mapping[str, Any] | None = None, **given: Any
) -> ArmVectorEnv:
    """Make many environments of a task."""
    return make_vec_env(num_envs=num_envs, **_task(task, values, given))


def _task(name: str, values: Mapping[str, Any] | None, given: Mapping[str, Any]) -> dict[str, Any]:
    task = TASKS[name]
    scenario = load(task.scenario).with_values(task.values).with_values(values or {})
    success = None if task.success is None else Success(**task.success)
    return {"scenario": scenario, "draw": task.draw, "success": success} | dict(given)
