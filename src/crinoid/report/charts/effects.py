"""How much of the spread of a measure each key of a study explains."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from crinoid.report.charts.study import Key, Measure, Study

_CLASSES = (4, 48)
"""Least and most classes of equal counts into which numbers are sorted that hardly repeat."""
_OF_A_CLASS = 10
"""Cases of such a class: more make it wide, fewer leave much to chance."""
_PER_LEVEL = 3
"""Cases that a level needs on average, for its mean to be more than one of them."""
_DRAWS = 400
_INTERVAL = (0.025, 0.975)


class Effect(NamedTuple):
    """Share of the variance of a measure that a key explains by itself."""

    key: Key
    share: float
    low: float
    """Ends of the interval of 95 % confidence."""
    high: float


def effects_of(study: Study, measure: Measure) -> list[Effect]:
    """Return the effects of all keys whose levels repeat enough, the largest first.

    The share is the first-order index of Sobol (1993): the variance of the means at the levels over
    that of all cases. Numbers that hardly repeat are sorted into classes, and chance, which tells
    the means of classes apart too, is taken off (epsilon squared, Kelley 1935). The interval is
    that of a bootstrap over the cases.
    """
    known = np.isfinite(measure.values)
    values = measure.values[known]
    if not values.size or np.ptp(values) <= 1e-9 * np.abs(values).max():
        return []
    found = []
    for key in study.varied:
        level, sorted_in = _classes(key)
        classes = level[known]
        if values.size >= _PER_LEVEL * np.unique(classes).size:
            share = _share(values, classes, sorted_in)
            low, high = np.quantile(_bootstrap(values, classes, sorted_in), _INTERVAL)
            found.append(Effect(key, share, min(float(low), share), max(float(high), share)))
    return sorted(found, key=lambda effect: -effect.share)


def _classes(key: Key) -> tuple[Int[np.ndarray, " case"], bool]:
    """Return the level of each case, or its class, and whether it is the latter."""
    classes = int(np.clip(len(key.texts) // _OF_A_CLASS, *_CLASSES))
    few = len(key.texts) < _CLASSES[0] * _OF_A_CLASS
    if key.numbers is None or few or len(key.levels) <= classes:
        return key.level, False
    return key.level * classes // len(key.levels), True


def _share(
    values: Float[np.ndarray, " case"], classes: Int[np.ndarray, " case"], sorted_in: bool
) -> float:
    _, place = np.unique(classes, return_inverse=True)
    count = np.bincount(place)
    centred = values - values.mean()
    between = float(np.sum(np.bincount(place, centred) ** 2 / count))
    total = float(np.sum(centred**2))
    if sorted_in:
        inside = (total - between) / max(values.size - count.size, 1)
        between -= (count.size - 1) * inside
    return float(np.clip(between / total, 0.0, 1.0)) if total else 0.0


def _bootstrap(
    values: Float[np.ndarray, " case"], classes: Int[np.ndarray, " case"], sorted_in: bool
) -> Float[np.ndarray, " draw"]:
    rng = np.random.default_rng(0)  # the same page each time
    drawn = rng.integers(0, values.size, (_DRAWS, values.size))
    return np.array([_share(values[some], classes[some], sorted_in) for some in drawn])
