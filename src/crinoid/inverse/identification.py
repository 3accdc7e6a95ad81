"""Identification of a scenario's parameters from recorded experiments, by least squares."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import xarray as xr
from jaxtyping import Float
from scipy.linalg import block_diag
from scipy.optimize import least_squares

from crinoid.foundation.axes import AXES
from crinoid.inverse import StoppedError
from crinoid.inverse.experiment import Experiment, RecordComparison
from crinoid.inverse.experiment_record import ExperimentRecord
from crinoid.inverse.unknowns import Unknowns, Vector
from crinoid.inverse.weights import RecordWeights
from crinoid.results.dataset import describe, described
from crinoid.scenario import Mistake, Scenario, ScenarioError, refusal

_SHARES = (0.125, 0.25, 0.5, 1.0)  # shares of the record that the progressive search fits in turn
_TRIALS = 30  # largest number of trials in each fit
_ROUGH, _FINE = 1e-3, 1e-8
"""Relative changes at which a fit of a part of the record has converged, and of the whole."""
_ROUNDS = 4  # largest number of fits, each with the scatter of the one before
_FARTHEST, _NEARLY = np.log(1e4), 0.99
"""Largest logarithm of a number over its given value, and the share of it which counts as the end;
a number that may as well be 0 ends there."""
_INSENSITIVE = 1e-6
"""Sensitivity below which a parameter has no effect, over the size of a coordinate."""
_ALIKE = 1e-6  # least ratio of singular values at which parameters are distinguishable
_NORMAL = 1.959964  # half of the 95 % interval of a normal law, over its standard deviation

Runs = list[RecordComparison]


class _Fit(NamedTuple):
    logs: Vector  # logarithms of the parameters over their initial values
    runs: Runs  # comparison of each experiment with its record
    cost: float  # mean square of the residuals over the scatter, limited to that of a lost marker


class Identification:
    """Least-squares search for parameters, with its results so far.

    Levenberg-Marquardt steps in a trust region (Moré 1978) on the logarithms of the parameters,
    with derivatives through every time step and every equilibrium. One search fits the whole
    records, another the start of motions and then more and more of them, so that it does not
    confuse one swing with the next; the better one counts.

    Both searches limit the weight of outliers (soft L1 loss). Then rows that no motion of the arm
    explains are set aside (`crinoid.inverse.weights.RecordWeights`), and the others have equal
    weights.

    Standard errors are those of the linear model about the result. Autocorrelated scatter, as from
    a model error, has less information: its variance is multiplied by the number of samples in
    twice its integral time.

    The arguments are the scenario with the initial parameters, their keys as
    `crinoid.inverse.unknowns.Unknowns` reads them, and the record of each experiment.
    """

    def __init__(
        self, scenario: Scenario, keys: Sequence[str], records: Sequence[ExperimentRecord]
    ) -> None:
        self.scenario, self.unknowns = scenario, Unknowns(scenario, keys)
        self.experiments = [
            Experiment(scenario.with_values(record.settings), self.unknowns, record)
            for record in records
        ]
        count = sum(each.measured.size for each in self.experiments)
        if count <= len(keys):
            must = f"be more than {len(keys)}, the numbers to find"
            raise refusal("RECORD", f"got {count} measured numbers within the run", must)
        effects = sum(each.effects for each in self.experiments)
        idle = [key for key, size in zip(keys, effects, strict=True) if size == 0]
        if idle:
            text = "does not affect the motion. Name a parameter of arm, water or actuators."
            raise ScenarioError([Mistake(key, text) for key in idle])
        self.trials = 0
        self.total = (1 + len(_SHARES) + _ROUNDS) * _TRIALS  # largest number of trials
        self.failure = ""  # why the first run failed; empty if it did not
        self.before: _Fit | None = None
        self.found: _Fit | None = None  # the best fit so far
        self.weights: list[RecordWeights] = []  # weights of each record
        self._latest: tuple[bytes, Runs] | None = None

    @property
    def notes(self) -> list[str]:
        """Notes on the records, a sentence each."""
        return [note for each in self.weights for note in each.notes]

    def run(self, report: Callable[[int, float], None], stop: Callable[[], bool]) -> bool:
        """Search; return whether the search was complete before ``stop`` ended it.

        ``report`` gets the number of trials and the least cost after each trial.
        """
        self._report, self._stop = report, stop
        none = np.zeros(len(self.unknowns.keys))
        runs = []
        for experiment in self.experiments:
            first = experiment.motion(none)
            self.failure = experiment.failure(first)
            if self.failure or first is None:
                return True
            self.weights.append(RecordWeights(experiment, first))
            runs.append(experiment.compare(first))
        self.before = self.found = _Fit(none, runs, self._cost(runs))
        self._latest, self.trials = (none.tobytes(), runs), 1
        report(1, self.found.cost)
        self._check(runs)
        moves = any(each.record.holds is None for each in self.experiments)
        try:
            fits = [self._search(none, (1.0,), "soft_l1")]
            if moves:
                fits.append(self._search(none, _SHARES, "soft_l1"))
            best = min(fits, key=lambda fit: fit.cost)
            for _ in range(_ROUNDS):
                settled = [w.update(run) for w, run in zip(self.weights, best.runs, strict=True)]
                best = self.found = best._replace(cost=self._cost(best.runs))
                if all(settled):
                    break
                best = self._search(best.logs, (1.0,), "linear")
        except StoppedError:
            return False
        self.found = best
        for each, run in zip(self.weights, best.runs, strict=True):
            each.require_used(run)
        return True

    def _cost(self, runs: Runs) -> float:
        pairs = zip(self.weights, runs, strict=True)
        return float(np.mean(np.concatenate([w.squares(run).ravel() for w, run in pairs])))

    def _search(self, logs: Vector, shares: Sequence[float], loss: str) -> _Fit:
        """Fit shares of the records in turn."""
        for share in shares:
            rows = [each.first_rows(share, 2 * logs.size) for each in self.weights]

            def residual(x: Vector, rows: list[np.ndarray] = rows) -> np.ndarray:
                parts = zip(self.weights, self._run(x), rows, strict=True)
                return np.concatenate([(r.residual[k] / w.scatter).ravel() for w, r, k in parts])

            def jacobian(x: Vector, rows: list[np.ndarray] = rows) -> np.ndarray:
                parts = zip(self.weights, self._run(x), rows, strict=True)
                slopes = [r.sensitivity[k] / w.scatter[:, None] for w, r, k in parts]
                return -np.concatenate([slope.reshape(-1, x.size) for slope in slopes])

            change = _FINE if share == 1 else _ROUGH
            bounds = (-_FARTHEST, _FARTHEST)
            rules = {"loss": loss, "x_scale": "jac", "max_nfev": _TRIALS, "bounds": bounds}
            logs = least_squares(residual, logs, jacobian, ftol=change, xtol=change, **rules).x
        runs = self._run(logs)
        return _Fit(logs, runs, self._cost(runs))

    def _run(self, logs: Vector) -> Runs:
        """Run the experiments with other parameters, or return the latest runs of the same ones."""
        name = logs.tobytes()
        if self._latest is None or self._latest[0] != name:
            if self._stop():
                raise StoppedError
            motions = [each.motion(logs) for each in self.experiments]
            pairs = list(zip(self.experiments, motions, strict=True))
            failed = any(each.failure(found) for each, found in pairs)
            runs = [each.compare(None if failed else found) for each, found in pairs]
            self._latest = name, runs
            self.trials += 1
            cost = self._cost(runs)
            if self.found is None or cost < self.found.cost:
                self.found = _Fit(logs.copy(), runs, cost)
            self._report(self.trials, self.found.cost)
        return self._latest[1]

    def _check(self, runs: Runs) -> None:
        """Refuse parameters that the records cannot determine."""
        keys, parts = self.unknowns.keys, []
        for experiment, run in zip(self.experiments, runs, strict=True):
            moved = np.ptp(experiment.measured, axis=0)
            size = np.where(moved > 0, moved, experiment.scenario.arm.length)
            parts.append((run.sensitivity / size[:, None]).reshape(-1, len(keys)))
        columns = np.concatenate(parts)
        norms = np.abs(columns).max(axis=0)
        idle = [key for key, norm in zip(keys, norms, strict=True) if norm < _INSENSITIVE]
        if idle:
            text = "has no effect on the measured motion. Name another parameter."
            raise ScenarioError([Mistake(key, text) for key in idle])
        _, values, ways = np.linalg.svd(columns / np.linalg.norm(columns, axis=0), False)
        if values[-1] < _ALIKE * values[0]:
            some = sorted(np.argsort(-np.abs(ways[-1]))[:2])
            text = f"cannot be distinguished from {keys[some[0]]} by this record. Name one of them."
            raise refusal(keys[some[1]], text)

    @property
    def correlation(self) -> Float[np.ndarray, "2 quantity"]:
        """Integral time of the residual of each coordinate of each record (s), and its variance.

        `crinoid.inverse.weights.RecordWeights.correlation` defines both.
        """
        assert self.found is not None
        pairs = zip(self.weights, self.found.runs, strict=True)
        return np.concatenate([each.correlation(run) for each, run in pairs], axis=1)

    def covariance(self) -> Float[np.ndarray, "parameter parameter"]:
        """Return the covariance of the logarithms of the parameters; infinite if it is singular."""
        assert self.found is not None
        count = len(self.unknowns.keys)
        information, noise, numbers = np.zeros((count, count)), np.zeros((count, count)), 0
        for each, run in zip(self.weights, self.found.runs, strict=True):
            slope = run.sensitivity[each.used] / each.scatter[:, None]
            information += np.einsum("tqi,tqj->ij", slope, slope)
            noise += np.einsum("q,tqi,tqj->ij", each.correlation(run)[1], slope, slope)
            numbers += slope.shape[0] * slope.shape[1]
        # a number near 0 has a small slope by its logarithm
        size = np.sqrt(np.diag(information))
        if not (size > 0).all():
            return np.full((count, count), np.inf)
        try:
            inverse = np.linalg.inv(information / np.outer(size, size)) / np.outer(size, size)
        except np.linalg.LinAlgError:
            return np.full((count, count), np.inf)
        # the fitted parameters reduce the degrees of freedom
        free = numbers / max(numbers - count, 1)
        return np.asarray(free * inverse @ noise @ inverse)

    def undetermined(self) -> dict[str, str]:
        """Return why the records do not determine some of the parameters, by key."""
        assert self.found is not None
        why = {}
        for key, log, variance in zip(
            self.unknowns.keys, self.found.logs, np.diag(self.covariance()), strict=True
        ):
            if abs(log) > _NEARLY * _FARTHEST:
                why[key] = f"its search ends at {np.exp(log):.2g} times the given value"
            elif not variance <= 1:
                why[key] = "its standard error exceeds it"
        return why

    def identified(self) -> Scenario:
        """Return the scenario with the identified parameters."""
        return self.scenario.with_values(self.numbers())

    def numbers(self) -> dict[str, float]:
        """Return the identified parameters by key."""
        assert self.found is not None
        values = self.unknowns.values(self.found.logs)
        return {key: float(f"{value:.6g}") for key, value in values.items()}

    def dataset(self, status: str) -> xr.Dataset:
        """Return the parameters with their uncertainty, and the fit."""
        assert self.found is not None
        assert self.before is not None
        experiments, covariance = self.experiments, self.covariance()
        scatter = np.concatenate([each.scatter for each in self.weights])
        aside = np.concatenate([~each.used for each in self.weights])
        deviation = np.sqrt(np.diag(covariance))
        given, found = self.unknowns.given, self.unknowns.given * np.exp(self.found.logs)
        error = np.abs(found) * deviation
        limits = found[:, None] + _NORMAL * np.outer(error, [-1.0, 1.0])
        limits = np.where(limits * found[:, None] > 0, limits, 0.0)  # a number keeps its sign
        determined = [key not in self.undetermined() for key in self.unknowns.keys]
        with np.errstate(invalid="ignore"):
            correlation = covariance / np.outer(deviation, deviation)
        measured = _table([each.measured for each in experiments])
        runs = (self.before.runs, self.found.runs)
        before, computed = (_table([run.computed for run in each]) for each in runs)
        rows = [
            ("given", "parameter", "", given, ""),
            ("found", "parameter", "", found, "best fit"),
            ("standard_error", "parameter", "", error, ""),
            ("lower", "parameter", "", limits[:, 0], "lower end of the 95 % interval"),
            ("upper", "parameter", "", limits[:, 1], "upper end of the 95 % interval"),
            ("determined", "parameter", "", determined, "whether the records determine it"),
            ("correlation", "parameter other", "", correlation, ""),
            ("scatter", "quantity", "", scatter, "standard deviation about the fit"),
            ("remembered", "quantity", "s", self.correlation[0], "integral time of the residual"),
            ("measured", "time quantity", "", measured, ""),
            ("computed", "time quantity", "", computed, ""),
            ("computed_before", "time quantity", "", before, ""),
            ("set_aside", "time", "", aside, "whether a row counts as a lost marker"),
        ]
        return xr.Dataset(
            described(rows),
            coords={
                "parameter": list(self.unknowns.keys),
                "other": list(self.unknowns.keys),
                "quantity": [name for each in experiments for name in each.quantities],
                "time": ("time", np.concatenate([e.time for e in experiments]), {"units": "s"}),
                "marker": ("time", [label for each in experiments for label in each.labels]),
                "hold": ("time", [hold for each in experiments for hold in each.holds]),
            },
            attrs=describe(self.scenario) | {"status": status, "trials": self.trials},
        )


def _table(parts: list[np.ndarray]) -> Float[np.ndarray, "time quantity"]:
    """Return a row for each row of all records, not a number in the columns of the others."""
    there = block_diag(*map(np.ones_like, parts))
    return np.where(there, block_diag(*parts), np.nan)


def marker_errors(data: xr.Dataset, name: str = "computed") -> dict[str, float]:
    """Return the RMS distance of each marker from its place in a fit (m); empty without places.

    Rows that are set aside do not count.
    """
    places = [str(each).rpartition(".")[2] in AXES[3] for each in data["quantity"].values]
    if not any(places):
        return {}
    apart = (data["measured"] - data[name]).values[:, places]
    squares, used = np.nansum(apart**2, axis=1), ~data["set_aside"].values
    marker = data["marker"].values
    return {
        str(each): float(np.sqrt(np.mean(squares[used & (marker == each)])))
        for each in dict.fromkeys(marker[used])
    }
