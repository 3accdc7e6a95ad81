"""Extreme values of independent runs: Gumbel's distribution and its return levels."""

from functools import cache
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

_LEAST = 3  # smallest number of maxima
_SAMPLES = 2000  # samples of the same size that give the intervals
_EQUAL = 1e-9  # scale over location of maxima that are equal up to round-off
_HALVINGS, _LOWEST = 60, -700.0  # of a range; a reduced value below which exponentials overflow


class ReturnLevel(NamedTuple):
    """Value that one run in a number of runs exceeds on average, with its confidence interval."""

    value: float
    low: float
    high: float


class Gumbel:
    """Gumbel distribution of the largest values of independent runs of equal length.

    Its location and scale follow from the first two L-moments (Hosking 1990). Over its scale, the
    error of a return level has a distribution that depends on the number of runs alone; simulated
    samples give it. So the intervals hold for few runs as well.

    Over several conditions with shares of time ``p_i``, the largest value of a run has the
    distribution ``F = sum p_i F_i`` (DNV-RP-C205; Mackay and Johanning, Ocean Eng. 165 (2018)
    164-177), with Gumbel's ``F_i``. Runs of all conditions have the same seeds, so that one sample
    counts for all of them.

    Parameters
    ----------
    maxima
        The largest value of each run, a list for each condition; at least 3 in each that are finite
        and in one of the conditions not all equal.
    shares
        Share of time of each condition; they add up to 1. Equal ones by default.

    Raises
    ------
    ValueError
        If there are fewer.
    """

    def __init__(
        self,
        *maxima: Float[np.ndarray, " _"],
        shares: Float[np.ndarray, " condition"] | None = None,
    ) -> None:
        values = [np.asarray(each, float) for each in maxima]
        self.count = min(each.size for each in values)
        if self.count < _LEAST or not all(np.isfinite(each).all() for each in values):
            text = f"maxima: got {self.count} numbers; must be a list of at least {_LEAST}"
            raise ValueError(f"{text} finite numbers")
        self.shares = np.full(len(values), 1 / len(values)) if shares is None else shares
        self.location, scale = np.concatenate([_fit(each[None]) for each in values], axis=1)
        least = _EQUAL * np.abs(self.location).max()
        if scale.max() <= least:
            raise ValueError("maxima: got equal numbers; must differ. Vary the seed.")
        self.scale = np.maximum(scale, least)

    def return_level(self, runs: int | float = 100, *, confidence: float = 0.95) -> ReturnLevel:
        """Return the value that one of ``runs`` runs exceeds on average, with its interval."""
        if not (runs > 1 and 0 < confidence < 1):
            text = f"got {runs} and {confidence}; must be above 1, and between 0 and 1"
            raise ValueError(f"runs, confidence: {text}")
        drawn, spread = (each[:, None] for each in _reduced(self.count))
        location, scale = self.location - self.scale * drawn / spread, self.scale / spread
        ends = location - scale * np.log(-np.log1p(-1 / runs))  # of each condition by itself
        low, high = ends.min(axis=1), ends.max(axis=1)
        for _ in range(_HALVINGS if self.scale.size > 1 else 0):
            middle = (low + high) / 2
            reduced = np.maximum((middle[:, None] - location) / scale, _LOWEST)
            above = -np.expm1(-np.exp(-reduced)) @ self.shares > 1 / runs
            low, high = np.where(above, middle, low), np.where(above, high, middle)
        tail = (1 - confidence) / 2
        return ReturnLevel(*map(float, (high[0], *np.quantile(high[1:], [tail, 1 - tail]))))


@cache  # a study has it for each combination and each measure
def _reduced(count: int) -> tuple[Float[np.ndarray, " sample"], Float[np.ndarray, " sample"]]:
    """Return 0 and 1, and locations and scales of samples of ``count`` maxima drawn with these."""
    from scipy import stats  # slow to load; few need it

    generator = np.random.default_rng(0)
    location, scale = _fit(stats.gumbel_r.rvs(size=(_SAMPLES, count), random_state=generator))
    return np.append(0.0, location), np.append(1.0, scale)


def _fit(
    samples: Float[np.ndarray, "sample run"],
) -> tuple[Float[np.ndarray, " sample"], Float[np.ndarray, " sample"]]:
    """Return location and scale from L-moments."""
    from scipy import stats  # slow to load; few need it

    mean, second = stats.lmoment(samples, order=[1, 2], axis=1)
    scale = second / np.log(2)
    return mean - np.euler_gamma * scale, scale
