"""Optimisation of the numbers of a scenario for a measure of its runs, within limits on others."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_EXCEPTION, Future, ThreadPoolExecutor, wait
from contextlib import suppress
from typing import NamedTuple

import numpy as np
import xarray as xr
from jaxtyping import Float
from scipy.optimize import differential_evolution
from scipy.stats import qmc

from crinoid.analysis.curve import require_effect_at_rest
from crinoid.inverse import StoppedError
from crinoid.inverse.goal import Goal
from crinoid.inverse.gradient_search import GradientSearch
from crinoid.inverse.ranges import Point, Ranges
from crinoid.inverse.smooth_loop import SmoothLoop, StructureError
from crinoid.inverse.stability import StabilityMargin
from crinoid.inverse.trial_runs import TrialRuns
from crinoid.results.dataset import describe, described
from crinoid.scenario import Scenario, ScenarioError, refusal

STEP = 0.2  # first step of a search by gradients
STARTS = 4
"""Number of starts of a search by gradients: the given values, and points that fill the ranges."""
_TOGETHER = 2 / 3
"""Share of the trials in which all starts are improved; the others improve the best point."""
_LOOK = 1e-3  # step of a coordinate in the differences of runs, with which gradients are compared
_VALUE, _SLOPE = 0.01, 0.2
"""Largest relative difference of a measure, and of its gradient, from those of runs."""
_ZERO = 1e-10  # measure (SI units) that is round-off
_POPULATION = 16  # number of points of a generation in a search without gradients
_POLL = 0.1  # time between two checks of the threads of a search (s)
_FINALISTS = 6  # largest number of best trials that are run again with rounded numbers

Found = Float[np.ndarray, "measure draw"]
Report = Callable[[int, int, float], None]


class Trial(NamedTuple):
    """Measures at a point of the ranges."""

    point: Point
    start: int  # number of the start, or of the generation
    found: Found


class Optimisation:
    """Search for numbers of a scenario, with its results so far.

    A point counts by the mean of the measure over the draws; limits hold in each draw. If all
    measures have derivatives, and these agree with differences of runs at the given values, each
    of several starts is improved by gradients through the closed loop (`GradientSearch`). If not,
    a population of points evolves without gradients (differential evolution, Storn and Price
    1997). The best trials are then run as `crinoid.simulate` does, with rounded numbers.

    There are ``seeds`` draws, with seeds from that of the scenario on, or one if all are equal,
    and at most about ``trials`` points. With ``rest`` the measures are those of the equilibrium at
    t = 0. Where a stability ``margin`` is required, each start first moves to a near point with the
    margin, which needs no run.
    """

    step, logarithm = STEP, False
    """First step of a search by gradients, and whether it minimises the logarithm."""

    def __init__(
        self,
        scenario: Scenario,
        ranges: Ranges,
        goal: Goal,
        seeds: int,
        trials: int,
        *,
        rest: bool,
        margin: StabilityMargin | None = None,
    ) -> None:
        if rest:
            require_effect_at_rest("--over", ranges.keys)
        self.scenario, self.ranges, self.goal, self.rest = scenario, ranges, goal, rest
        self.seeds = [scenario.seed + number for number in range(seeds)]
        self.total, self.margin = trials, margin
        self.trials: list[Trial] = []
        self.best: Trial | None = None  # best trial so far; at the end that of the real runs
        self.given: Found | None = None  # measures with the given values
        self.why = ""  # why no gradients are used; empty if they are
        self.starts: list[Point] = [ranges.start]
        self.starts += list(qmc.Sobol(len(ranges.keys), rng=scenario.seed).random(STARTS)[1:])
        first = max(1, round(_TOGETHER * trials / STARTS))
        self.shares = first, trials - STARTS * first
        """Largest numbers of trials: of each start, then of the best point."""
        self.runs = TrialRuns(goal, self.seeds, self._stop, rest=rest, margin=margin)
        self.ended_early = False  # whether a search by gradients had no trials left
        self.random = True  # whether draws differ, as far as is known
        self._poll: Callable[[], None] = lambda: None
        self._lock, self._stopped = threading.Lock(), threading.Event()

    def run(self, report: Report, stop: Callable[[], bool]) -> None:
        """Search for `best`.

        Raises
        ------
        ScenarioError
            If a run with the given values does not have the measures.
        """

        def poll() -> None:
            report(max(0, len(self.trials) - 1), self.total, self.least)
            if stop():
                self._stopped.set()

        self._poll = poll
        with suppress(StoppedError):
            if not self._look():
                return
            if not self.why:
                self._by_gradients()
            else:
                self._without_gradients()
        if self.best is not None and not self._stopped.is_set():
            with suppress(StoppedError):
                self._finish()

    @property
    def least(self) -> float:
        """Least measure so far within the limits; NaN without any."""
        if self.best is None or self.goal.violation(self.best.found) > 0:
            return np.nan
        return float(self.best.found[0].mean())

    def _look(self) -> bool:
        """Run with the given values, and choose the search; return whether they can be run."""
        (self.given,) = self.runs([self.scenario])
        if not self.runs.failure:
            self._look_at_given()
        elif self.margin is None:
            return False
        if self.scenario.control.compared:
            self.runs.settings["control.compare"] = False
            (alone,) = self.runs([self.scenario])
            if not np.array_equal(alone[:, : len(self.seeds)], self.given, equal_nan=True):
                del self.runs.settings["control.compare"]  # a measure needs it
        pairs = zip(self.goal.of_run, self.goal.measures, strict=False)
        without = [name for name, measure in pairs if not measure.smooth]
        if without:
            self.why = f"{', '.join(dict.fromkeys(without))}: no derivatives"
        else:
            scale = None if self.logarithm else abs(float(self.given[0].mean())) or 1.0
            self.why = self._check_gradients(scale)
        return True

    def _look_at_given(self) -> None:
        """Check and keep the measures with the given values, of draws that differ."""
        assert self.given is not None
        options = ("--for", *["--keep"] * len(self.goal.limits))
        for option, name, values in zip(options, self.goal.names, self.given, strict=True):
            if not np.isfinite(values).all():
                raise refusal(option, f"{name} is not a number in this run. Name another measure.")
        if len(self.seeds) > 1 and np.ptp(self.given, axis=1).max() == 0:
            self.random, self.given = False, self.given[:, :1]
            del self.seeds[1:]
        start = self.ranges.start
        if np.allclose([*self.ranges.values(start).values()], self.ranges.given):
            self._keep(Trial(start, 0, self.given))  # what an early interruption saves

    def _check_gradients(self, scale: float | None) -> str:
        """Return how gradients differ from differences of runs at the first start, if they do."""
        try:
            loop = SmoothLoop(self.scenario, self.ranges, self.seeds, rest=self.rest)
            self._search = GradientSearch(
                loop, self.goal, self.margin, self._stop, scale, self.step
            )
            self.starts[0] = start = self._search.begin(self.starts[0])
            # inwards, as a range may end where a number has no meaning
            steps = np.where(start > 0.5, -_LOOK, _LOOK)
            scenarios = [self._scenario(start + step) for step in (0.0 * steps, *np.diag(steps))]
            runs = self.runs(scenarios, self.seeds[:1])[..., 0]
            slopes = (runs[1:] - runs[0]).T / steps
            if self._stop():  # the derivatives need long to compile
                raise StoppedError
            values, gradient = loop.measures(start, self.goal.of_run)
        except (StructureError, ScenarioError, RuntimeError) as error:
            return " ".join(str(error).split())
        if not np.isfinite(runs).all():
            return f"runs about the first start fail: {self.runs.failure}"
        for name, value, row, run, differences in zip(
            self.goal.names, values[:, 0], gradient[:, 0], runs[0], slopes, strict=False
        ):
            if not abs(value - run) <= _VALUE * abs(run) + _ZERO:
                return f"{name} is {run:.4g} in a run and {value:.4g} where it has derivatives"
            size = np.linalg.norm(differences)
            if not np.linalg.norm(row - differences) <= _SLOPE * size + _ZERO / _LOOK:
                return f"derivatives of {name} differ from differences of runs"
        return ""

    def _by_gradients(self) -> None:
        """Improve all starts, then the best point so far with the trials that are left."""

        def descend(number: int, start: Point, trials: int) -> bool:
            return self._search.descend(
                start, trials, lambda point, found: self._keep(Trial(point, number, found))
            )

        first, more = self.shares
        with ThreadPoolExecutor(len(self.starts)) as pool:
            try:
                self._await([pool.submit(descend, *each, first) for each in enumerate(self.starts)])
                self.runs.failure = self.runs.failure or self._search.failure
                if self.best is not None and more > 0:
                    self._await([pool.submit(descend, self.best.start, self.best.point, more)])
            except BaseException:
                self._stopped.set()
                raise

    def _await(self, jobs: Sequence[Future[bool]]) -> None:
        """Wait for descents, polling meanwhile, and keep whether one had no trials left."""
        waiting = set(jobs)
        while waiting:
            done, waiting = wait(waiting, _POLL, FIRST_EXCEPTION)
            self._poll()
            for job in done:
                job.result()  # raises its error
        self.ended_early = any(job.result() for job in jobs)

    def _without_gradients(self) -> None:
        keys, generation = len(self.ranges.keys), 0

        def rank(points: Float[np.ndarray, "key point"]) -> Float[np.ndarray, " point"]:
            nonlocal generation
            found = self.runs([self._scenario(point) for point in points.T])
            for point, each in zip(points.T, found, strict=True):
                self._keep(Trial(point, generation, each))
            generation += 1
            return self.goal.rank(found)

        cloud = qmc.Sobol(keys, rng=self.scenario.seed).random(_POPULATION)
        cloud[0] = self.ranges.start
        differential_evolution(
            rank,
            [(0.0, 1.0)] * keys,
            init=cloud,
            maxiter=max(0, self.total // _POPULATION - 1),
            rng=self.scenario.seed,
            polish=False,
            tol=0.0,
            vectorized=True,
            updating="deferred",
        )

    def _keep(self, trial: Trial) -> None:
        with self._lock:
            self.trials.append(trial)
            rank = self.goal.rank(trial.found)
            if np.isfinite(rank) and (self.best is None or rank < self.goal.rank(self.best.found)):
                self.best = trial

    def _finish(self) -> None:
        """Run the best trial with rounded numbers, and others if it does not keep the limits."""
        ranks = np.array([self.goal.rank(trial.found) for trial in self.trials])
        final = []
        for index in [each for each in np.argsort(ranks) if np.isfinite(ranks[each])][:_FINALISTS]:
            trial = self.trials[index]
            (found,) = self.runs([self.ranges.scenario(trial.point, 6)])
            if np.isfinite(found).all():
                final.append(trial._replace(found=found))
            if self.goal.violation(found) == 0:
                break
        self.best = min(final, key=lambda trial: self.goal.rank(trial.found), default=None)

    def numbers(self) -> dict[str, float]:
        """Return the best numbers by key."""
        assert self.best is not None
        return self.ranges.values(self.best.point, 6)

    def missed(self) -> list[str]:
        """Return each limit that the best numbers do not keep, with its worst value."""
        assert self.best is not None
        found = []
        for limit, values in zip(self.goal.limits, self.best.found[1:], strict=True):
            worst = values[np.argmax(limit.excess(values))]
            if limit.excess(worst) > 0:
                found.append(f"{limit} is missed by {abs(worst - limit.value):.4g}")
        return found

    def dataset(self, status: str) -> xr.Dataset:
        """Return the course of the search, and the measures before and after."""
        assert self.best is not None
        keys, trials = self.ranges.keys, self.trials
        tried = [list(self.ranges.values(trial.point).values()) for trial in trials]
        ends = [[span.first, span.last] for span in self.ranges.spans.values()]
        limits = self.goal.limits
        rows = [
            ("tried", "trial key", "", np.array(tried), "numbers of each trial"),
            ("found", "trial measure draw", "", np.array([trial.found for trial in trials]), ""),
            ("start", "trial", "", np.array([trial.start for trial in trials]),
             "number of its start, or of its generation"),
            ("given", "key", "", self.ranges.given, ""),
            ("best", "key", "", np.array(list(self.numbers().values())), ""),
            ("range", "key end", "", np.array(ends, float), ""),
            ("before", "measure draw", "", self.given, "measures with the given numbers"),
            ("after", "measure draw", "", self.best.found, "measures with the best numbers"),
            ("limit", "measure", "", np.array([np.nan, *(each.value for each in limits)]), ""),
            ("sign", "measure", "", np.array([0, *(each.sign for each in limits)]),
             "1: to be below the limit; -1: above; 0: to be least"),
        ]  # fmt: skip
        about = {"status": status, "method": self.method, "rest": int(self.rest)}
        return xr.Dataset(
            described(rows),
            {
                "key": list(keys),
                "measure": list(self.goal.names),
                "unit": ("measure", [measure.unit for measure in self.goal.measures]),
                "draw": self.seeds,
            },
            describe(self.scenario) | about,
        )

    @property
    def method(self) -> str:
        """Name of the search."""
        return f"differential evolution ({self.why})" if self.why else "gradients"

    def _stop(self) -> bool:
        self._poll()
        return self._stopped.is_set()

    def _scenario(self, point: Point) -> Scenario | None:
        try:
            return self.ranges.scenario(point)
        except ScenarioError:
            return None
