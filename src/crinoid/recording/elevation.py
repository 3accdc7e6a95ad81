"""Components of the elevation of the surface that a gauge measured."""

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

_HIGHEST, _EVEN, _FEWEST, _LEAST, _MOST = 1e3, 1e-6, 16, 500, 10_000
"""Greatest elevation (m), relative deviation of even intervals, fewest samples, fewest before and
after a run that show its peak, and most components."""
_MARGIN, _BEYOND, _WINDOW = 10, 5, 20
"""Peak periods: of the record before and after a run that is represented too, from there to the
repetition of the components, and of a window of the spectrum."""
_NEARLY_ALL = 0.999  # share of the variance up to the default of the highest frequency
_NOISE, _FLOOR, _LEFT_OUT = 1e-4, 1e-8, 1e-4
"""Deviation from the record over that of the sea, least density over that of the peak, and the sum
of amplitudes that are left out over the significant height."""


def read_elevation(table: ElevationFile, duration: float) -> Sea:
    """Read an elevation, and return components that add up to it during a run of ``duration`` (s).

    They represent ten peak periods before and after it too, where the file has them. They are the
    harmonics of a longer time, and of all with these sums the most probable ones of a Gaussian sea
    with the spectrum of the record (Rasmussen and Williams 2006, equation 2.25).
    """
    column = Column("value", table.value, length_factor, "m", _HIGHEST)
    series = read_series(table.file, table.time, [column], table.skip, time_key="time")
    notes = list(whole(series, duration, "time").notes)
    interval = float(np.median(np.diff(series.time)))
    time, values, there = _evenly(series, interval, duration, notes)
    if time.size < _FEWEST or not np.ptp(values):
        text = f"{table.value} has {time.size} samples from {values.min():g} to {values.max():g} m"
        raise refusal("value", text, f"have {_FEWEST} or more that differ")
    about = SeaStatistics.of_record(values, interval)
    rate, period = 1 / interval, about.peak_period
    if table.cut_hz is not None and table.cut_hz >= rate / 2:
        must = f"be below {rate / 2:.6g} (Hz), half the rate of the record"
        raise refusal("cut_hz", got(table.cut_hz, must))
    near = np.abs(time - duration / 2) <= duration / 2 + _MARGIN * period
    frequency, found = _harmonics(values, near, there, interval, period)
    mean, found, frequency = found[0].real, found[1:], frequency[1:]
    time, values, there = time[near], values[near] - mean, there[near]
    variance = np.abs(found) ** 2
    most = frequency[np.searchsorted(np.cumsum(variance), _NEARLY_ALL * variance.sum())]
    cut = table.cut_hz or min(rate / 2, max(SPECTRUM_HIGHEST / period, float(most)))
    size = np.abs(found) * (frequency <= cut * (1 + 1e-9))
    order = np.argsort(size)
    kept = np.sort(order[np.cumsum(size[order]) >= _LEFT_OUT * about.height])
    if not kept.size:
        must = f"be above those of the longest waves; their peak has {1 / period:.3g} (Hz)"
        raise refusal("cut_hz", got(cut, must))
    if kept.size > _MOST:
        hint = "Lower it, or simulation.duration."
        raise refusal(
            "cut_hz", f"{kept.size} components reach {cut:.4g} Hz", f"be at most {_MOST}", hint
        )
    rates = 2 * np.pi * frequency[kept]
    phases = (rates * time[0] - np.angle(found[kept])) / (2 * np.pi)
    given = {"amplitudes": size[kept], "frequencies": rates, "phases": phases}
    run = (time >= 0) & (time <= duration) & there
    away = at_gauge(time[run], *given.values()) - values[run]
    statistics = SeaStatistics.of_record(values, interval)
    above, slow = (
        variance[which].sum() / variance.sum()
        for which in (frequency > cut, frequency < 1 / (3 * period))
    )
    notes += [
        f"{short(table.file)}: {statistics}, during the run and up to {_MARGIN * period:.3g} s "
        f"before and after it; its mean of {mean:.3g} m is left out",
        f"{kept.size} components up to {cut:.3g} Hz differ from it by "
        f"{np.sqrt(np.mean(away**2)):.2g} m RMS and {np.abs(away).max():.2g} m at most during the "
        f"run; {above:.2%} of its variance is above that frequency and left out",
    ]
    if slow > 0.01:
        text = f"{slow:.0%} of its variance is slower than {3 * period:.3g} s and moves the water "
        notes.append(text + "as long waves: filter a tide out of the record")
    record = Series(time, values[:, None], ())
    return Sea(short(table.file), statistics, given, record, tuple(notes))


def at_gauge(
    time: Float[np.ndarray, " time"],
    amplitudes: Float[np.ndarray, " m"],
    frequencies: Float[np.ndarray, " m"],
    phases: Float[np.ndarray, " m"],
) -> Float[np.ndarray, " time"]:
    """Return the elevation of components (m, rad/s, turns) at the gauge at times of the run (s)."""
    found = np.zeros(time.size)
    for amplitude, rate, phase in zip(amplitudes, frequencies, phases, strict=True):
        found += amplitude * np.cos(2 * np.pi * phase - rate * time)
    return found


def _evenly(
    series: Series, interval: float, duration: float, notes: list[str]
) -> tuple[Float[np.ndarray, " time"], Float[np.ndarray, " time"], Bool[np.ndarray, " time"]]:
    """Return even times of a record about a run, its values, and which of them are measured.

    It is as long before and after the run as that, where the file has it.
    """
    reach = max(duration, _LEAST * interval)
    part = (series.time >= -reach) & (series.time <= duration + reach)
    time, values = series.time[part], series.values[part, 0]
    steps = np.diff(time)
    if np.abs(steps / interval - 1).max() <= _EVEN:
        return time, values, np.full(time.size, True)
    from scipy.interpolate import CubicSpline  # slow to load, and few scenarios need it

    even = np.arange(time[0], time[-1] + _EVEN, interval)
    notes.append(
        f"samples are {steps.min():.4g} to {steps.max():.4g} s apart: a spline through them is "
        f"sampled every {interval:.4g} s"
    )
    after = np.searchsorted(time, even).clip(1, time.size - 1)
    there = np.minimum(time[after] - even, even - time[after - 1]) < 0.99 * interval
    whole = np.where(there, CubicSpline(time, values)(even), np.interp(even, time, values))
    return even, whole, there


def _harmonics(
    values: Float[np.ndarray, " time"],
    near: Bool[np.ndarray, " time"],
    there: Bool[np.ndarray, " time"],
    interval: float,
    period: float,
) -> tuple[Float[np.ndarray, " f"], Complex[np.ndarray, " f"]]:
    """Return frequencies (Hz) and complex amplitudes of the values that are ``near``.

    The first one is their mean. Values that are not ``there`` do not count; the peak ``period``
    and the ``interval`` are in s.
    """
    from scipy.fft import next_fast_len  # slow to load, and few scenarios need it
    from scipy.signal import welch
    from scipy.sparse.linalg import LinearOperator, cg

    segment = min(values.size, int(_WINDOW * period / interval))
    spectrum = welch(values, 1 / interval, nperseg=segment)
    values, there = values[near], there[near]
    mean, count = values[there].mean(), values.size
    length = next_fast_len(int(count + _BEYOND * period / interval), real=True)
    frequency = np.fft.rfftfreq(length, interval)
    # the variance of each harmonic, and of a mean that is as uncertain as the sea is high
    prior = np.interp(frequency, *spectrum)
    prior += _FLOOR * prior.max()
    prior[0] = prior.max() * length
    noise = _NOISE**2 * prior[1:].mean()
    nearby = np.interp(np.fft.rfftfreq(count, interval), frequency, prior) + noise

    def covariance(weights: np.ndarray) -> np.ndarray:
        spread = np.fft.irfft(prior * np.fft.rfft(weights * there, length), length)[:count]
        return spread * there + noise * weights

    def inverse(weights: np.ndarray) -> np.ndarray:
        return np.fft.irfft(np.fft.rfft(weights) / nearby, count)

    square = (count, count)
    nearly = LinearOperator(square, inverse, dtype=float)
    about = np.where(there, values - mean, 0.0)
    whole = LinearOperator(square, covariance, dtype=float)
    weights, _ = cg(whole, about, rtol=1e-8, maxiter=2000, M=nearly)
    found = 2 / length * prior * np.fft.rfft(weights * there, length)
    found[0] = 0.5 * found[0] + mean
    return frequency, found
