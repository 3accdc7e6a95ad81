"""Optimisation of two numbers next to a grid of both: time, and the measure that it buys."""

import time
from typing import NamedTuple

import numpy as np

from benchmarks.measurement import Rows, Scope, row
from crinoid.inverse.goal import Goal
from crinoid.inverse.optimisation import Optimisation
from crinoid.inverse.ranges import Ranges
from crinoid.scenario import load

_GRID = 20
"""Numbers of each range in the grid."""


class _Example(NamedTuple):
    scenario: str
    settings: tuple[str, ...]
    over: tuple[str, ...]
    measure: str
    keep: tuple[str, ...]
    rest: bool


_EXAMPLES = {
    "gains": _Example(
        "station-keeping",
        ("arm.nodes=7", "simulation.duration=4", "control.compare=false"),
        ("control.pid.slide.ki=2:14", "control.pid.tilt.ki=2:14"),
        "rms_error",
        ("max_angle_error<0.024",),
        False,
    ),
    "pressure": _Example(
        "reach-pressure",
        (),
        ("arm.radius.1=0.008:0.02", "chamber.0.max_pressure=3e4:1.5e5"),
        "max_pressure",
        ("max_error<0.05",),
        True,
    ),
}
"""Gains in the closed loop, and taper and pressure of an arm at rest."""


def benchmark(scope: Scope) -> Rows:
    """Yield times, trials and measures of the grid and of the search; compiling does not count."""
    for name, example in list(_EXAMPLES.items())[: scope.most]:
        scenario = load(example.scenario, example.settings)
        if scope.duration is not None:
            scenario = scope.shortened(scenario)
        ranges = Ranges(scenario, example.over)
        goal = Goal(scenario, example.measure, example.keep)

        def search(trials: int) -> Optimisation:
            found = Optimisation(scenario, ranges, goal, 1, trials, rest=example.rest)  # noqa: B023
            found.run(lambda *_: None, lambda: False)
            return found

        search(4)  # compiles
        parts = np.linspace(0.0, 1.0, min(_GRID, scope.arms))
        points = [np.array([one, other]) for one in parts for other in parts]
        empty = Optimisation(scenario, ranges, goal, 1, 1, rest=example.rest)
        started = time.perf_counter()
        grid = empty.runs([ranges.scenario(point) for point in points])
        spent = [time.perf_counter() - started]
        started = time.perf_counter()
        best = search(160)
        spent.append(time.perf_counter() - started)
        if best.best is None:
            raise RuntimeError(f"{name}: no trial could be run: {best.runs.failure}")
        results = {
            "grid": (len(points), grid[np.argmin(goal.rank(grid))]),
            "optimise": (len(best.trials), best.best.found),
        }
        unit = goal.measures[0].unit
        for (way, (trials, found)), seconds in zip(results.items(), spent, strict=True):
            if goal.violation(found) > 0:
                yield f"{name}, {way}: no trial keeps {', '.join(example.keep)}"
            yield row(f"{name}, {way}", "time", "s", [seconds])
            yield row(f"{name}, {way}", "trials", "1", [float(trials)])
            yield row(f"{name}, {way}", example.measure, unit, [float(found[0].mean())])
