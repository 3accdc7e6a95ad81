"""A study as data for its page: what varied, what came of it, and how it is seen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from jaxtyping import Float, Int

from crinoid.cases import MEASURES
from crinoid.report.table import Case
from crinoid.report.units import Unit, largest, length_unit

MOST_KEYS = 6
"""Keys over which, and over pairs of which, measures are shown; the table has all."""
_MOST_LEVELS = 60
"""Values of a key that cells are drawn for."""
_WIDE = 20.0
"""Ratio of numbers from which on their axis is logarithmic."""
_LABELS = {
    "rms_error": "RMS error",
    "steady_error": "steady error",
    "rms_error_uncontrolled": "RMS error without control",
    "deflection": "steady error without control",
    "settling_time": "settling time",
}


def spread_far(numbers: Float[np.ndarray, " number"]) -> bool:
    """Tell whether numbers spread so far that their axis is logarithmic."""
    return bool(0 < numbers.min() < numbers.max() / _WIDE)


@dataclass(frozen=True)
class Key:
    """A key of the scenario that was varied."""

    name: str
    texts: list[str]
    """Its value in each case."""
    levels: list[str]
    """Its different values: numbers by size, words in the order of the cases."""
    level: Int[np.ndarray, " case"]
    """Which of them each case has."""
    numbers: Float[np.ndarray, " level"] | None
    """The levels as numbers; None where they are none."""

    @property
    def logarithmic(self) -> bool:
        """Whether its numbers spread so far that their axis is logarithmic."""
        return self.numbers is not None and spread_far(self.numbers)

    @property
    def values(self) -> Float[np.ndarray, " case"]:
        """The number of each case, or which of the levels it has where these are none."""
        return self.level.astype(float) if self.numbers is None else self.numbers[self.level]

    @property
    def repeated(self) -> bool:
        """Whether several cases share a level."""
        return len(self.levels) < len(self.texts)


@dataclass(frozen=True)
class Measure:
    """A number that came of each case."""

    name: str
    label: str
    unit: Unit
    values: Float[np.ndarray, " case"]
    """In SI; NaN where it is not known."""


@dataclass(frozen=True)
class Study:
    """All cases of a study."""

    names: list[str]
    status: list[str]
    keys: list[Key]
    measures: list[Measure]
    """Numbers that are known of any case."""

    @property
    def varied(self) -> list[Key]:
        """Keys with more than one value."""
        return [key for key in self.keys if len(key.levels) > 1]

    def views(self) -> list[tuple[Key, ...]]:
        """Return the keys, and the pairs of keys, over which measures are shown; pairs first."""
        if not self.measures:
            return []
        keys = self.varied[:MOST_KEYS]
        pairs = [pair for pair in combinations(keys, 2) if gridded(pair) or _numbers(pair)]
        return [*pairs, *((key,) for key in keys)]


def gridded(pair: tuple[Key, ...]) -> bool:
    """Tell whether cases fill a grid of two keys, so that it is drawn in cells."""
    one, other = (len(key.levels) for key in pair)
    return max(one, other) <= _MOST_LEVELS and one * other <= 2 * len(pair[0].texts)


def _numbers(pair: tuple[Key, ...]) -> bool:
    return all(key.numbers is not None for key in pair)


def study_of(cases: Sequence[Case]) -> Study:
    """Return the study of some cases."""
    texts = {name: [case.varied[name] for case in cases] for name in cases[0].varied}
    return Study(
        [case.name for case in cases],
        [case.status for case in cases],
        [key_of(name, each) for name, each in texts.items()],
        [
            Measure(name, _LABELS[name], _unit(name, values), values)
            for name in sorted(MEASURES, key=list(_LABELS).index)
            if np.isfinite(values := np.array([case.measures[name] for case in cases])).any()
        ],
    )


def key_of(name: str, texts: list[str]) -> Key:
    """Return a key by its value in each case."""
    levels = list(dict.fromkeys(texts))
    numbers: Float[np.ndarray, " level"] | None
    try:
        numbers = np.array([float(text) for text in levels])
        numbers = numbers if np.isfinite(numbers).all() else None
    except ValueError:
        numbers = None
    if numbers is not None:
        order = np.argsort(numbers, kind="stable")
        levels, numbers = [levels[index] for index in order], numbers[order]
    place = {text: index for index, text in enumerate(levels)}
    return Key(name, texts, levels, np.array([place[text] for text in texts]), numbers)


def _unit(name: str, values: Float[np.ndarray, " case"]) -> Unit:
    return Unit(1.0, "s") if name == "settling_time" else length_unit(largest(values))


@dataclass(frozen=True)
class Means:
    """A measure at each level of a key, or in each cell of two."""

    mean: Float[np.ndarray, " place"]
    low: Float[np.ndarray, " place"]
    """Quantile of 5 %; NaN where fewer than ``QUANTILE_CASES`` cases are known."""
    high: Float[np.ndarray, " place"]


QUANTILE_CASES = 5
_QUANTILES = (0.05, 0.95)


def means_of(
    values: Float[np.ndarray, " case"], place: Int[np.ndarray, " case"], places: int
) -> Means:
    """Return the mean and quantiles of what is known of the cases at each of some places."""
    known = np.isfinite(values)
    count = np.bincount(place[known], minlength=places)
    total = np.bincount(place[known], values[known], minlength=places)
    mean = np.divide(total, count, out=np.full(places, np.nan), where=count > 0)
    low, high = np.full(places, np.nan), np.full(places, np.nan)
    order = np.argsort(place[known], kind="stable")
    sorted_values, ends = values[known][order], np.cumsum(count)
    for index in np.flatnonzero(count >= QUANTILE_CASES):
        some = sorted_values[ends[index] - count[index] : ends[index]]
        low[index], high[index] = np.quantile(some, _QUANTILES)
    return Means(mean, low, high)
