"""The cases of a study: their table, and the effects of what was varied."""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping, Sequence
from itertools import combinations
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from crinoid.foundation.status import Status
from crinoid.results.measure_labels import label_of, unit_of
from crinoid.results.metrics import MEASURES, Measure, measure_columns, read_rows
from crinoid.results.report_error import ReportError
from crinoid.results.result import RESULT
from crinoid.results.units import Unit, largest
from crinoid.scenario.kinds import unit_at
from crinoid.scenario.scenario import scenario_schema
from crinoid.studies.design import SEED

CaseNumbers = Float[np.ndarray, " case"]


class Case(NamedTuple):
    """A case: its name, its varied keys, its measures, and the folder of its result."""

    name: str
    varied: dict[str, str]
    measures: dict[str, float]  # SI; NaN where the table has no value
    status: str
    directory: str
    result: Path | None


def read_cases(path: Path) -> list[Case]:
    """Read the table of a study."""
    try:
        columns, rows = read_rows(path)
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise ReportError(f"{path}: not a readable table ({error})") from error
    names = measure_columns(columns)
    if not names:
        text = "not the table of a study, with case, keys, measures, status, directory as columns"
        raise ReportError(f"{path}: {text}")
    if not rows:
        raise ReportError(f"{path}: the table has no case")
    return [_read_case(path, row, names) for row in rows]


def _read_case(path: Path, row: dict[str, str | None], names: list[str]) -> Case:
    texts = {name: (value or "").strip() for name, value in row.items() if name is not None}
    measures = {}
    for name in names:
        try:
            measures[name] = float(texts[name]) if texts[name] else math.nan
        except ValueError as error:
            text = f"{name} of {texts['case']} is {texts[name]!r}, not a number"
            raise ReportError(f"{path}: {text}") from error
    # The figures of a case are written into its folder, which a table must not choose freely.
    folder = Path(texts["directory"] or texts["case"])
    if folder.is_absolute() or ".." in folder.parts:
        raise ReportError(f"{path}: {str(folder)!r} is not a folder inside the study")
    result = path.parent / folder / RESULT
    varied = {
        name: text
        for name, text in texts.items()
        if name not in (*names, "case", "status", "directory")
    }
    status, found = texts["status"] or Status.OK.value, result if result.is_file() else None
    return Case(texts["case"], varied, measures, status, str(folder), found)


def short_keys(keys: list[str]) -> dict[str, str]:
    """Return the shortest ends of dotted keys that differ from each other."""
    short = {}
    for key in keys:
        parts, others = key.split("."), [other.split(".") for other in keys if other != key]
        taken = 1
        while taken < len(parts) and (
            parts[-taken].isdigit() or any(o[-taken:] == parts[-taken:] for o in others)
        ):
            taken += 1
        short[key] = ".".join(parts[-taken:])
    return short


_CLASSES = (4, 48)
"""Least and largest number of classes of equal counts, of numbers that hardly repeat."""
_OF_A_CLASS = 10  # cases in such a class: more make it wide, fewer are few for a mean
_PER_LEVEL = 3  # cases that a level needs on average, for its mean to be more than one of them
_DRAWS = 200
_INTERVAL = (0.025, 0.975)


class Effect(NamedTuple):
    """Share of the variance of a measure that a key explains by itself."""

    key: Key
    share: float
    low: float  # ends of the interval of 95 % confidence
    high: float


def effects_of(study: Study, measure: StudyMeasure) -> list[Effect]:
    """Return shares of a measure's variance by key with enough cases a level, the largest first.

    The share is the first-order index of Sobol (1993): the variance of the means at the levels over
    that of all cases. Numbers that hardly repeat are sorted into classes, and the part of chance in
    the means of classes is subtracted (epsilon squared, Kelley 1935). The interval is that of a
    bootstrap over the cases.
    """
    known = np.isfinite(measure.values)
    values = measure.values[known]
    if not values.size or np.ptp(values) <= 1e-9 * np.abs(values).max():
        return []
    found = []
    # alone, a seed is a label of random numbers
    for key in study.varied if [key.name for key in study.varied] != [SEED] else ():
        most = int(np.clip(len(key.texts) // _OF_A_CLASS, *_CLASSES))
        few = len(key.texts) < _CLASSES[0] * _OF_A_CLASS
        sorted_in = not (key.numbers is None or few or len(key.levels) <= most)
        level = key.level * most // len(key.levels) if sorted_in else key.level
        classes = level[known]
        if values.size >= _PER_LEVEL * np.unique(classes).size:
            share = _share(values, classes, sorted_in)
            rng = np.random.default_rng(0)  # the same page each time
            drawn = rng.integers(0, values.size, (_DRAWS, values.size))
            shares = [_share(values[some], classes[some], sorted_in) for some in drawn]
            low, high = np.quantile(np.array(shares), _INTERVAL)
            found.append(Effect(key, share, min(float(low), share), max(float(high), share)))
    return sorted(found, key=lambda effect: -effect.share)


def _share(values: CaseNumbers, classes: Int[np.ndarray, " case"], sorted_in: bool) -> float:
    _, place = np.unique(classes, return_inverse=True)
    count = np.bincount(place)
    centred = values - values.mean()
    between = float(np.sum(np.bincount(place, centred) ** 2 / count))
    total = float(np.sum(centred**2))
    if sorted_in:
        inside = (total - between) / max(values.size - count.size, 1)
        between -= (count.size - 1) * inside
    return float(np.clip(between / total, 0.0, 1.0)) if total else 0.0


MOST_KEYS = 6  # keys over which, and over pairs of which, measures are shown; the table has all
_MOST_LEVELS = 60  # values of a key that cells are drawn for
_WIDE = 20.0  # ratio of numbers from which on their axis is logarithmic


class Key(NamedTuple):
    """A key of the scenario that was varied."""

    name: str
    texts: list[str]  # its value in each case
    levels: list[str]  # its different values: numbers by size, words in the order of the cases
    level: Int[np.ndarray, " case"]  # index of the level of each case
    numbers: Float[np.ndarray, " level"] | None  # the levels as numbers; None where they are words

    @property
    def label(self) -> str:
        """Its name, with its unit if it has one."""
        unit = unit_at(scenario_schema(), self.name)
        return f"{self.name} ({unit})" if unit else self.name

    @property
    def logarithmic(self) -> bool:
        """Whether its numbers spread so far that their axis is logarithmic."""
        numbers = self.numbers
        return numbers is not None and bool(0 < numbers.min() < numbers.max() / _WIDE)

    @property
    def values(self) -> Float[np.ndarray, " case"]:
        """The number of each case, or the index of its level where levels are words."""
        return self.level.astype(float) if self.numbers is None else self.numbers[self.level]

    @property
    def repeated(self) -> bool:
        """Whether several cases share a level."""
        return len(self.levels) < len(self.texts)


class StudyMeasure(NamedTuple):
    """A measure of each case."""

    name: str
    label: str
    unit: Unit
    values: Float[np.ndarray, " case"]  # in SI; NaN where it is not known


class Study(NamedTuple):
    """All cases of a study."""

    names: list[str]
    status: list[str]
    keys: list[Key]
    measures: list[StudyMeasure]  # measures that are known of any case

    @property
    def varied(self) -> list[Key]:
        """Keys with more than one value."""
        return [key for key in self.keys if len(key.levels) > 1]

    def views(self) -> list[tuple[Key, ...]]:
        """Return the keys, and the pairs of keys, over which measures are shown; pairs first."""
        if not self.measures:
            return []
        keys = self.varied[:MOST_KEYS]
        pairs = [
            pair
            for pair in combinations(keys, 2)
            if gridded(pair) or all(key.numbers is not None for key in pair)
        ]
        return [*pairs, *((key,) for key in keys)]


def gridded(pair: tuple[Key, ...]) -> bool:
    """Whether cases fill a grid of two keys, which is then drawn in cells."""
    one, other = (len(key.levels) for key in pair)
    return max(one, other) <= _MOST_LEVELS and one * other <= 2 * len(pair[0].texts)


def study_of(cases: Sequence[Case], registry: Mapping[str, Measure] = MEASURES) -> Study:
    """Return the study of some cases, whose measures a registry explains."""
    keys = [key_of(name, [case.varied[name] for case in cases]) for name in cases[0].varied]
    measures = []
    order = {name: place for place, name in enumerate(MEASURES)}
    for name in sorted(cases[0].measures, key=lambda name: order.get(name, len(order))):
        values = np.array([case.measures[name] for case in cases])
        if np.isfinite(values).any():
            about = registry[name].attributes if name in registry else {}
            unit = unit_of(about, largest(values))
            measures.append(StudyMeasure(name, label_of(name), unit, values))
    names, status = [case.name for case in cases], [case.status for case in cases]
    return Study(names, status, keys, measures)


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
