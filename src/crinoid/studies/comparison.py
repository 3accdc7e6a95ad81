"""Comparison of controllers: one scenario under each of them, over many seeds."""

import math
from collections.abc import Callable, Iterator, Sequence
from itertools import islice
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from crinoid.assembly.prepared import Prepared
from crinoid.foundation.status import Status, summed
from crinoid.results.dataset import describe
from crinoid.results.metrics import Measures, measured, measures_of
from crinoid.results.result import Result
from crinoid.scenario import Scenario, ScenarioError, refusal
from crinoid.scenario.library import Source, scenario_of
from crinoid.scenario.sensor import InclinationSensor, inclination_sensor
from crinoid.scenario.variation import Levels
from crinoid.simulation import Progress
from crinoid.simulation.batch import Arm, run_batch
from crinoid.simulation.loop import controller_cpu_time
from crinoid.simulation.loop_margin import factor_for
from crinoid.simulation.setup import Setup, set_up
from crinoid.studies.design import SEED, Design
from crinoid.studies.measures import tabulated
from crinoid.studies.statistics import differences, records, row_means

_CROSSOVER = 1.0  # frequency (Hz) at which the loop crosses over where the margin allows it
_MODULUS = 0.4  # smallest modulus margin of default gains
_KP, _KD = 0.25, 0.5
"""Proportional gain over ``ki / w`` and derivative gain over ``ki / w^2``, ``w`` the first natural
frequency (rad/s): in four built-in scenarios they let ``ki`` be 1.4 to 2 times as large."""
_PID = "control.pid."
_STATIONS = tuple(station / 10 for station in range(11))
"""Default stations where a hybrid controller measures the inclination of the arm."""


def controlled_by(scenario: Scenario, kind: str) -> Scenario:
    """Return a scenario under a kind of controller: with the values of `controller_values`."""
    return scenario.with_values(controller_values(scenario, kind))


def controller_values(scenario: Scenario, kind: str) -> dict[str, Any]:
    """Return the values of a scenario under a kind of controller, without the run for comparison.

    A PID without gains in the scenario drives every input that moves the controlled quantities, all
    with the same gains. Through the static Jacobian each of them sees a plant of gain one, so
    ``ki`` is where the loop crosses over (rad/s): 1 Hz, or as much less as leaves a modulus margin
    of 0.4 in the linear loop (`crinoid.simulation.loop_margin`). Next to it ``kp = ki / 4 w``,
    ``kd = ki / 2 w^2`` and a filter of the derivative at ``w``, the arm's first natural frequency.

    A hybrid controller sees by inclinations along the arm: at eleven stations, without noise, where
    the scenario has no such sensor.
    """
    values: dict[str, Any] = {"control.kind": kind, "control.compare": False}
    if kind == "none":
        values |= scenario.idle_values
    if kind == "hybrid" and inclination_sensor(scenario.sensors) is None:
        sensor = InclinationSensor(kind="inclination", stations=_STATIONS)
        values["sensors"] = [*scenario.sensors, sensor]
    if kind != "pid" or scenario.control.pid.present:
        return values
    start = 2 * math.pi * _CROSSOVER
    names, setup = _driven(scenario, values)
    if setup is not None and setup.open_loop is not None and setup.modes is not None:
        first = float(f"{setup.modes.frequency[0]:.2g}")
        trial = scenario.with_values(values | {"control.pid": _gains(names, start, first)})
        loop = set_up(Prepared(trial)).open_loop
        factor = 0.0 if loop is None else factor_for(loop, _MODULUS)
        if factor:
            # two digits, rounded down
            unit = 10.0 ** (math.floor(math.log10(factor * start)) - 1)
            ki = float(f"{math.floor(factor * start / unit + 1e-9) * unit:.6g}")
            return values | {"control.pid": _gains(names, ki, first)}
    text = "missing, and no default gains leave a margin. Set gains for kind pid."
    raise refusal("control.pid", text)


def _driven(scenario: Scenario, values: dict[str, Any]) -> tuple[list[str], Setup | None]:
    """Return the inputs that move the controlled quantities, and the loop that drives them."""
    names = [*scenario.inputs]
    while names:
        try:
            gains = {"control.pid": _gains(names, 1.0, 1.0)}
            return names, set_up(Prepared(scenario.with_values(values | gains)))
        except ScenarioError as error:
            idle = {mistake.key.removeprefix(_PID) for mistake in error.mistakes}
            if not idle <= set(names):
                raise
            names = [name for name in names if name not in idle]
    return names, None


def _gains(names: list[str], ki: float, first: float) -> dict[str, dict[str, float]]:
    """Return the same gains for all inputs, for a first natural frequency (Hz)."""
    slow = 1 / (2 * math.pi * first)
    kp, kd = (float(f"{gain:.2g}") for gain in (_KP * ki * slow, _KD * ki * slow**2))
    return {name: {"kp": kp, "ki": ki, "kd": kd, "derivative_filter_hz": first} for name in names}


COMPARISON, COMPARISON_TABLE = "compare.nc", "compare.csv"
_NUMBERS = (
    *("mean", "low", "high"),
    *("difference", "difference_low", "difference_high", "p_value"),
)
_OF_ANGLE = ("rms_angle_error", "max_angle_error")
_TICK = (
    "CPU time on one core of one call of the compiled controller alone, in the run of the first "
    "seed; median of five measurements over many calls in a row"
)


def compared_measures(data: xr.Dataset) -> list[str]:
    """Return the names of the measures in the dataset of a comparison."""
    over = ("controller", "seed")
    return [str(name) for name, each in data.items() if each.dims == over and name != "status"]


def best_controller(data: xr.Dataset) -> int:
    """Return the index of the controller with the smallest mean RMS error; 0 without any run."""
    means = row_means(data["rms_error"].values).value
    return int(np.nanargmin(means)) if np.isfinite(means).any() else 0


def comparison_rows(data: xr.Dataset) -> Iterator[dict[str, Any]]:
    """Yield a row of ``compare.csv`` for each measure and controller, in SI units.

    Differences are those from the controller with the smallest mean RMS error, over the same seeds;
    unknown numbers are empty.
    """
    kinds, best = [str(kind) for kind in data["controller"].values], best_controller(data)
    for name in compared_measures(data):
        values = data[name].values
        means, (than, p_values) = row_means(values), differences(values, values[best])
        columns = np.stack([*means[:3], *than[:3], p_values])
        columns[3:, best] = np.nan
        units = data[name].attrs.get("units", "1")
        about = {"measure": name, "units": units, "controller": kinds, "runs": means.runs}
        numbers = dict(zip(_NUMBERS, columns, strict=True))
        yield from records(pd.DataFrame(about | numbers | {"against": kinds[best]}))


class ControllerComparison:
    """A scenario of one case under several kinds of controllers (`controlled_by`), over seeds."""

    def __init__(self, scenario: Source, kinds: Sequence[str], seeds: Sequence[int]) -> None:
        self.scenario, self.kinds = scenario_of(scenario), list(kinds)
        first = self.scenario.with_values({SEED: seeds[0]})
        under = [controller_values(first, kind) for kind in kinds]
        axes = {"controller": Levels(len(under), under.__getitem__), SEED: Levels.of(SEED, seeds)}
        self.design, self.seeds = Design(self.scenario, axes), list(seeds)
        self._firsts = [self.design.case(run) for run in range(1, self.design.runs + 1, len(seeds))]
        self.controller_cpu_time = []  # NaN without a start
        for case in self._firsts:
            setup = set_up(Prepared(case))
            started = setup.outcome.converged
            time = controller_cpu_time(setup.loop, setup.state) if started else math.nan
            self.controller_cpu_time.append(time)
        self.arms: list[Arm[Measures]] = []  # outcomes of the first runs of the design
        self.has_runs = False  # whether a run has reached its end

    def run(
        self, report: Callable[[Progress], None], stop: Callable[[], bool] = lambda: False
    ) -> None:
        """Run all of it, one controller after the other.

        Each kind is the label of the progress of its runs; ``stop`` is asked about ten times a
        second.
        """

        def take(result: Result) -> Measures:
            measures = measured(result)
            self.has_runs = True
            return measures

        runs = iter(range(1, self.design.runs + 1))
        for kind in self.kinds:
            if stop():
                break
            cases = [self.design.case(run) for run in islice(runs, len(self.seeds))]
            self.arms += run_batch(cases, take, label=kind, report=report, stop=stop)

    @property
    def runs(self) -> dict[str, Arm[Measures]]:
        """Results of the runs so far, by their names."""
        names = (f"{kind} with seed {seed}" for kind in self.kinds for seed in self.seeds)
        return dict(zip(names, self.arms, strict=False))

    def dataset(self) -> xr.Dataset:
        """Return the measures of all runs; NaN of one that did not reach its end."""
        none: Arm[Measures] = Arm(None, f"{Status.INTERRUPTED} before it began", [])
        arms = [*self.arms, *[none] * (self.design.runs - len(self.arms))]
        status = np.array([arm.status for arm in arms], object).reshape(-1, len(self.seeds))
        registry = measures_of(self.scenario)
        if not {"angle", "direction"} & set(self.scenario.control.controlled):
            registry = {name: each for name, each in registry.items() if name not in _OF_ANGLE}
        found = [arm.taken for arm in arms]
        data = tabulated(("controller", SEED), found, status, registry)
        if self.has_runs:
            unknown = [name for name in registry if not np.isfinite(data[name]).any()]
            data = data.drop_vars(unknown)
        about = {"units": "s", "long_name": "time of a command", "comment": _TICK}
        data["tick_time"] = "controller", self.controller_cpu_time, about
        texts = np.array([case.to_toml() for case in self._firsts], object)
        about = {"long_name": "scenario as run with the first seed"}
        data["controller_scenario"] = "controller", texts, about
        return data.assign_coords(
            controller=("controller", self.kinds, {"long_name": "kind of controller"}),
            seed=(SEED, self.seeds, {"long_name": "seed of everything random"}),
        ).assign_attrs(describe(self.scenario) | {"status": summed(status.flat)})
