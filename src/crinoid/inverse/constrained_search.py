"""Constrained local search by gradients, which steps back from what cannot be run."""

from collections.abc import Callable
from contextlib import suppress
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.optimize import minimize

_FAILED = 5.0  # value of a failed trial, above the largest one so far
_NEAR = 0.01  # excess of a point that is near enough
_NEAREST_TRIALS = 20  # largest number of trials of `move_inside`
_FAR = 0.2  # distance of a step, in `move_inside`

Point = Float[np.ndarray, " number"]  # numbers from 0 to 1


class SearchTrial(NamedTuple):
    """Result at a point."""

    value: float  # value to minimise; NaN of a point that has none
    gradient: Point
    excess: float | Float[np.ndarray, " limit"]
    """Violation of the limit, or of each; 0 or less where it is kept."""
    excess_gradient: Float[np.ndarray, "*limit number"]


def constrain(
    attempt: Callable[[Point], SearchTrial], begin: Point, step: float, enough: float = 1e-3
) -> None:
    """Minimise the value without excess (SLSQP; Kraft 1988).

    ``attempt`` keeps each trial. The first step is about ``step``: a longer one may lead to what
    cannot be run. The search steps back from trials that failed, and ends where a step changes the
    value by less than ``enough``.
    """
    highest, at, last = -np.inf, b"", SearchTrial(0.0, begin, 0.0, begin)

    def of(steps: Point) -> SearchTrial:
        nonlocal highest, last, at
        if steps.tobytes() != at:
            found, at = attempt(np.clip(step * steps, 0.0, 1.0)), steps.tobytes()
            if np.isfinite(found.value):
                highest = max(highest, found.value)
            else:
                far = highest + _FAILED if np.isfinite(highest) else 0.0
                found = found._replace(value=far, gradient=np.zeros_like(steps))
            last = found
        return last

    limits = {
        "type": "ineq",
        "fun": lambda steps: -of(steps).excess,
        "jac": lambda steps: -step * of(steps).excess_gradient,
    }
    minimize(
        lambda steps: of(steps).value,
        begin / step,
        jac=lambda steps: step * of(steps).gradient,
        method="SLSQP",
        bounds=[(0.0, 1 / step)] * begin.size,
        constraints=limits if np.size(of(begin / step).excess) else (),
        options={"ftol": enough},
    )


def move_inside(excess: Callable[[Point], tuple[float, Point]], begin: Point, step: float) -> Point:
    """Return a near point without excess, or that of least excess among the trials.

    An ``excess`` of 1 and more is that of a point so far from the limit that its distance does not
    count.
    """
    best, looks, scale = (np.inf, begin), 0, _FAR / step

    def attempt(point: Point) -> SearchTrial:
        nonlocal best, looks
        found, away, looks = excess(point), scale * (point - begin), looks + 1
        if found[0] < best[0]:
            best = found[0], point
        if best[0] < _NEAR or looks == _NEAREST_TRIALS:
            raise StopIteration
        distance = 0.5 * float(away @ away) if found[0] < 1 else np.nan
        return SearchTrial(distance, scale * away, *found)

    with suppress(StopIteration):
        constrain(attempt, begin, step)
    return best[1]
