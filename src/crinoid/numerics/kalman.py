"""Kalman filter: corrections, and the stationary filter of readings in a repeating pattern."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from crinoid.numerics.signals_and_systems import Matrix, gramian

_ROUNDS = 100  # largest number of passes through a pattern until the gains have settled
_SETTLED = 1e-6


def stationary_covariance(move: Matrix, noise: Matrix) -> Matrix:
    """Return the stationary covariance of states without control.

    A growing motion has none: it counts as one that neither grows nor decays.
    """
    fastest = np.abs(np.linalg.eigvals(move)).max()
    return gramian(move * 0.9999 / max(1.0, fastest), noise)


class Correction(NamedTuple):
    """Correction of a Kalman filter by new readings."""

    gain: Matrix
    innovation: Matrix  # covariance of the readings less those expected
    covariance: Matrix  # covariance of the corrected states

    @staticmethod
    def of(ahead: Matrix, seen: Matrix, of_readings: Float[np.ndarray, " y"]) -> "Correction":
        """Return it for the covariance of predicted states, by readings ``seen`` of them.

        ``of_readings`` is the variance of the noise of each reading.
        """
        innovation = seen @ ahead @ seen.T + np.diag(of_readings)
        gain = np.linalg.solve(innovation, seen @ ahead).T
        left = np.eye(ahead.shape[0]) - gain @ seen
        by_noise = gain * np.sqrt(of_readings)
        return Correction(gain, innovation, left @ ahead @ left.T + by_noise @ by_noise.T)


class StationaryFilter(NamedTuple):
    """Kalman filter for readings that arrive in a pattern that repeats."""

    fresh: Bool[np.ndarray, "set y"]  # sets of new readings
    gains: Float[np.ndarray, "set z y"]
    """Gain for each of them, the mean over the calls that have it."""
    covariance: Matrix
    """Covariance of the states corrected by these gains, its mean over the pattern."""


def stationary_filter(
    move: Matrix,
    noise: Matrix,
    expect: Matrix,
    of_readings: Float[np.ndarray, " y"],
    fresh: Bool[np.ndarray, "tick y"],
) -> StationaryFilter:
    """Return the filter that the Riccati equation settles on.

    ``noise`` is the covariance of the states' noise, ``of_readings`` the variance of that of each
    reading; ``fresh`` are the new readings of each call, a pattern that repeats.
    """
    from scipy.linalg import solve_discrete_are, solve_discrete_lyapunov  # slow to load

    ahead = solve_discrete_are(move.T, expect.T, noise, np.diag(of_readings))
    found: dict[tuple[bool, ...], list[Matrix]] = {}
    pattern = fresh[:1] if fresh.all() else fresh
    for _ in range(_ROUNDS):
        found, before = {}, ahead
        for counted in pattern:
            step = Correction.of(ahead, expect[counted], of_readings[counted])
            gain = np.zeros(expect.T.shape)
            gain[:, counted] = step.gain
            ahead = move @ step.covariance @ move.T + noise
            found.setdefault(tuple(map(bool, counted)), []).append(gain)
        if np.abs(ahead - before).max() <= _SETTLED * np.abs(ahead).max():
            break
    means = {each: np.mean(gains, axis=0) for each, gains in found.items()}
    # errors that these gains leave, which are not the best ones of each call
    used = [means[tuple(map(bool, counted))] for counted in pattern]
    left = [np.eye(len(move)) - gain @ expect for gain in used]
    added = [gain * of_readings @ gain.T for gain in used]
    around, ahead, total = np.eye(len(move)), np.zeros_like(move), np.zeros_like(move)
    for keep, new in zip(left, added, strict=True):
        around = move @ keep @ around
        ahead = move @ (keep @ ahead @ keep.T + new) @ move.T + noise
    if np.abs(np.linalg.eigvals(around)).max() >= 1:
        raise np.linalg.LinAlgError("the filter of these readings is unstable")
    ahead = solve_discrete_lyapunov(around, ahead)
    for keep, new in zip(left, added, strict=True):
        after = keep @ ahead @ keep.T + new
        total, ahead = total + after, move @ after @ move.T + noise
    return StationaryFilter(np.array(list(means)), np.stack([*means.values()]), total / len(used))
