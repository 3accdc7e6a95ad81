"""How the water is expected to vary: statistics of the flows of a scenario, not their course."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from jaxtyping import Float

from crinoid.correlation import integral_time
from crinoid.scenario import (
    GaussMarkovFlow,
    GustFlow,
    MeasuredFlow,
    Scenario,
    SineFlow,
    TurbulenceFlow,
    WavesFlow,
)

if TYPE_CHECKING:
    from crinoid.recording import Recording  # xarray, slow to load

_SLOW = 20.0
"""Correlation time of what no flow accounts for (s)."""
_LEAST = 0.02
"""Its standard deviation (m/s), at least: loads that are not known look like a current."""
_SHARE = 0.1
"""And at least this share of all the rest."""
_WIDTH = 0.15
"""Damping ratio of the oscillator that stands for waves: how broad their spectrum is."""
_NARROW = 0.01
"""Damping ratio for a swell of one frequency."""


class Fluctuation(NamedTuple):
    """Velocity of the water that varies at random about its mean."""

    deviation: Float[np.ndarray, " d"]
    """Standard deviation along each axis (m/s)."""
    time: float
    """Correlation time (s), of an oscillation its period."""
    damping: float | None = None
    """Damping ratio of what oscillates; None: it does not."""

    def process(self, period: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return ``F``, ``Q`` and ``S`` of ``d' = F d + v``, ``w = S d``, with ``w`` of variance 1.

        ``Q`` is the covariance of the noise ``v``, sampled every ``period`` seconds. An oscillation
        is a damped one of the second order that white noise drives.
        """
        if self.damping is None:
            kept = math.exp(-period / self.time)
            return np.array([[kept]]), np.array([[1 - kept**2]]), np.ones((1, 1))
        from scipy.linalg import expm  # slow to load

        rate = 2 * math.pi / self.time
        kept = expm(period * rate * np.array([[0.0, 1.0], [-1.0, -2 * self.damping]]))
        # both of variance 1, uncorrelated
        return kept, np.eye(2) - kept @ kept.T, np.array([[1.0, 0.0]])


def fluctuations(
    scenario: Scenario, recordings: Mapping[int, Recording]
) -> tuple[Fluctuation, ...]:
    """Return the fluctuations of all flows of a scenario, one that is slow last."""
    axes, found = scenario.arm.dimension, []
    for index, flow in enumerate(scenario.flow):
        match flow:
            case TurbulenceFlow():
                speed = math.hypot(*flow.mean)
                spread = np.full(axes, flow.intensity * speed)
                found.append(Fluctuation(spread, flow.length_scale / speed if speed else _SLOW))
            case GaussMarkovFlow():
                spread = np.broadcast_to(flow.standard_deviation, axes)
                found.append(Fluctuation(spread, flow.correlation_time))
            case GustFlow():
                found.append(Fluctuation(np.abs(flow.velocity) / 2, flow.duration / 2))
            case SineFlow():
                spread = np.abs(flow.amplitude) / math.sqrt(2)
                found.append(Fluctuation(spread, 1 / flow.frequency_hz, _NARROW))
            case WavesFlow():
                found.append(_waves(flow, scenario))
            case MeasuredFlow():
                found.append(_measured(recordings[index]))
            case _:
                pass
    total = np.sqrt(sum((each.deviation**2 for each in found), np.zeros(axes)))
    found.append(Fluctuation(np.maximum(_LEAST, _SHARE * total), _SLOW))
    return tuple(found)


def _waves(flow: WavesFlow, scenario: Scenario) -> Fluctuation:
    """Return what long-crested waves do at the middle of the arm, those of the peak's period."""
    rate = 2 * math.pi / flow.peak_period
    number = rate**2 / max(scenario.water.gravity, 1e-9)
    depth = -scenario.base.position[-1]
    orbital = flow.significant_height / 4 * rate * math.exp(-number * max(depth, 0.0))
    spread = np.full(scenario.arm.dimension, orbital)
    return Fluctuation(spread, flow.peak_period, _WIDTH)


def _measured(recording: Recording) -> Fluctuation:
    """Return deviation and correlation time of a record as it is played.

    Of several levels where it varies most, and of several axes along that which forgets soonest:
    what is slow has a part of its own.
    """
    varies = np.var(recording.velocity, axis=0)
    series = recording.velocity[:, int(np.argmax(varies.sum(axis=1)))].T
    times = [integral_time(each, recording.interval) for each in series if np.ptp(each)]
    deviation = np.sqrt(varies.mean(axis=0))
    return Fluctuation(deviation, recording.time_scale * min(times) if times else _SLOW)
