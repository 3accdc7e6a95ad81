"""Over which frequencies the fluctuations of a current spread, and how turbulence spreads them."""

import numpy as np
from jaxtyping import Float

_SEGMENTS = 4
_SHORTEST = 256

_LENGTH = 8.4130926
"""2 pi 1.339, with 1.339 = Gamma(1/3) / (sqrt(pi) Gamma(5/6)): von Karman's eddies over L_u."""


def spectrum(
    velocity: Float[np.ndarray, "time place axis"], interval: float
) -> tuple[Float[np.ndarray, " frequency"], Float[np.ndarray, "frequency place axis"]]:
    """Return frequencies (Hz) and one-sided spectral densities (m2 s-2/Hz), by Welch's method.

    Four Hann windows that overlap by half, or fewer, so that none has less than 256 samples.
    """
    from scipy.signal import welch  # slow to load

    length = min(len(velocity), max(_SHORTEST, 2 * len(velocity) // (_SEGMENTS + 1)))
    frequency, density = welch(
        velocity, fs=1 / interval, nperseg=length, detrend="constant", axis=0
    )
    return frequency[1:], density[1:]  # the first belongs to the mean, which has been taken off


def von_karman(
    frequency: Float[np.ndarray, " frequency"],
    standard_deviation: float,
    passing_time: float,
    along: float,
) -> Float[np.ndarray, " frequency"]:
    """Return von Karman's one-sided spectral density of a component (m2 s-2/Hz).

    Of isotropic turbulence that is carried past a place (T. von Karman, Progress in the
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
