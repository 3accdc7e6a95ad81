"""A current that wanders about its mean."""

from itertools import accumulate

import numpy as np
from jaxtyping import Float

from crinoid.flow.flow import Everywhere, Point, Time, panels_of
from crinoid.onset import Onset
from crinoid.spline import PiecewisePolynomial

POINTS_PER_CORRELATION_TIME = 20
"""How finely the process is drawn: the spline through the points keeps 99.6 % of its variance."""
_MARGIN = 40
"""Points before and after the record, so that the ends of the spline are not felt within it."""


class GaussMarkov(Everywhere):
    """The same everywhere; in time a Gauss-Markov (Ornstein-Uhlenbeck) process for each axis.

    Its correlation falls as ``exp(-|lag| / correlation_time)``. The process itself has no
    acceleration anywhere; it is drawn exactly at points in time of its own, whatever the time
    step, and a cubic spline joins them.
    """

    onset: Onset
    record: PiecewisePolynomial
    """Velocity (m/s) over time (s)."""

    @staticmethod
    def of(
        onset: Onset,
        *,
        mean: Float[np.ndarray, " b"],
        standard_deviation: Float[np.ndarray, ""] | Float[np.ndarray, " b"],
        correlation_time: float,
        duration: float,
        generator: np.random.Generator,
    ) -> "GaussMarkov":
        """Draw a record from t = 0 to ``duration`` (s), past which the velocity stays.

        ``mean`` (m/s) has an entry for each axis, ``standard_deviation`` (m/s) too or one for
        all of them. A longer record of the same generator begins with the shorter one, and a
        spatial one has along x and z what the planar one has.
        """
        from scipy.interpolate import CubicSpline  # slow to load, and few scenarios need it

        step = correlation_time / POINTS_PER_CORRELATION_TIME
        points = np.arange(-_MARGIN, np.ceil(duration / step) + _MARGIN + 1)
        normal = generator.standard_normal((points.size, 2))
        if mean.size == 3:
            aside = generator.spawn(1)[0].standard_normal(points.size)
            normal = np.insert(normal, 1, aside, axis=1)
        # exact for any step: V <- a V + sqrt(1 - a^2) xi, a = exp(-step / T) (Gillespie 1996),
        # from the distribution in which it stays
        kept = np.exp(-step / correlation_time)
        drawn = np.sqrt(1 - kept**2) * normal
        drawn[0] = normal[0]
        wandering = np.array(list(accumulate(drawn, lambda value, new: kept * value + new)))
        velocity = mean + standard_deviation * wandering
        record = PiecewisePolynomial(CubicSpline(step * points, velocity))
        return GaussMarkov(onset, record, panels=panels_of(float(onset.ramp_time), 4 * step))

    def at(self, time: Time) -> Point:
        return self.record(time)

    def path(self, time: Time) -> Point:
        return self.record.integral(time)
