"""Over which frequencies the fluctuations of a current spread, and how turbulence spreads them."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from numpy.lib.stride_tricks import sliding_window_view

_SEGMENTS = 4
_SHORTEST = 256

_FEWEST = 64
"""Samples of a window that still tell something."""
_HOLES = 0.05
"""Part of a window that may be filled."""

_LENGTH = 8.4130926
"""2 pi 1.339, with 1.339 = Gamma(1/3) / (sqrt(pi) Gamma(5/6)): von Karman's eddies over L_u."""


class Spectrum(NamedTuple):
    """How a fluctuation spreads over frequencies."""

    frequency: Float[np.ndarray, " frequency"]
    """In Hz."""
    density: Float[np.ndarray, "frequency place axis"]
    """One-sided spectral density (m2 s-2/Hz)."""
    sound: int
    """Windows without holes, over which it is the mean; of none, over all."""
    windows: int


def spectrum(
    velocity: Float[np.ndarray, "time place axis"],
    interval: float,
    holes: Bool[np.ndarray, " time"] | None = None,
) -> Spectrum:
    """Estimate spectral densities by Welch's method.

    Of four Hann windows that overlap by half, or fewer, so that none has less than 256 samples.
    Windows in which more than a twentieth is a hole that was filled are left out: straight lines
    have no eddies. Where none is left the windows are made shorter.
    """
    length = min(len(velocity), max(_SHORTEST, 2 * len(velocity) // (_SEGMENTS + 1)))
    while True:
        windows = _periodograms(velocity, interval, length)
        starts = (length - length // 2) * np.arange(len(windows))
        sound = np.ones(starts.size, bool)
        if holes is not None:
            before = np.concatenate([[0], np.cumsum(holes)])
            sound = before[starts + length] - before[starts] <= _HOLES * length
        if sound.any() or length < 2 * _FEWEST:
            break
        length //= 2
    used = sound if sound.any() else np.ones_like(sound)
    # the first belongs to the mean, which has been taken off
    frequency, density = np.fft.rfftfreq(length, interval)[1:], windows[used].mean(axis=0)[1:]
    return Spectrum(frequency, density, int(sound.sum()), sound.size)


def _periodograms(
    velocity: Float[np.ndarray, "time place axis"], interval: float, length: int
) -> Float[np.ndarray, "window frequency place axis"]:
    """Return the one-sided spectral density of each window, less its mean, under a Hann taper.

    As `scipy.signal.spectrogram` does, which takes long to load: every run's page has a spectrum.
    """
    windows = sliding_window_view(velocity, length, axis=0)[:: length - length // 2]
    taper = np.hanning(length + 1)[:-1]  # its period is the window
    parts = np.fft.rfft((windows - windows.mean(axis=-1, keepdims=True)) * taper)
    density = np.abs(parts) ** 2 * interval / np.sum(taper**2)
    density[..., 1 : (length + 1) // 2] *= 2  # and those below zero
    return np.moveaxis(density, -1, 1)


def von_karman(
    frequency: Float[np.ndarray, " frequency"],
    standard_deviation: float,
    passing_time: float,
    along: float,
) -> Float[np.ndarray, " frequency"]:
    """Return von Karman's one-sided spectral density of a component (m2 s-2/Hz).

    Of isotropic turbulence that is carried past a point (T. von Karman, Progress in the
    statistical theory of turbulence, PNAS 34 (1948); ESDU 85020).

    Parameters
    ----------
    frequency
        In Hz.
    standard_deviation
        Of the component (m/s).
    passing_time
        Longitudinal integral length over mean speed (s).
    along
        Square of the cosine between component and mean velocity: 1 along it, 0 across.
    """
    reduced = (_LENGTH * passing_time * frequency) ** 2
    longitudinal = 4 / (1 + reduced) ** (5 / 6)
    transverse = 2 * (1 + 8 / 3 * reduced) / (1 + reduced) ** (11 / 6)
    share = along * longitudinal + (1 - along) * transverse
    return standard_deviation**2 * passing_time * share
