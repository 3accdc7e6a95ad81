"""Extreme values of independent runs: Gumbel's distribution and its return levels."""

from functools import cache
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

_LEAST = 3  # smallest number of maxima
_SAMPLES = 2000  # samples of the same size that give the intervals


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

    Parameters
    ----------
    maxima
        The largest value of each run; at least 3 that are finite and not all equal.

    Raises
    ------
    ValueError
        If there are fewer.
    """

    def __init__(self, maxima: Float[np.ndarray, " run"]) -> None:
        values = np.asarray(maxima, float)
        if values.size < _LEAST or not np.isfinite(values).all():
            text = f"maxima: got {np.size(maxima)} numbers; must be a list of at least {_LEAST}"
            raise ValueError(f"{text} finite numbers")
        self.count = values.size
        location, scale = _fit(values[None])
        self.location, self.scale = float(location[0]), float(scale[0])
        if self.scale <= 0:
            raise ValueError("maxima: got equal numbers; must differ. Vary the seed.")

    def return_level(self, runs: int = 100, *, confidence: float = 0.95) -> ReturnLevel:
        """Return the value that one of ``runs`` runs exceeds on average, with its interval."""
        if not (runs > 1 and 0 < confidence < 1):
            text = f"got {runs} and {confidence}; must be above 1, and between 0 and 1"
            raise ValueError(f"runs, confidence: {text}")
        numbers = _reduced_level(self.count, runs, confidence)
        return ReturnLevel(*(self.location + self.scale * each for each in numbers))


@cache  # a study has it for each combination and each measure
def _reduced_level(count: int, runs: int, confidence: float) -> tuple[float, float, float]:
    """Return a return level for location 0 and scale 1, and its interval from ``count`` maxima."""
    from scipy import stats  # slow to load; few need it

    level = float(stats.gumbel_r.ppf(1 - 1 / runs))
    generator = np.random.default_rng(0)
    drawn = stats.gumbel_r.rvs(size=(_SAMPLES, count), random_state=generator)
    location, scale = _fit(drawn)
    tail = (1 - confidence) / 2
    low, high = np.quantile((level - location) / scale, [tail, 1 - tail])
    return level, float(low), float(high)


def _fit(
    samples: Float[np.ndarray, "sample run"],
) -> tuple[Float[np.ndarray, " sample"], Float[np.ndarray, " sample"]]:
    """Return location and scale from L-moments."""
    from scipy import stats  # slow to load; few need it

    mean, second = stats.lmoment(samples, order=[1, 2], axis=1)
    scale = second / np.log(2)
    return mean - np.euler_gamma * scale, scale
