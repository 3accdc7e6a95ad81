"""Goal of an optimisation: a measure to make least, and limits on others."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from difflib import get_close_matches
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from crinoid.results.metrics import Measure, measures_of
from crinoid.scenario import Scenario, got, refusal
from crinoid.scenario.document import value_of

_LIMIT = re.compile(r"\s*(\w+)\s*([<>])\s*(\S+)\s*")
_INSIDE = 1e-4
"""Relative distance from a limit that a search by gradients keeps, for errors of its last step."""
_MARGIN = Measure("1", "margin", "modulus margin that the loop keeps", lambda _: None)
"""Measure of a loop, not of a run (`crinoid.inverse.stability`)."""


Found = Float[np.ndarray, "*draw"] | np.float64  # a measure in some draws, or in one


class Limit(NamedTuple):
    """Limit of a measure."""

    measure: str
    sign: int  # 1: the measure is to be below the value; -1: above
    value: float

    def excess(self, found: Found) -> Found:
        """Return the violation over the size of the value; 0 or less where the limit is kept."""
        return self.sign * (found - self.value) / self.size

    @property
    def size(self) -> float:
        """Size of the value, 1 for a value of 0."""
        return abs(self.value) or 1.0

    def __str__(self) -> str:
        return f"{self.measure}{'<' if self.sign > 0 else '>'}{self.value:g}"


class Goal:
    """A measure to make least, and limits written ``MEASURE<VALUE`` or ``MEASURE>VALUE``.

    The last limit is that of the stability margin, where a ``margin`` is required.

    Raises
    ------
    ScenarioError
        If there is no such measure, or a limit is none.
    """

    def __init__(
        self, scenario: Scenario, measure: str, keep: Sequence[str], margin: float = 0.0
    ) -> None:
        known = measures_of(scenario)
        self.limits = [_read(text) for text in keep]
        for option, name in (("--for", measure), *(("--keep", x.measure) for x in self.limits)):
            if name not in known:
                near = ", ".join(get_close_matches(name, known, 3) or known)
                raise refusal(option, got(name, f"be a measure, such as {near}"))
        self.of_run = (measure, *(limit.measure for limit in self.limits))
        """The measures of a run, in contrast to the margin."""
        runs = [known[name] for name in self.of_run]
        if margin:
            self.limits.append(Limit("margin", -1, margin))
        self.names = (measure, *(limit.measure for limit in self.limits))
        """The measure, and those of the limits."""
        self.measures = [*runs, _MARGIN] if margin else runs

    def violation(self, found: Float[np.ndarray, "*point measure draw"]) -> np.ndarray:
        """Return the largest relative violation of a limit in a draw, 0 where all are kept."""
        excess = [x.excess(found[..., 1 + k, :]) for k, x in enumerate(self.limits)]
        return np.asarray(np.max([0 * found[..., 0, :], *excess], axis=(0, -1)))

    def rank(self, found: Float[np.ndarray, "*point measure draw"]) -> np.ndarray:
        """Return the order of points: any that keeps the limits is before any that does not.

        Ordered are a mean over the draws, or violations.
        """
        mean, violation = found[..., 0, :].mean(axis=-1), self.violation(found)
        # increasing in both, and below 0 only without a violation
        ranked = np.where(violation > 0, 1 + violation, np.arctan(mean) / np.pi - 1)
        return np.where(np.isfinite(found).all(axis=(-2, -1)), ranked, np.inf)

    def excess(
        self, found: Float[np.ndarray, "measure draw"], slopes: Float[np.ndarray, "measure draw k"]
    ) -> tuple[Float[np.ndarray, " limit"], Float[np.ndarray, "limit k"]]:
        """Return the violations in each draw of a run, and their derivatives, for a search."""
        pairs = list(enumerate(self.limits[: len(slopes) - 1], start=1))
        excess = [limit.excess(found[k]) + _INSIDE for k, limit in pairs]
        gradient = [limit.sign / limit.size * slopes[k] for k, limit in pairs]
        keys = slopes.shape[-1]
        return np.array(excess).ravel(), np.array(gradient).reshape(-1, keys)


def _read(text: str) -> Limit:
    parts = _LIMIT.fullmatch(text)
    value: Any = value_of(parts[3]) if parts else None
    if parts is None or type(value) not in (int, float) or not math.isfinite(value):
        must = "be MEASURE<VALUE or MEASURE>VALUE, such as max_error<0.02, in SI units"
        raise refusal("--keep", got(text, must))
    return Limit(parts[1], 1 if parts[2] == "<" else -1, float(value))
