"""A record of the sea by itself: speeds, gaps, turbulence, spectrum and tide in numbers."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from jaxtyping import Bool, Float

from crinoid.flow.waves import jonswap
from crinoid.numerics.dispersion import deep_wave_number
from crinoid.numerics.signals_and_systems import Spectrum, integral_time, spectrum, von_karman
from crinoid.recording.series import FilledRecord
from crinoid.results.dataset import described
from crinoid.results.units import round_down

RECORD, HISTOGRAM, SCATTER = "record.nc", "histogram.csv", "scatter.csv"
SEA_KEYS = ("flow.0.significant_height", "flow.0.peak_period", "flow.1.velocity.0")
"""Keys of a scenario with waves and a current after them: columns of a scatter diagram."""

_WINDOW = 600.0  # time (s) over which turbulence is steady enough for statistics
_TURBULENT = 1.0  # interval (s) from which on samples are too far apart for turbulence
_HOLES = 0.05  # largest filled share of a window
_WAVES = (0.05, 0.5)  # frequencies of surface waves (Hz)
_CALM = 0.1  # largest density below half the frequency of the waves, over that at their peak
_GAMMA, _GRAVITY = 3.3, 9.81
TIDAL = 15 * 86400.0
"""Shortest record of a tide (s): half a month parts the two main constituents, M2 and S2."""
NO_MEAN = 0.05  # mean velocity over the RMS speed below which nothing is relative to the mean
_STEADY = 1e-6  # a standard deviation of less than this part of the largest speed is round-off
_APART = 0.3  # smallest share of a constituent that is linearly independent of the others
_BINS, _BINS_OF_SEA = 15, 6  # fewest bins up to the largest speed, height or period
_EDGE = 1e-9  # relative round-off of a value at the edge of a bin

Velocity = Float[np.ndarray, "time component"]
Filled = Bool[np.ndarray, " time"]


def velocity_statistics(velocity: Velocity, axes: Sequence[str]) -> dict[str, Any]:
    """Sum up a velocity (m/s) by names with units: numbers, or arrays with a number by axis."""
    speed, listed = np.linalg.norm(velocity, axis=1), ", ".join(axes)
    return {
        f"mean {listed} (m/s)": velocity.mean(axis=0),
        f"deviation {listed} (m/s)": velocity.std(axis=0),
        "mean speed (m/s)": speed.mean(),
        "median speed (m/s)": np.median(speed),
        "speed, 95 % (m/s)": np.quantile(speed, 0.95),
        "largest speed (m/s)": speed.max(),
    }


def record_statistics(record: FilledRecord, level: int, axes: tuple[str, ...]) -> dict[str, Any]:
    """Sum up a record at one of its levels, by index, from its measured values only.

    By names as in `velocity_statistics`. The principal direction of a record in space counts from x
    towards y; that of one whose axes are east and north clockwise from north. The intensity is the
    median of `turbulence_intensity`, for a fast record only.
    """
    filled = record.filled[:, level]
    velocity = record.velocity[~filled, level]
    found = velocity_statistics(velocity, axes)
    if len(axes) == 3:
        direction, along = principal(velocity)
        degrees = np.rad2deg(direction)
        found["principal direction (deg)"] = (90 - degrees) % 360 if axes[0] == "east" else degrees
        found["mean square along it (%)"] = 100 * along
    intensity = turbulence_intensity(record, level)
    if intensity.size:
        known = intensity[np.isfinite(intensity)]
        found["turbulence intensity (%)"] = 100 * np.median(known) if known.size else np.nan
    there = np.concatenate([record.time[:1], record.time[~filled], record.time[-1:]])
    found["gaps"] = float(np.sum(np.diff(filled.astype(int), prepend=0) > 0))
    found["longest gap (s)"] = np.diff(there).max() if filled.any() else 0
    found["missing (%)"] = 100 * filled.mean()
    return found


def interval_of(record: FilledRecord) -> float:
    """Return the usual interval of a record (s)."""
    return float(np.median(np.diff(record.time)))


def principal(velocity: Velocity) -> tuple[float, float]:
    """Return the horizontal direction with the largest mean square, and its share of the whole.

    In radians from the first component towards the second. Of the two ends of the axis it is the
    one to which the mean velocity points. In the plane of an arm the only direction is 0.
    """
    if velocity.shape[1] == 2:
        return 0.0, 1.0
    level = velocity[:, :2]
    squares, axes = np.linalg.eigh(level.T @ level)
    axis = axes[:, 1] * (1.0 if level.mean(axis=0) @ axes[:, 1] >= 0 else -1.0)
    share = squares[1] / squares.sum() if squares.any() else np.nan
    return float(np.arctan2(axis[1], axis[0])), float(share)


def turbulence_intensity(record: FilledRecord, level: int) -> Float[np.ndarray, " window"]:
    """Return the turbulence intensity of each ten minutes of a record.

    That is the standard deviation of the component along the mean velocity over its size (Thomson
    et al., Measurements of turbulence at two tidal energy sites in Puget Sound, IEEE J. Ocean. Eng.
    37 (2012) 363-374). Noise of the instrument counts too. A record of less than ten minutes is one
    window; samples 1 s apart or more give none, and a window without a mean not a number.
    """
    if interval_of(record) >= _TURBULENT:
        return np.zeros(0)
    windows = _windows(record.velocity[:, level], record.filled[:, level], interval_of(record))
    mean = windows.mean(axis=1)
    size = np.linalg.norm(mean, axis=1)
    size[size <= NO_MEAN * np.sqrt(np.sum(windows**2, axis=2).mean(axis=1))] = np.nan
    return np.einsum("wtc,wc->wt", windows, mean / size[:, None]).std(axis=1) / size


def _windows(
    velocity: Velocity, filled: Filled, interval: float
) -> Float[np.ndarray, "window sample component"]:
    """Return the ten minutes of a fast record with few gaps, or all; a slow record as a whole."""
    length = len(velocity)
    if interval < _TURBULENT:
        length = min(length, round(_WINDOW / interval))
    count = len(velocity) // length
    parts = velocity[: count * length].reshape(count, length, -1)
    sound = filled[: count * length].reshape(count, length).mean(axis=1) <= _HOLES
    return parts[sound] if sound.any() else parts


def histogram(
    speed: Float[np.ndarray, " time"],
) -> tuple[Float[np.ndarray, " bin"], Float[np.ndarray, " bin"]]:
    """Return the centres of bins of speed (m/s), of a round width, and their shares of time."""
    most = float(speed.max()) or 1.0
    width = round_down(most / _BINS)
    count = int(most / width) + 1
    shares = np.bincount((speed / width).astype(int), minlength=count) / speed.size
    return width * (np.arange(shares.size) + 0.5), shares


def scatter(
    values: Float[np.ndarray, "time quantity"],
) -> tuple[Float[np.ndarray, "bin quantity"], Float[np.ndarray, " bin"]]:
    """Return the centres of occupied bins of positive values, of round widths, and their shares."""
    widths = [round_down((float(most) or 1.0) / _BINS_OF_SEA) for most in values.max(axis=0)]
    places = np.floor(values / widths * (1 + _EDGE)).astype(int)
    cells, counts = np.unique(places, axis=0, return_counts=True)
    return (cells + 0.5) * widths, counts / len(values)


def record_spectrum(
    record: FilledRecord, level: int
) -> tuple[Spectrum, Float[np.ndarray, " frequency"] | None, str]:
    """Return the spectrum of a record, a model of that along its principal direction, and its name.

    Components are along, across and up; in the plane of an arm x and z. Where waves of 2 to 20 s
    dominate, the model is that of a JONSWAP sea of the same peak and variance (Hasselmann et al.
    1973) in deep water, at the height of the level. Other records with samples less than 1 s apart
    have von Karman's spectrum of the same standard deviation and integral time, over ten minutes.
    """
    count, interval = record.time.size, float(record.time[-1]) / (record.time.size - 1)
    even = interval * np.arange(count)
    velocity = np.stack([np.interp(even, record.time, c) for c in record.velocity[:, level].T], 1)
    filled = record.filled[:, level]
    direction, _ = principal(velocity[~filled])
    if velocity.shape[1] == 3:
        sine, cosine = np.sin(direction), np.cos(direction)
        turn = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
        velocity = velocity @ turn
    if interval < _TURBULENT:
        windows = _windows(velocity, filled, interval)
        found = spectrum(np.moveaxis(windows, 0, 1), interval)
    else:
        windows = velocity[None]
        found = spectrum(velocity[:, None], interval, filled)
    found = found._replace(density=found.density.mean(axis=1))
    height = 0.0 if record.levels is None else float(record.levels[level])
    sea = _sea(found.frequency, found.density[:, 0], height)
    if sea is not None:
        return found, sea, "JONSWAP sea of the same peak and variance"
    along = windows[..., 0]
    if interval >= _TURBULENT or (along.std(axis=1) <= _STEADY * np.abs(along).max()).any():
        return found, None, ""
    times = [integral_time(series, interval) for series in along]
    mean = windows.mean(axis=(0, 1))
    share = float(mean[0] ** 2 / (mean @ mean)) if mean.any() else 1.0
    deviation = float(np.sqrt(along.var(axis=1).mean()))
    passing = 2 * float(np.mean(times)) / (1 + share)  # across the mean an eddy is half as long
    model = von_karman(found.frequency, deviation, passing, share)
    return found, model, "von Karman of the same deviation and integral time"


def _sea(
    frequency: Float[np.ndarray, " f"], density: Float[np.ndarray, " f"], height: float
) -> Float[np.ndarray, " f"] | None:
    """Return the spectrum of the velocity of a JONSWAP sea; None where no waves dominate."""
    peak = float(frequency[np.argmax(density)])
    waves = (frequency >= _WAVES[0]) & (frequency <= _WAVES[1])
    below = density[frequency < peak / 2]
    if not _WAVES[0] <= peak <= _WAVES[1] or below.size == 0:
        return None
    if density[waves].sum() <= density.sum() / 2 or below.mean() > _CALM * density.max():
        return None
    rate = 2 * np.pi * frequency
    decay = np.exp(2 * deep_wave_number(rate, _GRAVITY) * min(height, 0.0))
    model = jonswap(frequency / peak, _GAMMA) * rate**2 * decay
    return model * density[waves].sum() / model[waves].sum()


class Tide(NamedTuple):
    """Harmonic constituents of a record, the strongest first."""

    share: float  # share of the horizontal variance that they explain; NaN of a steady record
    names: list[str]
    amplitude: Float[np.ndarray, " constituent"]
    """Semi-major axis of the ellipse of the velocity (m/s)."""
    phase: Float[np.ndarray, " constituent"]
    """Phase lag (degrees): of Greenwich, or, for a record without a date, of its first sample."""


def tide(
    record: FilledRecord, level: int, start: np.datetime64 | None, latitude: float | None
) -> Tide:
    """Analyse the tide of a record by harmonic constituents (D. L. Codiga's UTide, 2011).

    Means over ten minutes, without filled values, are analysed. The constituents are those that the
    length, the interval and the gaps of the record can tell apart; none of a steady record. Nodal
    corrections need the date of the first sample and the latitude (degrees).

    Raises
    ------
    ImportError
        If utide is not installed.
    """
    import utide

    measured = ~record.filled[:, level]
    bins = (record.time[measured] / max(_WINDOW, interval_of(record))).round().astype(int)
    _, place, count = np.unique(bins, return_inverse=True, return_counts=True)
    columns = [record.time, *record.velocity[:, level].T]
    time, *parts = (np.bincount(place, column[measured]) / count for column in columns)
    level_parts = parts[: len(parts) - 1]  # the last one is up
    values = np.column_stack(level_parts)
    interval = float(np.median(np.diff(time)))
    steady = bool(values.std(axis=0).max() <= _STEADY * np.abs(values).max())
    names = [] if steady else _constituents(time, interval)
    if not names:
        return Tide(np.nan if steady else 0.0, names, np.zeros(0), np.zeros(0))
    days = time / 86400 if start is None else start + (time * 1e6).astype("timedelta64[us]")
    nodal = start is not None and latitude is not None
    found = utide.solve(
        days,
        *level_parts,
        constit=names,
        lat=latitude if nodal else 45.0,
        nodal=nodal,
        epoch="python" if start is None else None,
        phase="raw" if start is None else "Greenwich",
        trend=False,
        conf_int="none",
        verbose=False,
    )
    frequency = 24 * np.asarray(found.aux.frq)  # per day
    angle = 2 * np.pi * np.outer(time / 86400, frequency)
    basis = np.column_stack([np.ones(time.size), np.cos(angle), np.sin(angle)])
    left = values - basis @ np.linalg.lstsq(basis, values)[0]
    phase = np.asarray(found.g)
    if start is None:  # from the middle of the record to its first sample
        phase = phase + 360 * frequency * found.aux.reftime
    return Tide(
        share=1 - float(left.var(axis=0).sum() / values.var(axis=0).sum()),
        names=[str(name) for name in found.name],
        amplitude=np.asarray(found.Lsmaj if len(level_parts) > 1 else found.A),
        phase=phase % 360,
    )


def _constituents(time: Float[np.ndarray, " time"], interval: float) -> list[str]:
    """Return the constituents that samples at these times (s) can tell apart, by importance.

    Two differ by a period over the record (Rayleigh's criterion), those above half the sampling
    rate look like slower ones, and gaps may make others alike.
    """
    from utide import ut_constants

    known, length = ut_constants.const, np.ptp(time) + interval
    apart, rate = known.df / 3600, known.freq / 3600  # from those that matter more; Hz
    order = np.argsort(-apart, kind="stable")
    clear = (apart >= 1 / length) & (rate + 0.5 / length <= 0.5 / interval)
    order = order[clear[order]][: time.size // 4]
    angle = 2 * np.pi * np.outer(time, rate[order])
    basis = np.stack([np.cos(angle), np.sin(angle)], axis=2).reshape(time.size, -1)
    own = np.abs(np.diag(np.linalg.qr(np.column_stack([np.ones(time.size), basis]), mode="r")))[1:]
    sound = own.reshape(-1, 2).min(axis=1) > _APART * np.sqrt(time.size / 2)
    return [str(name) for name in known.name[order[sound]]]


def record_dataset(record: FilledRecord, level: int, axes: tuple[str, ...]) -> xr.Dataset:
    """Return what the figures of a record need, at one of its levels."""
    velocity, filled = record.velocity[:, level], record.filled[:, level]
    speed, shares = histogram(np.linalg.norm(velocity[~filled], axis=1))
    found, model, name = record_spectrum(record, level)
    parts = ["x", "z"] if len(axes) == 2 else ["along", "across", "up"]
    rows = [
        ("velocity", "time axis", "m s-1", velocity, "velocity of the water"),
        ("filled", "time", "1", filled.astype(np.int8), "1 where the file has no value"),
        ("share", "speed", "1", shares, "share of time"),
        ("spectrum", "frequency part", "m2 s-1", found.density,
         "one-sided spectral density of the velocity"),
    ]  # fmt: skip
    coords = [
        ("time", "time", "s", record.time, "time since the first sample"),
        ("axis", "axis", "", list(axes), "component of the velocity"),
        ("speed", "speed", "m s-1", speed, "centre of a bin of speed"),
        ("frequency", "frequency", "Hz", found.frequency, "frequency"),
        ("part", "part", "", parts, "horizontal components by the principal direction"),
    ]
    if model is not None:
        rows.append(("model_spectrum", "frequency", "m2 s-1", model, name))
    if record.levels is not None:
        order = np.argsort(record.levels)
        speeds = np.linalg.norm(record.velocity, axis=2)[:, order]
        speeds = np.where(record.filled[:, order], np.nan, speeds)
        low, high = np.nanquantile(speeds, (0.05, 0.95), axis=0)
        coords.append(("height", "height", "m", record.levels[order], "height z"))
        rows += [
            ("speed_mean", "height", "m s-1", np.nanmean(speeds, axis=0), "mean speed"),
            ("speed_low", "height", "m s-1", low, "speed, 5 % quantile"),
            ("speed_high", "height", "m s-1", high, "speed, 95 % quantile"),
        ]
    dataset = xr.Dataset(described(rows), described(coords))
    if record.levels is not None:
        dataset.attrs["height"] = float(record.levels[level])
    return dataset
