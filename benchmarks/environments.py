"""Time the environments: steps a second of many arms in one call, and of one process for each.

The arms follow random commands. All contestants are measured in turn, in one run; where
gym-softrobot is installed (it needs Python 3.12 or newer) its SoftPendulum-v0 is one of them.
"""

import argparse
import json
import time
from collections.abc import Callable
from functools import partial
from importlib.util import find_spec
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AsyncVectorEnv, SyncVectorEnv, VectorEnv
from rich.console import Console
from rich.table import Table

import crinoid
from step import RESULTS

SECONDS = 2.0
"""Time that each is measured for, in each repeat."""


def main() -> None:
    """Time all contestants and print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenario", default="station-keeping")
    parser.add_argument("--counts", type=int, nargs="+", default=[1, 2, 8, 32])
    parser.add_argument("--processes", type=int, nargs="*", default=[2, 4])
    parser.add_argument("--repeats", type=int, default=5)
    options = parser.parse_args()
    make = partial(crinoid.make_env, options.scenario)
    contestants: list[tuple[str, int, Callable[[], VectorEnv]]] = [
        (f"{count} in one call", count, partial(crinoid.make_vec_env, options.scenario, count))
        for count in options.counts
    ]
    contestants += [
        ("1 alone", 1, lambda: SyncVectorEnv([make])),
        *(
            (f"{count} processes", count, partial(AsyncVectorEnv, [make] * count, context="spawn"))
            for count in options.processes
        ),
    ]
    period = 1.0 / crinoid.load(options.scenario).control_rate_hz
    periods = [period] * len(contestants)
    if find_spec("gym_softrobot") is not None:
        import gym_softrobot  # noqa: F401

        other = gymnasium.make("SoftPendulum-v0", disable_env_checker=True)
        periods.append(other.unwrapped.time_step * other.unwrapped.step_skip)
        contestants.append(
            (f"SoftPendulum-v0, {other.unwrapped.n_elems + 1} nodes", 1, partial(alone, other))
        )
    rows: list[dict[str, Any]] = []
    envs = []
    for (name, count, build), step in zip(contestants, periods, strict=True):
        begun = time.perf_counter()
        env = build()
        env.reset(seed=0)
        run(env, 1)
        ready = time.perf_counter() - begun
        rows.append({"name": name, "count": count, "ready": ready, "step": step})
        envs.append(env)
    speeds: list[list[float]] = [[] for _ in envs]
    for _ in range(options.repeats):  # in turn, so that a busy machine slows all of them alike
        for env, found in zip(envs, speeds, strict=True):
            env.reset(seed=0)
            steps, begun = 0, time.perf_counter()
            while time.perf_counter() - begun < SECONDS:
                run(env, 10)
                steps += 10
            found.append(steps * env.num_envs / (time.perf_counter() - begun))
    for env in envs:
        env.close()
    console = Console(highlight=False, markup=False, width=100)
    table = Table(title=options.scenario, title_justify="left")
    for title in (
        *("environments", "ready after (s)", "steps/s, median", "steps/s, most"),
        "simulated s/s",
    ):
        table.add_column(title, justify="left" if title == "environments" else "right")
    for row, found in zip(rows, speeds, strict=True):
        row |= {"median": float(np.median(found)), "most": max(found)}
        told = f"{row['ready']:.1f}", f"{row['median']:,.0f}", f"{row['most']:,.0f}"
        table.add_row(row["name"], *told, f"{row['median'] * row['step']:.1f}")
    console.print(table)
    RESULTS.mkdir(exist_ok=True)
    (RESULTS / "environments.json").write_text(json.dumps(rows, indent=2), "utf-8")


def alone(env: gymnasium.Env) -> VectorEnv:
    """Return one environment as a vector of one."""
    return SyncVectorEnv([lambda: env])


def run(env: VectorEnv, steps: int) -> None:
    """Take some steps with small random commands."""
    actions = np.asarray(0.1 * env.action_space.sample(), np.float32)
    for _ in range(steps):
        env.step(actions)


if __name__ == "__main__":
    main()
