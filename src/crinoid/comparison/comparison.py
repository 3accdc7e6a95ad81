"""Runs of a scenario under several controllers, and the dataset that sums them up."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from crinoid.assembly.prepared import Prepared
from crinoid.comparison.gains import controlled_by
from crinoid.dataset import describe
from crinoid.metrics import angle_error, input_speed, spent_work, tip_error
from crinoid.result import Result
from crinoid.scenario import Scenario
from crinoid.simulation import Progress
from crinoid.simulation.batch import Arm, run_batch
from crinoid.simulation.setup import set_up
from crinoid.simulation.tick import tick_time
from crinoid.status import Status

__all__ = ["COMPARISON", "Comparison", "Measures"]

COMPARISON = "compare.nc"

_NUMBERS = {
    "rms_error": ("m", "RMS distance of the tip from where it should be"),
    "max_error": ("m", "largest distance of the tip from where it should be"),
    "fluctuation": ("m", "RMS distance of the tip from its own mean position"),
    "rms_angle_error": ("rad", "RMS angle between where the tip points and where it should"),
    "max_angle_error": ("rad", "largest angle between where the tip points and where it should"),
    "work": ("J", "work that base and actuators did on the arm, what it gave back not counted"),
}
"""Unit and meaning of the numbers of each run."""
_TICK = (
    "CPU time on one core of one call of the compiled controller alone, in the run of the first "
    "seed; median of five measurements over many calls in a row"
)


class Measures(NamedTuple):
    """Sums of one run."""

    numbers: dict[str, float]
    """By name, such as ``rms_error``."""
    speed: dict[str, float]
    """RMS speed of each input that can move."""
    unit: dict[str, str]
    """Units of the speeds."""


class Comparison:
    """A scenario under several controllers, over several seeds.

    Parameters
    ----------
    scenario
        One case (`crinoid.Scenario.cases`).
    kinds
        Kinds of controllers, as ``control.kind`` takes them; see `controlled_by`.
    seeds
        Values of ``seed``, which draws currents and the noise of sensors.

    Raises
    ------
    ScenarioError
        If the scenario cannot be run under one of them.
    """

    def __init__(self, scenario: Scenario, kinds: Sequence[str], seeds: Sequence[int]) -> None:
        self.scenario, self.seeds = scenario, list(seeds)
        first = scenario.with_values({"seed": self.seeds[0]})
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
            name: (over, numbers[name], {"units": unit, "long_name": meaning})
            for name, (unit, meaning) in _NUMBERS.items()
        }
        found["effort"] = (
            (*over, "input"),
            effort,
            {
                "long_name": "RMS speed of the inputs, of means between saved instants",
                "comment": "in input_unit",  # CF has none for a mixture
            },
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
            attrs=describe(self.scenario) | {"status": _summed(status)},
        )


def measured(result: Result) -> Measures:
    """Return the sums of a run."""
    tip, angle, data = tip_error(result), angle_error(result), result.dataset
    speed = input_speed(result)
    unit = dict(zip(data["channel"].values, data["channel_unit"].values, strict=True))
    if "input" in data:
        unit |= dict(zip(data["input"].values, data["input_unit"].values, strict=True))
    values = (
        *(tip.rms, tip.maximum, tip.fluctuation),
        *(angle.rms, angle.maximum, spent_work(result)),
    )
    return Measures(
        dict(zip(_NUMBERS, values, strict=True)),
        speed,
        {name: _per_second(str(unit[name])) for name in speed},
    )


def _per_second(unit: str) -> str:
    return "s-1" if unit == "1" else f"{unit} s-1"


def _tick_time(case: Scenario) -> float:
    """Return the time that a controller takes for a command (s); NaN where it has no start."""
    setup = set_up(Prepared(case))
    return tick_time(setup.loop, setup.state) if setup.outcome.converged else float("nan")


def _summed(status: np.ndarray) -> str:
    """Return the status of all runs together."""
    words = [str(each) for each in status.flat]
    wrong = [each for each in words if Status.of(each) is not Status.OK]
    if not wrong:
        return Status.OK.value
    stopped = [each for each in wrong if Status.of(each) is Status.INTERRUPTED]
    if stopped:
        return f"{Status.INTERRUPTED}: {len(words) - len(wrong)} of {len(words)} runs are complete"
    return f"{Status.FAILED}: {len(wrong)} of {len(words)} runs did not reach their end"
