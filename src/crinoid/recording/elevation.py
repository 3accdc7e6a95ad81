"""Components of the elevation of the surface that a gauge measured."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Complex, Float

from crinoid.foundation.fixed_numbers import SPECTRUM_HIGHEST
from crinoid.numerics.sea_statistics import SeaStatistics
from crinoid.recording.numbers import Column
from crinoid.recording.sea import Sea
from crinoid.recording.series import Series, read_series, whole
from crinoid.recording.texts import short
from crinoid.recording.units import length_factor
from crinoid.scenario.errors import got, refusal
from crinoid.scenario.sea_file import ElevationFile

_HIGHEST = 1e3
"""Greatest elevation (m)."""
_EVEN = 1e-6
"""Largest deviation of an even interval, over the interval."""
_LEAST = 500
"""Samples before and after a run that show its peak."""
_MARGIN, _BEYOND, _RESOLUTION = 10, 5, 20
"""Peak periods: of the record before and after a run that is represented too, from there to the
repetition of the components, and of a window of the spectrum."""
_MOST = 10_000
"""Largest number of components."""
_NOISE, _FLOOR, _LEFT_OUT = 1e-4, 1e-6, 1e-4
"""Deviation from the record over that of the sea, least density over that of the peak, and the sum
of amplitudes that are left out over the significant height."""
_SLOW, _FEW = 1 / 3, 0.01
"""Frequency over that of the peak below which waves are slow, and a share of them to say."""


def read_elevation(table: ElevationFile, duration: float) -> Sea:
    """Read an elevation, and return components that add up to it during a run.

    The record is the run of ``duration`` (s) and ten peak periods before and after it, where the
    file has them. Components are the harmonics of a longer time, so that the record need not
    repeat: the most probable ones of a Gaussian sea with the spectrum of the record (Rasmussen and
    Williams 2006, Gaussian Processes for Machine Learning, equation 2.25).
    """
    column = Column("value", table.value, length_factor, "m", _HIGHEST)
    series = read_series(table.file, table.time, [column], table.skip, time_key="time")
    notes = list(whole(series, duration, "time").notes)
    interval = float(np.median(np.diff(series.time)))
    time, values, there = _evenly(series, interval, duration, notes)
    about = SeaStatistics.of_record(values, interval)
    if not about.height > 0:
        raise refusal("value", f"{table.value} does not vary", "be an elevation")
    peak, rate = 1 / about.peak_period, 1 / interval
    if table.cut_hz is not None and table.cut_hz >= rate / 2:
        must = f"be below {rate / 2:.6g} (Hz), half the rate of the record"
        raise refusal("cut_hz", got(table.cut_hz, must))
    cut = table.cut_hz or min(rate / 2, SPECTRUM_HIGHEST * peak)
    margin = _MARGIN / peak
    near = (time >= -margin - interval) & (time <= duration + margin + interval)
    frequency, found = _harmonics(values, near, there, interval, peak)
    time, values, there = time[near], values[near], there[near]
    mean, found[0] = found[0].real, 0.0
    kept = (frequency <= cut * (1 + 1e-9)) & (found != 0)
    variance = np.abs(found) ** 2
    size = np.abs(found) * kept
    order = np.argsort(size)
    kept[order[np.cumsum(size[order]) < _LEFT_OUT * about.height]] = False
    if (count := int(kept.sum())) > _MOST:
        text = f"{count} components reach {cut:.4g} Hz"
        raise refusal("cut_hz", text, f"be at most {_MOST}", "Lower it, or simulation.duration.")
    values = values - mean
    angle, rates = np.angle(found[kept]), 2 * np.pi * frequency[kept]
    given = {
        "amplitudes": np.abs(found[kept]),
        "frequencies": rates,
        "phases": (rates * time[0] - angle) / (2 * np.pi),
    }
    statistics = SeaStatistics.of_record(values, interval)
    run = (time >= 0) & (time <= duration) & there
    away = at_gauge(given, time[run]) - values[run]
    share = variance[frequency > cut].sum() / variance.sum()
    notes += [
        f"{short(table.file)}: {statistics} during the run and up to {margin:.3g} s before and "
        f"after it; its mean of {mean:.3g} m is taken off",
        f"{count} components up to {cut:.3g} Hz differ from the record during the run by "
        f"{np.sqrt(np.mean(away**2)):.2g} m RMS and {np.abs(away).max():.2g} m at most: "
        f"{share:.2%} of its variance is above that frequency and left out",
    ]
    slow = variance[frequency < _SLOW * peak].sum() / variance.sum()
    if slow > _FEW:
        notes.append(
            f"{slow:.0%} of its variance is slower than {1 / (_SLOW * peak):.3g} s and moves the "
            "water as long waves: filter the record where that is a tide"
        )
    record = Series(time, values[:, None], ())
    return Sea(short(table.file), statistics, given, record, tuple(notes))


def at_gauge(
    given: dict[str, Float[np.ndarray, " m"]], time: Float[np.ndarray, " time"]
) -> Float[np.ndarray, " time"]:
    """Return the elevation of components at the gauge (m) at times of the run (s)."""
    found = np.zeros(time.size)
    for each in zip(given["amplitudes"], given["frequencies"], given["phases"], strict=True):
        amplitude, rate, phase = each
        found += amplitude * np.cos(2 * np.pi * phase - rate * time)
    return found


def _evenly(
    series: Series, interval: float, duration: float, notes: list[str]
) -> tuple[Float[np.ndarray, " time"], Float[np.ndarray, " time"], Bool[np.ndarray, " time"]]:
    """Return the part of a record about a run at even times, its values, and which are measured.

    It is as long before and after the run as that, where the file has it.
    """
    reach = max(duration, _LEAST * interval)
    part = (series.time >= -reach) & (series.time <= duration + reach)
    time, values = series.time[part], series.values[part, 0]
    steps = np.diff(time)
    if np.abs(steps / interval - 1).max() <= _EVEN:
        return time, values, np.full(time.size, True)
    from scipy.interpolate import CubicSpline  # slow to load, and few scenarios need it

    even = time[0] + interval * np.arange(int((time[-1] - time[0]) / interval + _EVEN) + 1)
    after = np.clip(np.searchsorted(time, even), 1, time.size - 1)
    nearest = np.minimum(np.abs(time[after] - even), np.abs(even - time[after - 1]))
    notes.append(
        f"samples are {steps.min():.4g} to {steps.max():.4g} s apart: a spline through them is "
        f"sampled every {interval:.4g} s"
    )
    there = nearest < 0.99 * interval
    return (
        even,
        np.where(there, CubicSpline(time, values)(even), np.interp(even, time, values)),
        there,
    )


def _harmonics(
    values: Float[np.ndarray, " time"],
    near: Bool[np.ndarray, " time"],
    there: Bool[np.ndarray, " time"],
    interval: float,
    peak: float,
) -> tuple[Float[np.ndarray, " f"], Complex[np.ndarray, " f"]]:
    """Return frequencies (Hz) and complex amplitudes of the values that are ``near``.

    The first one is their mean. Values that are not ``there`` do not count.
    """
    from scipy.fft import next_fast_len
    from scipy.signal import welch
    from scipy.sparse.linalg import LinearOperator, cg

    period = 1 / (peak * interval)
    segment = min(values.size, int(_RESOLUTION * period))
    spectrum = welch(values, 1 / interval, nperseg=segment)
    values, there = values[near], there[near]
    mean, count = values[there].mean(), values.size
    values = np.where(there, values - mean, 0.0)
    length = next_fast_len(int(count + _BEYOND * period), real=True)
    frequency = np.fft.rfftfreq(length, interval)
    # variance of each harmonic; the mean is as uncertain as the sea is high
    prior = np.interp(frequency, *spectrum)
    prior += _FLOOR * prior.max()
    prior[0] = prior.max() * length
    noise = _NOISE**2 * prior[1:].mean()
    near_by = np.interp(np.fft.rfftfreq(count, interval), frequency, prior)

    def covariance(weights: np.ndarray) -> np.ndarray:
        spread = np.fft.irfft(prior * np.fft.rfft(weights * there, length), length)[:count]
        return spread * there + noise * weights

    def inverse(weights: np.ndarray) -> np.ndarray:
        return np.fft.irfft(np.fft.rfft(weights) / (near_by + noise), count)

    square = (count, count)
    operators = [LinearOperator(square, each, dtype=float) for each in (covariance, inverse)]
    weights, _ = cg(operators[0], values, rtol=1e-8, maxiter=2000, M=operators[1])
    found = 2 / length * prior * np.fft.rfft(weights * there, length)
    found[0] = 0.5 * found[0] + mean
    return frequency, found
