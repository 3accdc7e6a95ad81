"""Runs of a scenario under several controllers, and the dataset that sums them up."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import xarray as xr

from crinoid.assembly.prepared import Prepared
from crinoid.batch.measures import EFFORT, MEASURES, Measures, measured
from crinoid.comparison.gains import controlled_by
from crinoid.dataset import describe
from crinoid.result import Result
from crinoid.scenario import Scenario
from crinoid.scenario.library import Source, scenario_of
from crinoid.simulation import Progress
from crinoid.simulation.batch import Arm, run_batch
from crinoid.simulation.setup import set_up
from crinoid.simulation.tick import tick_time
from crinoid.status import Status, summed

__all__ = ["COMPARISON", "Comparison"]

COMPARISON = "compare.nc"

_NUMBERS = (
    *("rms_error", "max_error", "fluctuation"),
    *("rms_angle_error", "max_angle_error", "work"),
)
_TICK = (
    "CPU time on one core of one call of the compiled controller alone, in the run of the first "
    "seed; median of five measurements over many calls in a row"
)


class Comparison:
    """A scenario under several controllers, over several seeds.

    Parameters
    ----------
    scenario
        One case (`crinoid.Scenario.cases`), the name of a built-in scenario, or a file.
    kinds
        Kinds of controllers, as ``control.kind`` takes them; see `controlled_by`.
    seeds
        Values of ``seed``, which draws currents and the noise of sensors.
    """

    def __init__(self, scenario: Source, kinds: Sequence[str], seeds: Sequence[int]) -> None:
        self.scenario, self.seeds = scenario_of(scenario), list(seeds)
        first = self.scenario.with_values({"seed": self.seeds[0]})
        self.cases = {kind: controlled_by(first, kind) for kind in kinds}
        self.tick_time = {kind: _tick_time(case) for kind, case in self.cases.items()}
        self.arms: dict[str, list[Arm[Measures]]] = {}
        self.begun = False
        """Whether a run has reached its end."""

    def run(
        self, report: Callable[[Progress], None], stop: Callable[[], bool] = lambda: False
    ) -> None:
        """Run all of it, one controller after the other.

        Parameters
        ----------
        report
            Called with the progress of the runs under one controller, whose kind is its label.
        stop
            Asked about ten times a second whether to stop.
        """

        def take(result: Result) -> Measures:
            measures = measured(result)
            self.begun = True
            return measures

        for kind, case in self.cases.items():
            if stop():
                break
            scenarios = [case.with_values({"seed": seed}) for seed in self.seeds]
            self.arms[kind] = run_batch(scenarios, take, label=kind, report=report, stop=stop)

    @property
    def notes(self) -> dict[str, list[str]]:
        """Notes on each run, by its name."""
        return {f"{kind} with seed {seed}": arm.notes for (kind, seed), arm in self.runs.items()}

    @property
    def runs(self) -> dict[tuple[str, int], Arm[Measures]]:
        """Results of the runs so far, by controller and seed."""
        return {
            (kind, seed): arm
            for kind, arms in self.arms.items()
            for seed, arm in zip(self.seeds, arms, strict=True)
        }

    def dataset(self) -> xr.Dataset:
        """Return the sums of all runs; of one that did not reach its end they are NaN."""
        runs, over = self.runs, ("controller", "seed")
        complete = {key: arm.taken for key, arm in runs.items() if arm.taken is not None}
        units: dict[str, str] = {}
        for measures in complete.values():
            units |= measures.unit
        size = (len(self.cases), len(self.seeds))
        numbers = {name: np.full(size, np.nan) for name in _NUMBERS}
        effort = np.full((*size, len(units)), np.nan)
        status = np.full(size, f"{Status.INTERRUPTED} before it began", object)
        for row, kind in enumerate(self.cases):
            for column, seed in enumerate(self.seeds):
                if (kind, seed) in runs:
                    status[row, column] = runs[kind, seed].status
                if (kind, seed) in complete:
                    measures = complete[kind, seed]
                    for name, values in numbers.items():
                        values[row, column] = measures.numbers[name]
                    effort[row, column] = [measures.speed[name] for name in units]
        found: dict[str, tuple[Any, ...]] = {
            name: (over, values, MEASURES[name].attributes) for name, values in numbers.items()
        }
        found["effort"] = (
            (*over, "input"),
            effort,
            {"long_name": EFFORT, "comment": "in input_unit"},  # CF has none for a mixture
        )
        found["tick_time"] = (
            "controller",
            list(self.tick_time.values()),
            {"units": "s", "long_name": "time that a command takes", "comment": _TICK},
        )
        found["status"] = (over, status, {"long_name": "ok, or what went wrong and when"})
        found["controller_scenario"] = (
            "controller",
            np.array([case.to_toml() for case in self.cases.values()], object),
            {"long_name": "scenario as run with the first seed"},
        )
        if not {"angle", "direction"} & set(self.scenario.control.controlled):
            del found["rms_angle_error"], found["max_angle_error"]
        return xr.Dataset(
            found,
            coords={
                "controller": ("controller", list(self.cases), {"long_name": "kind of controller"}),
                "seed": ("seed", self.seeds, {"long_name": "seed of everything random"}),
                "input": ("input", list(units), {"long_name": "input that can move"}),
                "input_unit": ("input", list(units.values()), {"long_name": "unit of effort"}),
            },
            attrs=describe(self.scenario) | {"status": summed(status.flat)},
        )


def _tick_time(case: Scenario) -> float:
    """Return the time that a controller takes for a command (s); NaN where it has no start."""
    setup = set_up(Prepared(case))
    return tick_time(setup.loop, setup.state) if setup.outcome.converged else float("nan")
