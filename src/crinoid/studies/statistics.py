"""Statistics over seeds: means with intervals, paired differences, extremes."""

import json
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from jaxtyping import Float, Int
from scipy.special import stdtr, stdtrit

from crinoid.results.extremes import Gumbel
from crinoid.results.metrics import Measure
from crinoid.results.units import Unit
from crinoid.studies.design import SEED

MEANS = "means.csv"
_EXTREME = ("extreme", "extreme_low", "extreme_high")
MEAN_COLUMNS = ("measure", "units", "runs", "mean", "low", "high", *_EXTREME)
"""Columns of ``means.csv`` after the keys that vary."""
_CONFIDENCE = 0.95
RUNS = 100  # runs of which one exceeds the estimated extreme, on average
_LEAST = 10  # smallest number of seeds for extremes
_ROUND_OFF = 1e-9  # relative difference of values that are equal up to round-off


@cache
def _student_factor(count: int) -> float:
    """Return the half width of an interval over the standard error of a mean."""
    return float(stdtrit(count - 1, (1 + _CONFIDENCE) / 2)) if count > 1 else math.nan


class Means(NamedTuple):
    """Means at some places, with their intervals of 95 % confidence (Student's t), in SI units."""

    value: Float[np.ndarray, " place"]
    low: Float[np.ndarray, " place"]  # NaN, as the upper end, with fewer than two values
    high: Float[np.ndarray, " place"]
    runs: Int[np.ndarray, " place"]  # number of values

    @property
    def half(self) -> Float[np.ndarray, " place"]:
        """Half of the width of each interval."""
        return (self.high - self.low) / 2

    def texts(self, unit: Unit) -> list[str]:
        """Return each and half the width of its interval, in a unit without its name."""
        halves = (
            f" ± {float(f'{half * unit.factor:.2g}'):g}" if half > 0 else "" for half in self.half
        )
        cells = zip(self.value.tolist(), halves, self.runs, strict=True)
        return [f"{unit.number(mean)}{half}" if runs else "-" for mean, half, runs in cells]


def grouped(
    values: Float[np.ndarray, " run"], place: Int[np.ndarray, " run"], places: int
) -> Iterator[tuple[Int[np.ndarray, " some"], Float[np.ndarray, "some count"]]]:
    """Yield places with as many known values as each other, with a row of values for each."""
    known = np.isfinite(values)
    count = np.bincount(place[known], minlength=places)
    ordered = values[known][np.argsort(place[known], kind="stable")]
    first = np.cumsum(count) - count
    for size in np.unique(count[count > 0]):
        some = np.flatnonzero(count == size)
        yield some, ordered[first[some, None] + np.arange(size)]


def means_of(
    values: Float[np.ndarray, " run"], place: Int[np.ndarray, " run"], places: int
) -> Means:
    """Return the means of the known values at each place."""
    mean, half = np.full((2, places), np.nan)
    runs = np.zeros(places, np.int64)
    for some, rows in grouped(values, place, places):
        size = rows.shape[1]
        mean[some], runs[some] = rows.mean(axis=1), size
        if size > 1:
            half[some] = _student_factor(size) * rows.std(axis=1, ddof=1) / size**0.5
    return Means(mean, mean - half, mean + half, runs)


def row_means(rows: Float[np.ndarray, "place seed"]) -> Means:
    """Return the mean of the known values of each row."""
    places, seeds = rows.shape
    return means_of(rows.ravel(), np.repeat(np.arange(places), seeds), places)


def differences(
    rows: Float[np.ndarray, "place seed"], other: Float[np.ndarray, " seed"]
) -> tuple[Means, Float[np.ndarray, " place"]]:
    """Return mean differences ``rows - other`` over the same seeds, and p values (paired t-test).

    A p value is NaN with fewer than two pairs, or without any spread.
    """
    means = row_means(rows - other)
    factor = np.array([_student_factor(runs) for runs in means.runs.tolist()])
    error = np.where(means.half > 0, means.half, np.nan) / factor
    return means, 2 * stdtr(means.runs - 1, -abs(means.value) / error)


def seed_means(
    varied: Iterable[Mapping[str, Any]],
    numbers: Mapping[str, Float[np.ndarray, " run"]],
    registry: Mapping[str, Measure],
) -> pd.DataFrame:
    """Return means over the seeds, for each combination of the other keys and each measure.

    Columns are those of ``means.csv``, in SI units; the index numbers the combinations. Empty where
    no combination has two seeds and the runs are not all combinations of some values. ``varied``
    are the values of each run by key, ``numbers`` the measures by name; those that are unknown in
    all runs are left out.
    """
    others = [{key: each for key, each in run.items() if key != SEED} for run in varied]
    place, groups = pd.factorize(np.array([_text(values) for values in others], object))
    if len(groups) == len(others) and not _is_grid(others):
        return pd.DataFrame()
    firsts = [others[run] for run in np.unique(place, return_index=True)[1]]
    known = {name: each for name, each in numbers.items() if np.isfinite(each).any()}
    tables = [
        _mean_table(name, values, place, len(groups), registry[name].unit)
        for name, values in known.items()
    ]
    return pd.DataFrame(firsts, dtype=object).join(pd.concat(tables)) if tables else pd.DataFrame()


def records(table: pd.DataFrame) -> list[dict[str, Any]]:
    """Return the rows of a table for a file; unknown numbers are None."""
    return table.astype(object).where(table.notna(), None).to_dict("records")


def _mean_table(
    name: str,
    values: Float[np.ndarray, " run"],
    place: Int[np.ndarray, " run"],
    places: int,
    unit: str,
) -> pd.DataFrame:
    means = means_of(values, place, places)
    extremes = np.full((places, 3), np.nan)
    if name.startswith("max_") and not name.endswith(("_station", "_time")):
        for some, rows in grouped(values, place, places):
            extremes[some] = [_extreme(row) for row in rows]
    columns = (name, unit, means.runs, *means[:3], *extremes.T)
    return pd.DataFrame(dict(zip(MEAN_COLUMNS, columns, strict=True)))


def _is_grid(runs: Sequence[Mapping[str, Any]]) -> bool:
    """Return whether runs are all combinations of the values of their keys, each once."""
    levels = [{_text(run[key]) for run in runs} for key in runs[0]] if runs else []
    return len(runs) == math.prod(map(len, levels)) > 1


def _text(value: Any) -> str:
    return json.dumps(value, default=str)


def _extreme(known: Float[np.ndarray, " seed"]) -> Sequence[float]:
    """Return the value that one run in 100 exceeds; NaN of few seeds, or without any spread."""
    few = known.size < _LEAST or np.ptp(known) <= _ROUND_OFF * np.abs(known).max()
    return (math.nan,) * 3 if few else Gumbel(known).return_level(RUNS)
