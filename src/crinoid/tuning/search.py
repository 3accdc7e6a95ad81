"""How numbers are improved by the slope of what they cost, and of how near the loop comes to -1."""

from collections.abc import Callable
from contextlib import suppress
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize

from crinoid.tuning.design import Logs

_MOST = 7.0
"""Largest change of the logarithm of a number."""
_STEP = 0.2
"""Change of the logarithms by the first step of a search: farther out a loop may be unstable."""
_FAILED = 5.0
"""By how much the logarithm of the cost of what cannot be run is above the largest one."""
_WEIGHT = 10.0
"""Weight of the penalty on a loop that comes too near to -1."""
_ENOUGH = 1e-3
"""Change of the logarithm of the cost that is no improvement any more."""
_LOOKS = 60
"""Times that numbers close by are looked for."""
_NEAR = 0.01
"""Excess from which a search with a constraint may begin."""


class Trial(NamedTuple):
    """Outcome of one set of numbers; slopes are by the logarithms of these."""

    value: float
    """Logarithm of the cost; not a number where it was not run, or could not be."""
    slope: Logs
    excess: float
    """By how much the loop is nearer to -1 than it may be, over that; 1 and more: unstable."""
    excess_slope: Logs

    @property
    def stable(self) -> bool:
        """Whether the closed loop is stable."""
        return self.excess < 1

    @property
    def penalised(self) -> float:
        """The value, with the penalty."""
        return self.value + _WEIGHT * max(self.excess, 0.0) ** 2


Try = Callable[[Logs], Trial]


def descend(attempt: Try, begin: Logs) -> None:
    """Improve the penalised value (L-BFGS-B).

    An unstable loop is worse the faster it grows, as if the tip were a metre away all the time.
    What cannot be run is stepped back from, or ends it where there is nothing to step back to.
    """
    highest = np.nan

    def of(steps: Logs) -> tuple[float, Logs]:
        nonlocal highest
        found = attempt(_STEP * steps)
        if not found.stable:
            value, slope = _WEIGHT * found.excess, _WEIGHT * found.excess_slope
        elif np.isfinite(found.value):
            value = found.penalised
            slope = found.slope + 2 * _WEIGHT * max(found.excess, 0.0) * found.excess_slope
        elif np.isnan(highest):
            raise StopIteration
        else:
            return highest + _FAILED, np.zeros_like(steps)
        highest = np.fmax(highest, value)
        return value, _STEP * slope

    minimize(of, begin / _STEP, jac=True, method="L-BFGS-B", bounds=_bounds(begin))


def constrain(attempt: Try, begin: Logs) -> None:
    """Improve the value where there is no excess (SLSQP; Kraft 1988).

    What is unstable or cannot be run is stepped back from.
    """
    highest, at, last = -np.inf, b"", Trial(0.0, begin, 0.0, begin)

    def of(steps: Logs) -> Trial:
        nonlocal highest, last, at
        if steps.tobytes() != at:
            found, at = attempt(_STEP * steps), steps.tobytes()
            if found.stable and np.isfinite(found.value):
                highest = max(highest, found.value)
            else:
                far = highest + _FAILED if np.isfinite(highest) else 0.0
                found = found._replace(value=far, slope=np.zeros_like(steps))
            last = found
        return last

    minimize(
        lambda steps: of(steps).value,
        begin / _STEP,
        jac=lambda steps: _STEP * of(steps).slope,
        method="SLSQP",
        bounds=_bounds(begin),
        constraints={
            "type": "ineq",
            "fun": lambda steps: -of(steps).excess,
            "jac": lambda steps: -_STEP * of(steps).excess_slope,
        },
        options={"ftol": _ENOUGH},
    )


def nearest(excess: Callable[[Logs], tuple[float, Logs]], begin: Logs) -> Logs:
    """Return numbers close by, in logarithms, that come no nearer to -1 than they may.

    Or those that come least near of all that were looked at.
    """
    best, looks = (np.inf, begin), 0

    def attempt(logs: Logs) -> Trial:
        nonlocal best, looks
        found, away, looks = excess(logs), logs - begin, looks + 1
        if found[0] < best[0]:
            best = found[0], logs.copy()
        if best[0] < _NEAR or looks == _LOOKS:
            raise StopIteration
        return Trial(0.5 * float(away @ away), away, *found)

    with suppress(StopIteration):
        constrain(attempt, begin)
    return best[1]


def _bounds(begin: Logs) -> list[tuple[float, float]]:
    return [(-_MOST / _STEP, _MOST / _STEP)] * len(begin)
