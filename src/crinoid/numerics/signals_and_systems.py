"""Signals and linear systems: spectra, integral time scale, balanced truncation."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from numpy.lib.stride_tricks import sliding_window_view


def integral_time(series: Float[np.ndarray, " time"], interval: float) -> float:
    """Return the integral time scale: the autocorrelation integrated to its first zero (s).

    Beyond that it is mostly noise, as a record is finite and without its mean.
    """
    fluctuation = series - series.mean()
    # zero-padded to twice the length, against wrap-around (Wiener and Khinchin)
    spectrum = np.abs(np.fft.rfft(fluctuation, 2 * series.size)) ** 2
    correlation = np.fft.irfft(spectrum)[: series.size]
    correlation = correlation / correlation[0]
    negative = np.flatnonzero(correlation <= 0)  # exists: all together add up to -1/2
    last = int(negative[0])
    before, after = correlation[last - 1], correlation[last]
    to_zero = before / (before - after)
    whole = correlation[:last].sum() - 0.5 * (correlation[0] + before)
    return float(interval * (whole + 0.5 * before * to_zero))


_SEGMENTS = 4
_SHORTEST = 256

_FEWEST = 64  # fewest samples of a window
_HOLES = 0.05  # largest filled share of a window

_LENGTH = 8.4130926
"""2 pi 1.339, with 1.339 = Gamma(1/3) / (sqrt(pi) Gamma(5/6)): von Karman's eddies over L_u."""


class Spectrum(NamedTuple):
    """Spectral density of a fluctuation."""

    frequency: Float[np.ndarray, " frequency"]  # frequency (Hz)
    density: Float[np.ndarray, "frequency place axis"]  # one-sided spectral density (m2 s-2/Hz)
    sound: int  # number of windows without holes, which are averaged; if there are none, all are
    windows: int


def spectrum(
    velocity: Float[np.ndarray, "time place axis"],
    interval: float,
    holes: Bool[np.ndarray, " time"] | None = None,
) -> Spectrum:
    """Estimate spectral densities by Welch's method.

    With at most four Hann windows that overlap by half, of at least 256 samples. Windows of which
    holes that were filled make up more than a twentieth are omitted: straight lines have no eddies.
    If none remains, the windows are shortened.
    """
    length = min(len(velocity), max(_SHORTEST, 2 * len(velocity) // (_SEGMENTS + 1)))
    while True:
        windows = periodograms(velocity, interval, length)
        starts = (length - length // 2) * np.arange(len(windows))
        sound = np.ones(starts.size, bool)
        if holes is not None:
            before = np.concatenate([[0], np.cumsum(holes)])
            sound = before[starts + length] - before[starts] <= _HOLES * length
        if sound.any() or length < 2 * _FEWEST:
            break
        length //= 2
    used = sound if sound.any() else np.ones_like(sound)
    # without the mean, which was subtracted
    frequency, density = np.fft.rfftfreq(length, interval)[1:], windows[used].mean(axis=0)[1:]
    return Spectrum(frequency, density, int(sound.sum()), sound.size)


def periodograms(
    velocity: Float[np.ndarray, "time place axis"], interval: float, length: int
) -> Float[np.ndarray, "window frequency place axis"]:
    """Return the one-sided spectral density of each window, without its mean, under a Hann taper.

    Equal to `scipy.signal.spectrogram`, whose import would delay the page of every run by 0.5 s.
    """
    windows = sliding_window_view(velocity, length, axis=0)[:: length - length // 2]
    taper = np.hanning(length + 1)[:-1]  # periodic in the window
    parts = np.fft.rfft((windows - windows.mean(axis=-1, keepdims=True)) * taper)
    density = np.abs(parts) ** 2 * interval / np.sum(taper**2)
    density[..., 1 : (length + 1) // 2] *= 2  # and negative frequencies
    return np.moveaxis(density, -1, 1)


def von_karman(
    frequency: Float[np.ndarray, " frequency"],
    standard_deviation: float,
    passing_time: float,
    along: float,
) -> Float[np.ndarray, " frequency"]:
    """Return von Karman's one-sided spectral density of a component (m2 s-2/Hz).

    For isotropic turbulence that drifts past a point (T. von Karman, Progress in the
    statistical theory of turbulence, PNAS 34 (1948); ESDU 85020). ``passing_time`` is the
    longitudinal integral length over the mean speed (s), and ``along`` the square of the cosine
    between component and mean velocity: 1 along it, 0 across. Frequencies in Hz, deviation in m/s.
    """
    reduced = (_LENGTH * passing_time * frequency) ** 2
    longitudinal = 4 / (1 + reduced) ** (5 / 6)
    transverse = 2 * (1 + 8 / 3 * reduced) / (1 + reduced) ** (11 / 6)
    share = along * longitudinal + (1 - along) * transverse
    return standard_deviation**2 * passing_time * share


Matrix = Float[np.ndarray, "_ _"]

_LASTING = 1.0 - 1e-9
"""Discounted eigenvalue above which a mode counts as lasting and is never truncated."""
_DOUBLINGS = 40


class Reduced(NamedTuple):
    """Reduced linear model ``z' = A z + B u``, ``y = C z``; ``z = left x``, ``x = right z``."""

    A: Float[np.ndarray, "z z"]
    B: Float[np.ndarray, "z u"]
    C: Float[np.ndarray, "y z"]
    left: Float[np.ndarray, "z x"]
    right: Float[np.ndarray, "x z"]
    hankel: Float[np.ndarray, " h"]  # Hankel singular values of the decaying part, largest first


def balanced(
    A: Matrix, B: Matrix, C: Matrix, *, share: float, most: int, discount: float = 1.0
) -> Reduced:
    """Reduce a discrete linear model by balanced truncation (Moore 1981).

    Scale inputs and outputs so that their largest values are 1. States with a Hankel singular
    value below ``share`` of the largest are truncated; at most ``most`` others remain, and all
    lasting modes. The error of the transfer function is at most twice the sum of the truncated
    values (Glover 1984).

    ``discount`` is a factor per step in the Gramians: below 1 it makes those of slowly decaying
    modes finite. The matrices of the reduced model are not discounted.
    """
    from scipy.linalg import schur, solve_sylvester  # slow to load

    size = A.shape[0]

    # lasting modes first, then decoupled from the rest
    triangle, basis, lasting = schur(
        A, sort=lambda real, imag=0.0: bool(discount * np.hypot(real, imag) >= _LASTING)
    )
    coupling = solve_sylvester(
        triangle[:lasting, :lasting], -triangle[lasting:, lasting:], -triangle[:lasting, lasting:]
    )
    into, out_of = np.eye(size), np.eye(size)
    into[:lasting, lasting:], out_of[:lasting, lasting:] = coupling, -coupling
    right, left = basis @ into, out_of @ basis.T
    rest = slice(lasting, size)
    inner, driven, seen = triangle[rest, rest], left[rest] @ B, C @ right[:, rest]
    reached = _root(gramian(discount * inner, driven @ driven.T))
    observed = _root(gramian(discount * inner.T, seen.T @ seen))
    u, values, vt = np.linalg.svd(observed.T @ reached)
    count = min(most, int(np.sum(values > share * values.max(initial=0.0))))
    scale = 1 / np.sqrt(values[:count])
    far = reached @ vt[:count].T * scale
    near = (observed @ u[:, :count] * scale).T
    right = np.concatenate([right[:, :lasting], right[:, rest] @ far], axis=1)
    left = np.concatenate([left[:lasting], near @ left[rest]])
    return Reduced(left @ A @ right, left @ B, C @ right, left, right, values)


_SETTLED = 100  # steps over which the response to inputs is summed
_GROWN = 1e12  # response of an unstable system that is not followed further
_UNMOVED = 1e-9  # motion of a state over the largest below which it is round-off


def balanced_by_reach(
    A: Matrix, B: Matrix, C: Matrix, *, share: float, most: int, discount: float = 1.0
) -> tuple[Reduced, Float[np.ndarray, " y"]]:
    """Reduce a model in any units by `balanced`; return it with the scale of each output.

    Outputs are scaled by the root sum of squares of their response to the inputs, states by theirs:
    round-off is as small for each. Scale the inputs so that their largest values are 1. The reduced
    model is in the units of the given one.
    """
    parts = [B]
    while len(parts) <= _SETTLED and np.abs(parts[-1]).max(initial=0.0) < _GROWN:
        parts.append(A @ parts[-1])
    reach = np.hstack(parts)  # the controllability matrix
    scale, unit = (np.sqrt(np.sum(each**2, axis=1)) for each in (C @ reach, reach))
    scale[scale <= 0] = 1.0
    unit[unit <= _UNMOVED * unit.max()] = 1.0
    found = balanced(
        A * unit / unit[:, None],
        B / unit[:, None],
        C * unit / scale[:, None],
        share=share,
        most=most,
        discount=discount,
    )
    left, right = found.left / unit, unit[:, None] * found.right
    return found._replace(C=scale[:, None] * found.C, left=left, right=right), scale


def gramian(A: Matrix, first: Matrix) -> Matrix:
    """Return the sum of ``A^k first A^kT`` by doubling the number of terms (Smith 1968)."""
    total = first
    for _ in range(_DOUBLINGS):
        more = A @ total @ A.T
        total = total + more
        if np.abs(more).max(initial=0.0) <= 1e-15 * np.abs(total).max(initial=0.0):
            break
        A = A @ A
    return total


def _root(gramian: Matrix) -> Matrix:
    """Return ``R`` of ``R R^T``, which may be indefinite by round-off."""
    values, vectors = np.linalg.eigh(0.5 * (gramian + gramian.T))
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))
