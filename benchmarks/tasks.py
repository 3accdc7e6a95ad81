"""Tasks: how well base and chambers do them together, over draws of the turbulence."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import xarray as xr

from benchmarks.measurement import Rows, Scope, over_seeds, row
from crinoid.scenario import Scenario, load

_NEAR, _TRACED, _REACHED, _GENTLE = 0.01, 0.02, 3.0, 0.5
"""Largest error over the length, RMS error over a radius, time to a target (s), and force (N)."""
_HOLD, _TOUCH = (6.0, 11.0), (11.0, 17.5)
"""Times of `sampling` in which the tip lifts a load, and in which it may touch (s)."""


class Score(NamedTuple):
    """A measure of a task, and whether it is good enough."""

    value: float
    unit: str
    good: bool


Scores = dict[str, Score]


def _trace(data: xr.Dataset, scenario: Scenario) -> Scores:
    assert scenario.target.radius is not None
    error = data["tip_error"].values[data["time"].values >= 2.0]
    share = float(np.sqrt(np.mean(error**2))) / scenario.target.radius
    return {"RMS error over the radius": Score(share, "1", share <= _TRACED)}


def _reach(data: xr.Dataset, scenario: Scenario) -> Scores:
    time, error = data["time"].values, data["tip_error"].values
    # the path rests in between: it leaves for a target, and for the next one
    given = np.array(scenario.target.time)[1:-1:2]
    longest = 0.0
    for begin, leave in zip(given, [*given[1:], np.inf], strict=True):
        between = (time >= begin) & (time < leave)
        away = time[between & (error > _NEAR * scenario.arm.length)]
        longest = max(longest, float(away[-1]) - begin if away.size else 0.0)
    return {"longest time to a target": Score(longest, "s", longest <= _REACHED)}


def _sampling(data: xr.Dataset, scenario: Scenario) -> Scores:
    time = data["time"].values
    error = data["tip_error"].values / scenario.arm.length
    force = np.linalg.norm(data["contact_force"].values, axis=-1).reshape(time.size, -1).max(axis=1)
    held = float(error[(time >= _HOLD[0]) & (time <= _HOLD[1])].max())
    outside = force[(time < _TOUCH[0]) | (time > _TOUCH[1])]
    most, last = float(force.max()), float(error[time >= time[-1] - 1.0].max())
    return {
        "error of the held tip over the length": Score(held, "1", held <= _NEAR),
        "force of the touch": Score(most, "N", 0 < most < _GENTLE and not np.any(outside > 0)),
        "error after the retreat over the length": Score(last, "1", last <= _NEAR),
    }


Task = Callable[[xr.Dataset, Scenario], Scores]
TASKS: dict[str, Task] = {
    name + space: task
    for name, task in {"trace": _trace, "reach": _reach, "sampling": _sampling}.items()
    for space in ("", "-3d")
}


def benchmark(scope: Scope) -> Rows:
    """Yield the measures of each built-in task over seeds, and the share of the runs that do it."""
    for name, task in list(TASKS.items())[: scope.most]:
        scenario = scope.shortened(load(name))
        scores = over_seeds(
            scenario, scope.seeds, lambda run, task=task: task(run.dataset, run.scenario)
        )
        for measure, first in scores[0].items():
            values = [each[measure].value for each in scores]
            yield row(name, measure, first.unit, values, seeds=scope.seeds)
        done = sum(all(score.good for score in each.values()) for each in scores) / len(scores)
        yield row(name, "share of runs that do the task", "1", [done], seeds=scope.seeds)
