"""Statistics that sum up a current at one point."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from crinoid.correlation import integral_time

_STEADY = 1e-9
"""A standard deviation of less than this part of the largest speed is round-off."""


class Statistics(NamedTuple):
    """Statistics of a velocity over time, by component; not a number where there is none."""

    mean: Float[np.ndarray, " axis"]
    """Mean velocity (m/s)."""
    mean_speed: float
    """Mean of the speed (m/s)."""
    greatest_speed: float
    """Greatest speed (m/s)."""
    standard_deviation: Float[np.ndarray, " axis"]
    """Standard deviation about the mean velocity (m/s)."""
    intensity: Float[np.ndarray, " axis"]
    """Standard deviation over the size of the mean velocity."""
    integral_time: Float[np.ndarray, " axis"]
    """How long the current remembers itself (s): see `integral_time`."""
    integral_length: Float[np.ndarray, " axis"]
    """How far the mean velocity gets in that time (m): Taylor's frozen turbulence."""


def statistics(velocity: Float[np.ndarray, "time axis"], interval: float) -> Statistics:
    """Sum up a velocity (m/s) sampled at even intervals (s)."""
    mean, deviation = velocity.mean(axis=0), velocity.std(axis=0)
    speed = np.linalg.norm(velocity, axis=1)
    carried = float(np.linalg.norm(mean))
    if carried <= _STEADY * speed.max():
        carried = np.nan
    times = np.full(mean.shape, np.nan)
    for axis, series in enumerate(velocity.T):
        if deviation[axis] > _STEADY * speed.max():
            times[axis] = integral_time(series, interval)
    return Statistics(
        mean=mean,
        mean_speed=float(speed.mean()),
        greatest_speed=float(speed.max()),
        standard_deviation=deviation,
        intensity=deviation / carried,
        integral_time=times,
        integral_length=carried * times,
    )
