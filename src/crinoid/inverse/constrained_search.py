"""Constrained local search by gradients, which steps back from what cannot be run."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.optimize import minimize

STEP = 0.2
"""Initial step of the numbers: a longer one may lead to what cannot be run."""
FAILED = 5.0
"""Value of a failed trial, above the largest one so far."""

Numbers = Float[np.ndarray, " number"]


class SearchTrial(NamedTuple):
    """Result for one set of numbers."""

    value: float
    """Value to minimise; NaN of numbers that have none."""
    gradient: Numbers
    excess: float | Float[np.ndarray, " limit"]
    """Violation of the limit, or of each; 0 or less where it is kept."""
    excess_gradient: Float[np.ndarray, "*limit number"]


def constrain(
    attempt: Callable[[Numbers], SearchTrial],
    begin: Numbers,
    bounds: Sequence[tuple[float, float]],
    enough: float = 1e-3,
) -> None:
    """Minimise the value without excess (SLSQP; Kraft 1988).

    ``attempt`` keeps each trial; the search steps back from those that failed, and ends where a
    step changes the value by less than ``enough``.
    """
    highest, at, last = -np.inf, b"", SearchTrial(0.0, begin, 0.0, begin)

    def of(steps: Numbers) -> SearchTrial:
        nonlocal highest, last, at
        if steps.tobytes() != at:
            found, at = attempt(STEP * steps), steps.tobytes()
            if np.isfinite(found.value):
                highest = max(highest, found.value)
            else:
                far = highest + FAILED if np.isfinite(highest) else 0.0
                found = found._replace(value=far, gradient=np.zeros_like(steps))
            last = found
        return last

    limits = {
        "type": "ineq",
        "fun": lambda steps: -of(steps).excess,
        "jac": lambda steps: -STEP * of(steps).excess_gradient,
    }
    minimize(
        lambda steps: of(steps).value,
        begin / STEP,
        jac=lambda steps: STEP * of(steps).gradient,
        method="SLSQP",
        bounds=np.array(bounds) / STEP,
        constraints=limits if np.size(of(begin / STEP).excess) else (),
        options={"ftol": enough},
    )
