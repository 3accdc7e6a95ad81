"""The search for numbers of a scenario with which its arm moves as one that was recorded."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from jaxtyping import Bool, Float, Int
from scipy.ndimage import maximum_filter, median_filter
from scipy.optimize import least_squares

from crinoid.correlation import integral_time
from crinoid.dataset import describe
from crinoid.identification.experiment import Comparison, Experiment
from crinoid.identification.reach import LOST
from crinoid.identification.record import Record
from crinoid.scenario import Mistake, Scenario, ScenarioError

__all__ = ["Identification"]

_SHARES = (0.125, 0.25, 0.5, 1.0)
"""Shares of the record that one of the searches fits one after the other."""
_TRIALS = 30
"""Largest number of trials in each of them."""
_ROUGH, _FINE = 1e-3, 1e-8
"""Relative changes at which a search of part of the record ends, and one of the whole."""
_ROUNDS = 4
"""Largest number of searches, each with the scatter of the one before."""
_SETTLED = 0.02
"""Relative change of the scatter from which on it is known."""
_MOST, _OF_MOST = 0.7, 1.0364
"""Share of the rows whose scatter lost markers do not move, and in how many deviations it lies."""
_FAR, _JUMP, _AWAY, _WINDOW = 6.0, 0.005, 0.1, 7
"""A lost marker's least distance over the scatter; its jump off a running median of so many rows,
and its distance, over the motion."""
_LEAST = 1e-12
"""Least scatter, over the size of what is measured."""
_UNSEEN = 1e-6
"""Effect on what is measured, over its size, that is none."""
_ALIKE = 1e-6
"""Least singular value, over the largest, of effects that can be told apart."""
_NORMAL = 1.959964
"""Half of an interval that holds 95 % of a normal distribution, over its standard deviation."""

Rows = Int[np.ndarray, " row"]
Vector = Float[np.ndarray, " parameter"]
Matrix = Float[np.ndarray, "parameter parameter"]


class _Fit(NamedTuple):
    logs: Vector
    """Logarithms of the numbers over those that were given."""
    run: Comparison
    cost: float
    """Mean square of the residuals over the scatter; no row counts more than a lost one."""


class Identification:
    """A search for numbers by least squares, and what it has found.

    Levenberg and Marquardt's steps in a trust region (Moré 1978) on the logarithms of the numbers,
    with derivatives through every time step. One search takes the whole record at once, another its
    beginning and then more and more of it, so that a swing is not mistaken for the next one; the
    better of both counts. Each coordinate weighs by its scatter about the fit, found on the way.

    Both make little of what is far off (soft L1 loss). Then rows that no motion of the arm
    explains, as where a marker is lost, are set aside, and the others weigh alike.

    Standard errors are those of the linear model about the result. Scatter that remembers itself,
    as what the model leaves out does, tells less than as many numbers that do not: its variance
    counts as many times as samples pass in twice its integral time.

    Parameters
    ----------
    scenario, keys, record
        As `crinoid.identification.experiment.Experiment` takes them.
    """

    def __init__(self, scenario: Scenario, keys: Sequence[str], record: Record) -> None:
        self.experiment = Experiment(scenario, tuple(keys), record)
        self.trials = 0
        self.failure = ""
        """Why nothing could be run; empty if it could."""
        self.before: _Fit | None = None
        self.found: _Fit | None = None
        """The best so far."""
        self.scatter = np.ones(len(record.names))
        """Standard deviation of each coordinate about the fit."""
        self.kept = np.ones(self.experiment.time.size, bool)
        """Rows of the record that are not set aside as lost markers."""
        self.notes: list[str] = []
        size = np.median(np.abs(self.experiment.measured), axis=0) + scenario.arm.length
        self._least = _LEAST * size
        self._latest: tuple[bytes, Comparison] | None = None

    def run(self, report: Callable[[int, float], None], stop: Callable[[], bool]) -> bool:
        """Search; return whether it came to its end before it was to stop.

        Parameters
        ----------
        report
            Told of each trial: how many there were, and the best cost.
        stop
            Whether to stop.
        """
        self._report, self._stop = report, stop
        none = np.zeros(len(self.experiment.keys))
        first = self.experiment.motion(none)
        self.failure = self.experiment.trouble(first)
        if self.failure or first is None:
            return True
        reached, self.notes = self.experiment.reached(first)
        self.kept = reached
        run = self.experiment.compared(first)
        self.scatter = self._usual(run)
        self.before = self.found = _Fit(none, run, self._cost(run))
        self._check(run)
        try:
            at_once = self._search(none, (1.0,), "soft_l1")
            by_parts = self._search(none, _SHARES, "soft_l1")
            best = min(at_once, by_parts, key=lambda fit: fit.cost)
            for _ in range(_ROUNDS):
                before, earlier = self.kept, self.scatter
                self.kept = reached & self._follows(best.run)
                self.scatter = self._spread(best.run)
                best = self.found = best._replace(cost=self._cost(best.run))
                settled = np.abs(self.scatter / earlier - 1) < _SETTLED
                if settled.all() and np.array_equal(self.kept, before):
                    break
                best = self._search(best.logs, (1.0,), "linear")
        except _StoppedError:
            return False
        self.found = best
        if (lost := 1 - self.kept.mean()) > LOST:
            rests = self.experiment.rests(best.run.computed).mean() > LOST / 2
            hint = "A marker that is stuck rests while the arm moves." if rests else ""
            text = f"got {lost:.0%} of rows that no motion of this arm follows; must be at most"
            text = f"{text} {LOST:.0%}. {hint or 'Check the markers.'}"
            raise ScenarioError([Mistake("RECORD", text)])
        return True

    def _follows(self, run: Comparison) -> Bool[np.ndarray, " time"]:
        """Tell rows that a motion explains from lost markers (F. R. Hampel 1974).

        These jump off their neighbours, or are far off; by less than the tip moves between two
        rows it may be a difference in time.
        """
        between = np.abs(np.diff(run.computed, axis=0, prepend=run.computed[:1]))
        between = maximum_filter(between, (3, 1))
        motion, scatter = np.ptp(run.computed, axis=0), _FAR * self._usual(run)
        jump = run.left - median_filter(run.left, (_WINDOW, 1), mode="nearest")
        off = np.abs(run.left)
        lost = np.minimum(np.abs(jump), off) > np.maximum(scatter, _JUMP * motion) + between
        lost |= off > np.maximum(scatter, _AWAY * motion) + between
        rests = self.experiment.rests(run.computed)
        return np.asarray(~lost.any(axis=1) & ~rests)

    def _usual(self, run: Comparison) -> Float[np.ndarray, " quantity"]:
        """Return the scatter of most rows."""
        found = np.quantile(np.abs(run.left[self.kept]), _MOST, axis=0) / _OF_MOST
        return np.asarray(np.maximum(found, self._least))

    def _spread(self, run: Comparison) -> Float[np.ndarray, " quantity"]:
        found = np.sqrt(np.mean(run.left[self.kept] ** 2, axis=0))
        return np.asarray(np.maximum(found, self._least))

    def _cost(self, run: Comparison) -> float:
        squares = (run.left[self.kept] / self.scatter) ** 2
        return float(np.mean(np.minimum(squares, _FAR**2)))

    def _search(self, logs: Vector, shares: Sequence[float], loss: str) -> _Fit:
        """Fit parts of the record one after the other."""
        kept = np.flatnonzero(self.kept)
        for share in shares:
            rows = kept[: max(int(np.ceil(share * kept.size)), 2 * logs.size)]

            def left(x: Vector, rows: Rows = rows) -> np.ndarray:
                return np.asarray((self._run(x).left[rows] / self.scatter).ravel())

            def slope(x: Vector, rows: Rows = rows) -> np.ndarray:
                return -(self._run(x).slope[rows] / self.scatter[:, None]).reshape(-1, x.size)

            change = _FINE if share == 1 else _ROUGH
            logs = least_squares(
                left,
                logs,
                jac=slope,
                loss=loss,
                x_scale="jac",
                max_nfev=_TRIALS,
                ftol=change,
                xtol=change,
            ).x
        run = self._run(logs)
        return _Fit(logs, run, self._cost(run))

    def _run(self, logs: Vector) -> Comparison:
        """Run the experiment with other numbers, or give again what the latest run gave."""
        name = logs.tobytes()
        if self._latest is None or self._latest[0] != name:
            if self._stop():
                raise _StoppedError
            found = self.experiment.motion(logs)
            failed = bool(self.experiment.trouble(found))
            run = self.experiment.compared(None if failed else found)
            self._latest = name, run
            self.trials += 1
            cost = self._cost(run)
            if self.found is None or cost < self.found.cost:
                self.found = _Fit(logs.copy(), run, cost)
            self._report(self.trials, self.found.cost)
        return self._latest[1]

    def _check(self, run: Comparison) -> None:
        """Refuse numbers that what was measured tells nothing about."""
        keys, effects = self.experiment.keys, run.slope / self._size(run)[:, None]
        columns = effects.reshape(-1, len(keys))
        norms = np.abs(columns).max(axis=0)
        unseen = [key for key, norm in zip(keys, norms, strict=True) if norm < _UNSEEN]
        if unseen:
            text = "has no effect on what was measured, takes a number that has"
            raise ScenarioError([Mistake(key, text) for key in unseen])
        _, values, ways = np.linalg.svd(columns / np.linalg.norm(columns, axis=0), False)
        if values[-1] < _ALIKE * values[0]:
            some = sorted(np.argsort(-np.abs(ways[-1]))[:2])
            text = f"cannot be told from {keys[some[0]]} by this record, takes one of them"
            raise ScenarioError([Mistake(keys[some[1]], text)])

    def _size(self, run: Comparison) -> Float[np.ndarray, " quantity"]:
        """Return how far each coordinate goes in the record; the arm's length at least of one."""
        moved = np.ptp(self.experiment.measured, axis=0)
        return np.where(moved > 0, moved, self.experiment.scenario.arm.length)

    @property
    def remembered(self) -> Float[np.ndarray, " quantity"]:
        """Integral time of what is left of each coordinate (s)."""
        assert self.found is not None
        interval = float(np.median(np.diff(self.experiment.time)))
        left = self.found.run.left[self.kept]
        return np.array([integral_time(each, interval) for each in left.T])

    def covariance(self) -> Matrix:
        """Return the covariance of the logarithms of the numbers; infinite if it is not known."""
        assert self.found is not None
        slope = self.found.run.slope[self.kept] / self.scatter[:, None]
        rows, quantities, count = slope.shape
        interval = float(np.median(np.diff(self.experiment.time)))
        longer = np.maximum(1.0, 2 * self.remembered / interval)
        # each coordinate's scatter, less what the numbers took up of it
        free = rows * quantities / max(rows * quantities - count, 1)
        told = np.einsum("tqi,tqj->ij", slope, slope)
        noise = free * np.einsum("q,tqi,tqj->ij", longer, slope, slope)
        try:
            inverse = np.linalg.inv(told)
        except np.linalg.LinAlgError:
            return np.full((count, count), np.inf)
        return np.asarray(inverse @ noise @ inverse)

    def identified(self) -> Scenario:
        """Return the scenario with the numbers that were found."""
        assert self.found is not None
        keys, given = self.experiment.keys, self.experiment.given
        values = given * np.exp(self.found.logs)
        return self.experiment.scenario.with_values(
            {key: float(f"{value:.6g}") for key, value in zip(keys, values, strict=True)}
        )

    def dataset(self, status: str) -> xr.Dataset:
        """Return what was found, and how it fits."""
        assert self.found is not None
        assert self.before is not None
        experiment, covariance = self.experiment, self.covariance()
        deviation = np.sqrt(np.diag(covariance))
        found = experiment.given * np.exp(self.found.logs)
        limits = found[:, None] * np.exp(_NORMAL * np.outer(deviation, [-1.0, 1.0]))
        limits.sort(axis=1)  # of a negative number the larger size is the lower one
        with np.errstate(invalid="ignore"):
            correlation = covariance / np.outer(deviation, deviation)
        variables: dict[str, Any] = {
            "given": ("parameter", experiment.given),
            "found": ("parameter", found),
            "standard_error": ("parameter", np.abs(found) * deviation),
            "lower": ("parameter", limits[:, 0]),
            "upper": ("parameter", limits[:, 1]),
            "correlation": (("parameter", "other"), correlation),
            "scatter": ("quantity", self.scatter),
            "remembered": ("quantity", self.remembered, {"units": "s"}),
            "measured": (("time", "quantity"), experiment.measured),
            "computed": (("time", "quantity"), self.found.run.computed),
            "computed_before": (("time", "quantity"), self.before.run.computed),
            "set_aside": ("time", ~self.kept),
        }
        about = {
            "found": "what fits best",
            "lower": "lower end of the 95 % interval",
            "upper": "upper end of the 95 % interval",
            "scatter": "standard deviation about the fit",
            "remembered": "integral time of what is left",
            "set_aside": "whether a row counts as a lost marker",
        }
        for name, words in about.items():
            dims, values, *more = variables[name]
            variables[name] = (dims, values, {**(more[0] if more else {}), "long_name": words})
        return xr.Dataset(
            variables,
            coords={
                "parameter": list(experiment.keys),
                "other": list(experiment.keys),
                "quantity": list(experiment.record.names),
                "time": ("time", experiment.time, {"units": "s"}),
            },
            attrs=describe(experiment.scenario) | {"status": status, "trials": self.trials},
        )


class _StoppedError(Exception):
    """The search was asked to stop."""
