"""Weights of the rows of a record in a fit: scatter of coordinates, and lost markers."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.ndimage import maximum_filter, median_filter

from crinoid.inverse.experiment import Experiment, RecordComparison
from crinoid.inverse.experiment_record import LOST
from crinoid.inverse.motion import ArmMotion
from crinoid.numerics.signals_and_systems import integral_time
from crinoid.scenario import refusal

_QUANTILE, _DEVIATIONS = 0.7, 1.0364
"""Quantile that lost markers do not affect, and its number of deviations in a normal law."""
_FAR, _JUMP, _AWAY, _WINDOW = 6.0, 0.005, 0.1, 7
"""Least distance of a lost marker over the scatter; its jump off a running median, and its
distance, over the motion; rows of the running median."""
_LEAST = 1e-12  # least scatter, over the size of a coordinate
_SETTLED = 0.02  # relative change at which the scatter has converged


PerQuantity = Float[np.ndarray, " quantity"]
Rows = Int[np.ndarray, " row"]


class RecordWeights:
    """Weights of a record in a fit.

    Each coordinate has the weight of its scatter about the fit, which is estimated too. The places
    of holds are few, and share one scatter. Rows that no motion of the arm explains, such as those
    of a lost marker, are set aside; of holds only those beyond reach.
    """

    def __init__(self, experiment: Experiment, first: ArmMotion) -> None:
        self.experiment = experiment
        self._within_reach, self.notes = experiment.within_reach(first)
        self.used = self._within_reach  # rows that are not set aside as lost markers
        size = np.median(np.abs(experiment.measured), axis=0) + experiment.scenario.arm.length
        self._least = _LEAST * size
        self.scatter = self._robust_scatter(experiment.compare(first))
        """Standard deviation of each coordinate about the fit."""

    @property
    def _holds(self) -> bool:
        return self.experiment.record.holds is not None

    def update(self, run: RecordComparison) -> bool:
        """Set rows aside and estimate the scatter from a fit; return whether both stayed."""
        before, earlier = self.used, self.scatter
        if not self._holds:
            self.used = self._within_reach & self._explained(run)
            if not self.used.any():
                self.require_used(run)
        axis = None if self._holds else 0
        rms = np.sqrt(np.mean(run.residual[self.used] ** 2, axis=axis))
        self.scatter = np.maximum(rms, self._least)
        settled = np.abs(self.scatter / earlier - 1) < _SETTLED
        return bool(settled.all() and np.array_equal(self.used, before))

    def require_used(self, run: RecordComparison) -> None:
        """Refuse a record of which a fit sets more than a quarter of the rows aside."""
        if (lost := 1 - self.used.mean()) > LOST:
            stuck = self.experiment.stuck(run.computed).mean() > LOST / 2
            hint = "A stuck marker rests while the arm moves" if stuck else "Check the markers"
            text = f"got {lost:.0%} of rows that no motion of this arm explains"
            raise refusal("RECORD", text, f"be at most {LOST:.0%}", f"{hint}.")

    def squares(self, run: RecordComparison) -> Float[np.ndarray, "row quantity"]:
        """Return the squared residuals over the scatter, limited to that of a lost marker."""
        return np.minimum((run.residual[self.used] / self.scatter) ** 2, _FAR**2)

    def first_rows(self, share: float, least: int) -> Rows:
        """Return the first rows of a motion, a share of those used; all of holds."""
        used = np.flatnonzero(self.used)
        return used if self._holds else used[: max(int(np.ceil(share * used.size)), least)]

    def correlation(self, run: RecordComparison) -> tuple[PerQuantity, PerQuantity]:
        """Return the mean integral time of the residual of each coordinate (s), and its variance.

        The variance is that of a mean of samples over that of as many samples of white noise: twice
        the integral time over the interval of the samples, and at least 1. Holds count as white.
        """
        times, factors = [np.zeros(self.scatter.size)], [np.ones(self.scatter.size)]
        for rows in [] if self._holds else self.experiment.tracks:
            residual = run.residual[rows][self.used[rows]]
            interval = float(np.median(np.diff(self.experiment.time[rows])))
            if len(residual) > 2 and np.ptp(residual, axis=0).all():
                times.append(np.array([integral_time(each, interval) for each in residual.T]))
                factors.append(np.maximum(1.0, 2 * times[-1] / interval))
        first = 1 if len(times) > 1 else 0
        return np.mean(times[first:], axis=0), np.mean(factors[first:], axis=0)

    def _explained(self, run: RecordComparison) -> Bool[np.ndarray, " time"]:
        """Return the rows without lost markers (F. R. Hampel 1974).

        A lost marker jumps off its neighbours, or is far off. A distance below the path of the tip
        between two rows may be an error in time.
        """
        lost, scatter = self.experiment.stuck(run.computed), _FAR * self._robust_scatter(run)
        for rows in self.experiment.tracks:
            computed, residual = run.computed[rows], run.residual[rows]
            between = np.abs(np.diff(computed, axis=0, prepend=computed[:1]))
            between = maximum_filter(between, (3, 1))
            motion, off = np.ptp(computed, axis=0), np.abs(residual)
            jump = np.abs(residual - median_filter(residual, (_WINDOW, 1), mode="nearest"))
            away = np.minimum(jump, off) > np.maximum(scatter, _JUMP * motion) + between
            away |= off > np.maximum(scatter, _AWAY * motion) + between
            lost[rows] |= away.any(axis=1)
        return ~lost

    def _robust_scatter(self, run: RecordComparison) -> PerQuantity:
        """Return the scatter of most rows."""
        axis = None if self._holds else 0
        found = np.quantile(np.abs(run.residual[self.used]), _QUANTILE, axis=axis) / _DEVIATIONS
        return np.asarray(np.maximum(found, self._least))
