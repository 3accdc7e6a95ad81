"""Tuning of a controller: an optimisation of its numbers for its cost, with a stability margin."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress

import numpy as np
import xarray as xr
from jaxtyping import Float

from crinoid.inverse import StoppedError
from crinoid.inverse.goal import Goal
from crinoid.inverse.optimisation import STEP, Optimisation, Report
from crinoid.inverse.ranges import Ranges
from crinoid.inverse.stability import StabilityMargin
from crinoid.inverse.trial_runs import TrialRuns
from crinoid.results.dataset import described
from crinoid.scenario import Scenario, got, refusal
from crinoid.scenario.controller import ModelBased

_FACTORS = (1.0, 2.0, 16.0, 0.25)  # factors on the numbers of the scenario, one for each start
_MOST = 1e3  # largest factor on a number, or divisor
_WIDTH = 2 * math.log(_MOST)
COST = "control_cost"  # the measure that tuning minimises
MARGINS = {"modulus": "1", "gain": "1", "phase": "rad", "delay": "s"}
"""Margins of a loop (`crinoid.simulation.loop_margin.Margin`), and their units."""
HELD_OUT = ("before", "after", "uncontrolled")  # controllers that held-out draws compare


class Tuning(Optimisation):
    """Search for the numbers of a controller, with its results so far.

    Each number stays between a thousandth of its given value and 1000 times; one that is 0 stays 0,
    others keep their sign. The search minimises the logarithm of the cost
    (`crinoid.results.effort.control_cost`), of all time steps, from several factors on the given
    numbers. ``margin`` is the required modulus margin; 0: none. There are as many held-out draws as
    others.
    """

    step, logarithm = STEP / _WIDTH, True

    def __init__(
        self, scenario: Scenario, seeds: int, iterations: int, margin: float = 0.0
    ) -> None:
        numbers = tunable_numbers(scenario)
        judged, simulation = scenario.judged_from, scenario.simulation
        if judged > simulation.duration - simulation.time_step:
            text = got(judged, "be a time step or more before simulation.duration")
            raise refusal("target.judged_from", text)
        each_step = {"output.interval": scenario.simulation.time_step}
        scenario = scenario.with_values(numbers | each_step)
        ends = ((key, sorted([each / _MOST, each * _MOST])) for key, each in numbers.items())
        ranges = Ranges(scenario, [f"{key}={low!r}:{high!r}:log" for key, (low, high) in ends])
        super().__init__(
            scenario,
            ranges,
            Goal(scenario, COST, (), margin),
            seeds,
            iterations,
            rest=False,
            margin=StabilityMargin(scenario, margin) if margin else None,
        )
        self.shares = math.ceil(iterations / 2), iterations
        self.total = len(_FACTORS) * self.shares[0] + iterations
        signs = np.sign(ranges.given)
        self.starts = [ranges.start + signs * math.log(each) / _WIDTH for each in _FACTORS]
        self.held_out: Float[np.ndarray, "controller measure draw"] | None = None
        """Cost and RMS error of the tip, of the controllers `HELD_OUT`."""

    def run(self, report: Report, stop: Callable[[], bool]) -> None:
        """Search for `best`, and compare it in held-out draws."""
        super().run(report, stop)
        if self.best is not None and not self._stop():
            with suppress(StoppedError):
                self._hold_out()

    def _hold_out(self) -> None:
        goal = Goal(self.scenario, COST, ["rms_error<1"])
        seeds = [each + len(self.seeds) for each in self.seeds]
        runs = TrialRuns(goal, seeds, self._stop, rest=False)
        runs.settings["control.compare"] = False
        others = (self.numbers(), self.scenario.idle_values)
        self.held_out = runs([self.scenario, *map(self.scenario.with_values, others)])

    def dataset(self, status: str) -> xr.Dataset:
        """Return the course of the search, the margins, and what held-out draws give."""
        rows = []
        if self.held_out is not None:
            rows = [("held_out", "controller error held_out_draw", "m", self.held_out,
                     "cost, and RMS error of the tip")]  # fmt: skip
        waters = {}
        for when, numbers in (("before", {}), ("after", self.numbers())):
            if self.margin is None:
                continue
            loop = self.margin.closed(self.scenario.with_values(numbers))
            margin, waters[f"{when}_water"] = loop.open.margin(), loop.water
            for name, unit in MARGINS.items():
                value = np.array(getattr(margin, name) if margin.stable else np.nan)
                rows.append((f"{when}_{name}_margin", "", unit, value, ""))
        found = super().dataset(status).assign(described(rows)).assign_attrs(waters)
        return found.assign_coords(controller=list(HELD_OUT), error=[COST, "rms_error"])


def tunable_numbers(scenario: Scenario) -> dict[str, float]:
    """Return the numbers that tuning varies, by key, at their present values."""
    control, settings = scenario.control, scenario.control.settings
    if control.gains:
        found = {
            f"control.pid.{name}.{gain}": float(value)
            for name in scenario.driven
            for gain in ("kp", "ki", "kd")
            if (value := getattr(control.gains[name], gain))
        }
        if not found:
            raise refusal("control.pid", "has no gains to tune. Set initial gains other than 0.")
        return found
    if not isinstance(settings, ModelBased):
        must, hint = 'be "pid", "lqg" or "mpc"', "Other controllers have nothing to tune."
        raise refusal("control.kind", got(control.kind, must, hint))
    return {
        f"control.{control.kind}.smoothness": settings.smoothness_in(scenario),
        f"control.{control.kind}.integral_time": settings.integral_time,
    }
