"""Identification of a scenario's parameters from a recorded motion, by least squares."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import xarray as xr
from jaxtyping import Bool, Float, Int
from scipy.ndimage import maximum_filter, median_filter
from scipy.optimize import least_squares

from crinoid.inverse import StoppedError
from crinoid.inverse.experiment import Experiment, RecordComparison
from crinoid.inverse.recorded_motion import LOST, RecordedMotion
from crinoid.numerics.signals_and_systems import integral_time
from crinoid.results.dataset import describe, described
from crinoid.scenario import Mistake, Scenario, ScenarioError

__all__ = ["Identification"]

_SHARES = (0.125, 0.25, 0.5, 1.0)
"""Shares of the record that the progressive search fits in turn."""
_TRIALS = 30
"""Largest number of trials in each fit."""
_ROUGH, _FINE = 1e-3, 1e-8
"""Relative changes at which a fit of a part of the record has converged, and of the whole."""
_ROUNDS = 4
"""Largest number of fits, each with the scatter of the one before."""
_SETTLED = 0.02
"""Relative change at which the scatter has converged."""
_QUANTILE, _DEVIATIONS = 0.7, 1.0364
"""Quantile that lost markers do not affect, and its number of deviations in a normal law."""
_FAR, _JUMP, _AWAY, _WINDOW = 6.0, 0.005, 0.1, 7
"""Least distance of a lost marker over the scatter; its jump off a running median, and its
distance, over the motion; rows of the running median."""
_LEAST = 1e-12
"""Least scatter, over the size of a coordinate."""
_INSENSITIVE = 1e-6
"""Sensitivity below which a parameter has no effect, over the size of a coordinate."""
_ALIKE = 1e-6
"""Least ratio of singular values at which parameters are distinguishable."""
_NORMAL = 1.959964
"""Half of the 95 % interval of a normal law, over its standard deviation."""

Rows = Int[np.ndarray, " row"]
Vector = Float[np.ndarray, " parameter"]
Matrix = Float[np.ndarray, "parameter parameter"]


class _Fit(NamedTuple):
    logs: Vector
    """Logarithms of the parameters over their initial values."""
    run: RecordComparison
    cost: float
    """Mean square of the residuals over the scatter, limited to that of a lost marker."""


class Identification:
    """Least-squares search for parameters, with its results so far.

    Levenberg-Marquardt steps in a trust region (Moré 1978) on the logarithms of the parameters,
    with derivatives through every time step. One search fits the whole record, another its start
    and then more and more of it, so that it does not confuse one swing with the next; the better
    one counts. Each coordinate is weighted by its scatter about the fit, which is estimated too.

    Both searches limit the weight of outliers (soft L1 loss). Then rows that no motion of the arm
    explains, such as those of a lost marker, are set aside, and the others have equal weights.

    Standard errors are those of the linear model about the result. Autocorrelated scatter, as from
    a model error, has less information: its variance is multiplied by the number of samples in
    twice its integral time.

    The arguments are those of `crinoid.inverse.experiment.Experiment`.
    """

    def __init__(self, scenario: Scenario, keys: Sequence[str], record: RecordedMotion) -> None:
        self.experiment = Experiment(scenario, tuple(keys), record)
        self.trials = 0
        self.failure = ""
        """Why the first run failed; empty if it did not."""
        self.before: _Fit | None = None
        self.found: _Fit | None = None
        """The best fit so far."""
        self.scatter = np.ones(len(record.names))
        """Standard deviation of each coordinate about the fit."""
        self.used = np.ones(self.experiment.time.size, bool)
        """Rows of the record that are not set aside as lost markers."""
        self.notes: list[str] = []
        size = np.median(np.abs(self.experiment.measured), axis=0) + scenario.arm.length
        self._least = _LEAST * size
        self._latest: tuple[bytes, RecordComparison] | None = None

    def run(self, report: Callable[[int, float], None], stop: Callable[[], bool]) -> bool:
        """Search; return whether the search was complete before ``stop`` ended it.

        ``report`` gets the number of trials and the least cost after each trial.
        """
        self._report, self._stop = report, stop
        none = np.zeros(len(self.experiment.keys))
        first = self.experiment.motion(none)
        self.failure = self.experiment.failure(first)
        if self.failure or first is None:
            return True
        within_reach, self.notes = self.experiment.within_reach(first)
        self.used = within_reach
        run = self.experiment.compare(first)
        self.scatter = self._robust_scatter(run)
        self.before = self.found = _Fit(none, run, self._cost(run))
        self._check(run)
        try:
            whole = self._search(none, (1.0,), "soft_l1")
            progressive = self._search(none, _SHARES, "soft_l1")
            best = min(whole, progressive, key=lambda fit: fit.cost)
            for _ in range(_ROUNDS):
                before, earlier = self.used, self.scatter
                self.used = within_reach & self._explained(best.run)
                rms = np.sqrt(np.mean(best.run.residual[self.used] ** 2, axis=0))
                self.scatter = np.maximum(rms, self._least)
                best = self.found = best._replace(cost=self._cost(best.run))
                settled = np.abs(self.scatter / earlier - 1) < _SETTLED
                if settled.all() and np.array_equal(self.used, before):
                    break
                best = self._search(best.logs, (1.0,), "linear")
        except StoppedError:
            return False
        self.found = best
        if (lost := 1 - self.used.mean()) > LOST:
            stuck = self.experiment.stuck(best.run.computed).mean() > LOST / 2
            hint = "A stuck marker rests while the arm moves." if stuck else "Check the markers."
            text = f"got {lost:.0%} of rows that no motion of this arm explains; must be at most"
            raise ScenarioError.of("RECORD", f"{text} {LOST:.0%}. {hint}")
        return True

    def _explained(self, run: RecordComparison) -> Bool[np.ndarray, " time"]:
        """Return the rows without lost markers (F. R. Hampel 1974).

        A lost marker jumps off its neighbours, or is far off. A distance below the path of the tip
        between two rows may be an error in time.
        """
        between = np.abs(np.diff(run.computed, axis=0, prepend=run.computed[:1]))
        between = maximum_filter(between, (3, 1))
        motion, scatter = np.ptp(run.computed, axis=0), _FAR * self._robust_scatter(run)
        jump = run.residual - median_filter(run.residual, (_WINDOW, 1), mode="nearest")
        off = np.abs(run.residual)
        lost = np.minimum(np.abs(jump), off) > np.maximum(scatter, _JUMP * motion) + between
        lost |= off > np.maximum(scatter, _AWAY * motion) + between
        return np.asarray(~lost.any(axis=1) & ~self.experiment.stuck(run.computed))

    def _robust_scatter(self, run: RecordComparison) -> Float[np.ndarray, " quantity"]:
        """Return the scatter of most rows."""
        found = np.quantile(np.abs(run.residual[self.used]), _QUANTILE, axis=0) / _DEVIATIONS
        return np.asarray(np.maximum(found, self._least))

    def _cost(self, run: RecordComparison) -> float:
        squares = (run.residual[self.used] / self.scatter) ** 2
        return float(np.mean(np.minimum(squares, _FAR**2)))

    def _search(self, logs: Vector, shares: Sequence[float], loss: str) -> _Fit:
        """Fit shares of the record in turn."""
        used = np.flatnonzero(self.used)
        for share in shares:
            rows = used[: max(int(np.ceil(share * used.size)), 2 * logs.size)]

            def residual(x: Vector, rows: Rows = rows) -> np.ndarray:
                return np.asarray((self._run(x).residual[rows] / self.scatter).ravel())

            def jacobian(x: Vector, rows: Rows = rows) -> np.ndarray:
                return -(self._run(x).sensitivity[rows] / self.scatter[:, None]).reshape(-1, x.size)

            change = _FINE if share == 1 else _ROUGH
            rules = {"loss": loss, "x_scale": "jac", "max_nfev": _TRIALS}
            logs = least_squares(residual, logs, jacobian, ftol=change, xtol=change, **rules).x
        run = self._run(logs)
        return _Fit(logs, run, self._cost(run))

    def _run(self, logs: Vector) -> RecordComparison:
        """Run the experiment with other parameters, or return the latest run of the same ones."""
        name = logs.tobytes()
        if self._latest is None or self._latest[0] != name:
            if self._stop():
                raise StoppedError
            found = self.experiment.motion(logs)
            failed = bool(self.experiment.failure(found))
            run = self.experiment.compare(None if failed else found)
            self._latest = name, run
            self.trials += 1
            cost = self._cost(run)
            if self.found is None or cost < self.found.cost:
                self.found = _Fit(logs.copy(), run, cost)
            self._report(self.trials, self.found.cost)
        return self._latest[1]

    def _check(self, run: RecordComparison) -> None:
        """Refuse parameters that the record cannot determine."""
        keys, moved = self.experiment.keys, np.ptp(self.experiment.measured, axis=0)
        size = np.where(moved > 0, moved, self.experiment.scenario.arm.length)
        columns = (run.sensitivity / size[:, None]).reshape(-1, len(keys))
        norms = np.abs(columns).max(axis=0)
        idle = [key for key, norm in zip(keys, norms, strict=True) if norm < _INSENSITIVE]
        if idle:
            text = "has no effect on the measured motion. Name another parameter."
            raise ScenarioError([Mistake(key, text) for key in idle])
        _, values, ways = np.linalg.svd(columns / np.linalg.norm(columns, axis=0), False)
        if values[-1] < _ALIKE * values[0]:
            some = sorted(np.argsort(-np.abs(ways[-1]))[:2])
            text = f"cannot be distinguished from {keys[some[0]]} by this record. Name one of them."
            raise ScenarioError.of(keys[some[1]], text)

    @property
    def correlation_time(self) -> Float[np.ndarray, " quantity"]:
        """Integral time of the residual of each coordinate (s)."""
        assert self.found is not None
        interval = float(np.median(np.diff(self.experiment.time)))
        residual = self.found.run.residual[self.used]
        return np.array([integral_time(each, interval) for each in residual.T])

    def covariance(self) -> Matrix:
        """Return the covariance of the logarithms of the parameters; infinite if it is singular."""
        assert self.found is not None
        slope = self.found.run.sensitivity[self.used] / self.scatter[:, None]
        rows, quantities, count = slope.shape
        interval = float(np.median(np.diff(self.experiment.time)))
        longer = np.maximum(1.0, 2 * self.correlation_time / interval)
        # the fitted parameters reduce the degrees of freedom
        free = rows * quantities / max(rows * quantities - count, 1)
        information = np.einsum("tqi,tqj->ij", slope, slope)
        noise = free * np.einsum("q,tqi,tqj->ij", longer, slope, slope)
        try:
            inverse = np.linalg.inv(information)
        except np.linalg.LinAlgError:
            return np.full((count, count), np.inf)
        return np.asarray(inverse @ noise @ inverse)

    def identified(self) -> Scenario:
        """Return the scenario with the identified parameters."""
        assert self.found is not None
        keys, initial = self.experiment.keys, self.experiment.initial
        values = initial * np.exp(self.found.logs)
        return self.experiment.scenario.with_values(
            {key: float(f"{value:.6g}") for key, value in zip(keys, values, strict=True)}
        )

    def dataset(self, status: str) -> xr.Dataset:
        """Return the parameters with their uncertainty, and the fit."""
        assert self.found is not None
        assert self.before is not None
        experiment, covariance = self.experiment, self.covariance()
        deviation = np.sqrt(np.diag(covariance))
        found = experiment.initial * np.exp(self.found.logs)
        limits = found[:, None] * np.exp(_NORMAL * np.outer(deviation, [-1.0, 1.0]))
        limits.sort(axis=1)  # the larger size of a negative number is the lower one
        with np.errstate(invalid="ignore"):
            correlation = covariance / np.outer(deviation, deviation)
        rows = [
            ("given", "parameter", "", experiment.initial, ""),
            ("found", "parameter", "", found, "best fit"),
            ("standard_error", "parameter", "", np.abs(found) * deviation, ""),
            ("lower", "parameter", "", limits[:, 0], "lower end of the 95 % interval"),
            ("upper", "parameter", "", limits[:, 1], "upper end of the 95 % interval"),
            ("correlation", "parameter other", "", correlation, ""),
            ("scatter", "quantity", "", self.scatter, "standard deviation about the fit"),
            ("remembered", "quantity", "s", self.correlation_time, "integral time of the residual"),
            ("measured", "time quantity", "", experiment.measured, ""),
            ("computed", "time quantity", "", self.found.run.computed, ""),
            ("computed_before", "time quantity", "", self.before.run.computed, ""),
            ("set_aside", "time", "", ~self.used, "whether a row counts as a lost marker"),
        ]
        return xr.Dataset(
            described(rows),
            coords={
                "parameter": list(experiment.keys),
                "other": list(experiment.keys),
                "quantity": list(experiment.record.names),
                "time": ("time", experiment.time, {"units": "s"}),
            },
            attrs=describe(experiment.scenario) | {"status": status, "trials": self.trials},
        )
