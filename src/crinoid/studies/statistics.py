"""Statistics over seeds: means with intervals, paired differences, extremes."""

import json
import math
from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.special import stdtr, stdtrit

from crinoid.results.extremes import Gumbel, ReturnLevel
from crinoid.results.metrics import Measure
from crinoid.results.units import Unit

MEANS = "means.csv"
SEED = "seed"
_CONFIDENCE = 0.95
RUNS = 100
"""Runs of which one exceeds the estimated extreme, on average."""
_LEAST = 10
"""Smallest number of seeds for extremes."""
_ROUND_OFF = 1e-9
"""Relative difference of values that are equal up to round-off."""


@cache
def student_factor(count: int) -> float:
    """Return the half width of an interval over the standard error of a mean."""
    return float(stdtrit(count - 1, (1 + _CONFIDENCE) / 2))


class Mean(NamedTuple):
    """A mean over seeds, with its interval of 95 % confidence (Student's t)."""

    value: float
    low: float
    """NaN, as the upper end, with fewer than two values."""
    high: float
    seeds: int
    """Number of values."""

    @property
    def half(self) -> float:
        """Half of the width of the interval."""
        return (self.high - self.low) / 2

    def text(self, unit: Unit) -> str:
        """Return it and half the width of its interval, in a unit without its name."""
        if self.seeds == 0:
            return "-"
        half = f" ± {float(f'{self.half * unit.factor:.2g}'):g}" if self.half > 0 else ""
        return f"{unit.number(self.value)}{half}"

    @staticmethod
    def of(values: Float[np.ndarray, " seed"]) -> "Mean":
        """Return the mean of the known values."""
        known = values[np.isfinite(values)]
        if known.size == 0:
            return Mean(np.nan, np.nan, np.nan, 0)
        mean, half = float(known.mean()), np.nan
        if known.size > 1:
            half = student_factor(known.size) * float(known.std(ddof=1)) / known.size**0.5
        return Mean(mean, mean - half, mean + half, known.size)


class Difference(NamedTuple):
    """Mean difference of runs with the same seeds, and its significance (paired t-test)."""

    mean: Mean
    p_value: float
    """NaN with fewer than two pairs, or without any spread."""

    @staticmethod
    def of(one: Float[np.ndarray, " seed"], other: Float[np.ndarray, " seed"]) -> "Difference":
        """Return the difference ``one - other`` over the seeds at which both are known."""
        mean = Mean.of(one - other)
        if not mean.half > 0:
            return Difference(mean, np.nan)
        error = mean.half / student_factor(mean.seeds)
        return Difference(mean, float(2 * stdtr(mean.seeds - 1, -abs(mean.value) / error)))


class SeedMean(NamedTuple):
    """A measure of all runs that differ in their seeds alone."""

    values: dict[str, Any]
    """Values of the keys that vary, without the seed."""
    name: str
    mean: Mean
    extreme: ReturnLevel | None
    """Value that one run in 100 exceeds, of a largest value over at least 10 seeds."""


def seed_means(
    varied: Sequence[Mapping[str, Any]], numbers: Mapping[str, Float[np.ndarray, " run"]]
) -> list[SeedMean]:
    """Return means over the seeds, for each combination of the other keys and each measure.

    Empty where no combination has two seeds and the runs are not all combinations of some values.
    ``varied`` are the values of each run by key, ``numbers`` the measures by name; those that are
    unknown in all runs are left out.
    """
    others = [{key: each for key, each in run.items() if key != SEED} for run in varied]
    groups: dict[str, list[int]] = {}
    for run, values in enumerate(others):
        groups.setdefault(_text(values), []).append(run)
    if max(map(len, groups.values()), default=0) < 2 and not _is_grid(others):
        return []
    known = {name: each for name, each in numbers.items() if np.isfinite(each).any()}
    return [
        SeedMean(others[runs[0]], name, Mean.of(each[runs]), _extreme(name, each[runs]))
        for runs in groups.values()
        for name, each in known.items()
    ]


def _is_grid(runs: Sequence[Mapping[str, Any]]) -> bool:
    """Return whether runs are all combinations of the values of their keys, each once."""
    levels = [{_text(run[key]) for run in runs} for key in runs[0]] if runs else []
    return len(runs) == math.prod(map(len, levels)) > 1


def _text(value: Any) -> str:
    return json.dumps(value, default=str)


def _extreme(name: str, values: Float[np.ndarray, " seed"]) -> ReturnLevel | None:
    known = values[np.isfinite(values)]
    if not name.startswith("max_") or name.endswith("_station") or known.size < _LEAST:
        return None
    alike = np.ptp(known) <= _ROUND_OFF * np.abs(known).max()
    return None if alike else Gumbel(known).return_level(RUNS)


def mean_row(each: SeedMean, measure: Measure) -> dict[str, Any]:
    """Return a row of ``means.csv``, in SI units; unknown numbers are empty."""
    mean, extreme = each.mean, each.extreme or ("", "", "")
    numbers = ("" if np.isnan(value) else value for value in mean[:3])
    row = {**each.values, "measure": each.name, "units": measure.unit, "runs": mean.seeds}
    row |= dict(zip(("mean", "low", "high"), numbers, strict=True))
    return row | dict(zip(("extreme", "extreme_low", "extreme_high"), extreme, strict=True))
