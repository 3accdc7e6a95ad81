"""Figures that sum up a run: how far the tip was from where it should have been."""

from typing import NamedTuple

import numpy as np

from crinoid.result import Result

_LAST = 0.1
"""The part of a run, at its end, that counts as steady."""
_BAND = 0.05
"""A tip has settled when its error stays within this part of the largest one without control."""


class TipError(NamedTuple):
    """Tip errors of one run (m), over its saved instants."""

    rms: float
    maximum: float
    steady: float
    """Mean over the last tenth of the run."""
    fluctuation: float
    """RMS distance of the tip from its own mean place."""


def tip_error(result: Result) -> TipError:
    """Sum up the tip error of a run."""
    error = result.dataset["tip_error"].values
    tip = result.dataset["tip_position"].values
    steady = _steady(result)
    return TipError(
        rms=float(np.sqrt(np.mean(error**2))),
        maximum=float(np.max(error)),
        steady=float(np.mean(error[steady])),
        fluctuation=float(np.sqrt(np.mean(np.sum((tip - tip.mean(axis=0)) ** 2, axis=1)))),
    )


def settling_time(result: Result) -> float | None:
    """Return when the tip error last came into its band (s), or none if it ended outside.

    The band is 5 % of the largest error of the run without control, or of this run if there is
    none.
    """
    reference = result.uncontrolled if result.uncontrolled is not None else result
    band = _BAND * float(np.max(reference.dataset["tip_error"].values))
    time = result.dataset["time"].values
    outside = np.flatnonzero(result.dataset["tip_error"].values > band)
    if outside.size == 0:
        return float(time[0])
    if outside[-1] == time.size - 1:
        return None
    return float(time[outside[-1] + 1])


def deflection(result: Result) -> float:
    """Return how far the tip ends from its target without control, in the steady part (m)."""
    reference = result.uncontrolled if result.uncontrolled is not None else result
    return tip_error(reference).steady


def _steady(result: Result) -> np.ndarray:
    time = result.dataset["time"].values
    return time >= time[-1] - _LAST * (time[-1] - time[0])
