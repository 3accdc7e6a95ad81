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
    UniformFlow,
    WavesFlow,
)

if TYPE_CHECKING:
    from crinoid.recording import Recording  # xarray, slow to load

_SLOW = 15.0
"""Correlation time of what no flow accounts for, over the arm's first period."""
_LEAST = 0.05
"""Its standard deviation over the arm's length in a first period, at least: loads that are not
known look like a current."""
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
    slowness: Float[np.ndarray, " d"] | None = None
    """Delay over distance (s/m) of a record that drifts past; None: it does not."""
    drift: Float[np.ndarray, " d"] | None = None
    """Mean velocity (m/s) of eddies; None: it has none."""
    length: float | None = None
    """Longitudinal integral scale of its eddies (m); None: it is the same across the drift."""

    def covariance(
        self, apart: Float[np.ndarray, "... d"], lag: Float[np.ndarray, ...]
    ) -> Float[np.ndarray, "... d d"]:
        """Return that of the velocities at two points ``apart`` (m), the first ``lag`` (s) later.

        Turbulence is isotropic (Batchelor 1953, chapter 3), with von Karman's longitudinal
        correlation (1948).
        """
        if self.length is not None and self.drift is not None:
            away = apart - self.drift * lag[..., None]
            return np.outer(self.deviation, self.deviation) * _isotropic(away, self.length)
        carried = 0.0 if self.slowness is None else apart @ self.slowness
        later = np.abs(lag - carried)
        if self.damping is None:
            kept = np.exp(-later / self.time)
        else:
            rate, share = 2 * math.pi / self.time, math.sqrt(1 - self.damping**2)
            angle = rate * share * later
            swing = np.cos(angle) + self.damping / share * np.sin(angle)
            kept = np.exp(-self.damping * rate * later) * swing
        return kept[..., None, None] * np.diag(self.deviation**2)

    @property
    def accelerates(self) -> bool:
        """Whether particles of the water feel it change: not in a pattern that drifts with them."""
        return self.slowness is None and self.drift is None

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
    scenario: Scenario, recordings: Mapping[int, Recording], first_period: float
) -> tuple[Fluctuation, ...]:
    """Return the fluctuations of all flows of a scenario, one that is slow last.

    ``first_period`` is that of the arm's slowest vibration (s).
    """
    slow = _SLOW * first_period
    axes, found = scenario.arm.dimension, []
    carrier, swing = _carrier(scenario, recordings)
    for index, flow in enumerate(scenario.flow):
        match flow:
            case TurbulenceFlow():
                spread = np.full(axes, flow.intensity * math.hypot(*flow.mean))
                # where nothing else moves them, eddies last as long as they take to turn
                speed = max(math.sqrt(carrier @ carrier + swing), spread[0])
                passing = flow.length_scale / speed
                found.append(Fluctuation(spread, passing, drift=carrier, length=flow.length_scale))
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
                found.append(_measured(recordings[index], slow))
            case _:
                pass
    total = np.sqrt(sum((each.deviation**2 for each in found), np.zeros(axes)))
    least = _LEAST * scenario.arm.length / first_period
    found.append(Fluctuation(np.maximum(least, _SHARE * total), slow))
    return tuple(found)


def _carrier(
    scenario: Scenario, recordings: Mapping[int, Recording]
) -> tuple[Float[np.ndarray, " d"], float]:
    """Return the mean velocity (m/s) that carries eddies, and its variance over all axes."""
    mean, variance = np.zeros(scenario.arm.dimension), 0.0
    for index, flow in enumerate(scenario.flow):
        match flow:
            case UniformFlow():
                mean += flow.velocity
            case TurbulenceFlow():
                mean += flow.mean
            case GaussMarkovFlow():
                mean += flow.mean
                spread = np.broadcast_to(flow.standard_deviation, mean.size)
                variance += float(spread @ spread)
            case SineFlow():
                variance += float(np.dot(flow.amplitude, flow.amplitude)) / 2
            case MeasuredFlow() if recordings[index].levels is None:
                record = recordings[index]
                mean += record.velocity[:, 0].mean(axis=0)
                if not np.any(record.slowness):
                    variance += float(record.velocity[:, 0].var(axis=0).sum())
            case _:
                pass
    return mean, variance


def _isotropic(away: Float[np.ndarray, "... d"], length: float) -> Float[np.ndarray, "... d d"]:
    """Return the correlation of isotropic turbulence at two points, by component."""
    from scipy.special import gamma, kv  # slow to load

    energetic = length * gamma(1 / 3) / (math.sqrt(math.pi) * gamma(5 / 6))
    distance = np.linalg.norm(away, axis=-1)
    scaled = np.maximum(distance / energetic, 1e-9)
    factor = 2 ** (2 / 3) / gamma(1 / 3) * scaled ** (1 / 3)
    steep = 0.5 * factor * scaled * kv(2 / 3, scaled)
    along = away / np.maximum(distance, 1e-300)[..., None]
    radial = along[..., :, None] * along[..., None, :]
    across = factor * kv(1 / 3, scaled) - steep
    return across[..., None, None] * np.eye(away.shape[-1]) + steep[..., None, None] * radial


def _waves(flow: WavesFlow, scenario: Scenario) -> Fluctuation:
    """Return what long-crested waves do at the middle of the arm, those of the peak's period."""
    rate = 2 * math.pi / flow.peak_period
    number = rate**2 / max(scenario.water.gravity, 1e-9)
    depth = -scenario.base.position[-1]
    orbital = flow.significant_height / 4 * rate * math.exp(-number * max(depth, 0.0))
    spread = np.full(scenario.arm.dimension, orbital)
    return Fluctuation(spread, flow.peak_period, _WIDTH)


def _measured(recording: Recording, slow: float) -> Fluctuation:
    """Return deviation and correlation time of a record as it is played.

    Of several levels where it varies most, and of several axes along that which forgets soonest:
    what is slow has a part of its own.
    """
    varies = np.var(recording.velocity, axis=0)
    series = recording.velocity[:, int(np.argmax(varies.sum(axis=1)))].T
    times = [integral_time(each, recording.interval) for each in series if np.ptp(each)]
    deviation = np.sqrt(varies.mean(axis=0))
    slowness = recording.slowness if np.any(recording.slowness) else None
    time = recording.time_scale * min(times) if times else slow
    return Fluctuation(deviation, time, slowness=slowness)
