"""Charts of the tip's error, and its spectrum."""

from dataclasses import replace
from typing import Literal

import numpy as np
import xarray as xr
from jaxtyping import Float

from crinoid.foundation.axes import AXES
from crinoid.numerics.signals_and_systems import spectrum
from crinoid.results.metrics import angle_between, short_way
from crinoid.view.figures.charts import chart
from crinoid.view.figures.run import Run
from crinoid.view.figures.style import DEGREES, Unit, largest, length_unit, si_unit
from crinoid.view.scene.data import in_space
from crinoid.view.scene.mount import Path

_ROOM = 1.08  # of an axis, above the largest value
_ERROR = chart.Panel("tip_error", "tip error", low=0.0, tall=2.25, columns=1)
_MISS = chart.Panel("tip_miss", "tip \N{MINUS SIGN} target", levels=chart.ZERO, tall=2.25)
_DIRECTION = chart.Panel(
    "tip_direction", "tip direction", levels=chart.ZERO, low=-_ROOM, high=_ROOM, tall=2.0
)
_OFF = chart.Panel("tip_off_direction", "tip off\ndirection", DEGREES, low=0.0, tall=1.8, columns=1)
_WATER = chart.Panel("tip_water", "water speed\nat tip", Unit(1.0, "m/s"), tall=1.45)
_SPECTRUM = chart.Panel("tip_spectrum", "density of\nthe tip's error", tall=2.6)
_LEAST_RECORDS = 16
_DECADES = 6  # of the spectral density, from its top


Frequencies = Float[np.ndarray, " frequency"]


def miss(data: xr.Dataset) -> Path:
    """Return the displacement of the tip from its target (m)."""
    return in_space(data, "tip_position") - in_space(data, "tip_target")


def error_spectrum(time: chart.Series, off: Path) -> tuple[Frequencies, Frequencies] | None:
    """Return frequencies (Hz) and the one-sided density (m2/Hz) of the error's fluctuation.

    The sum over the components, by Welch's method; None if the run is too short. The last instant
    is left out if its interval differs from the others.
    """
    if time.size < _LEAST_RECORDS:
        return None
    interval = float(time[1] - time[0])
    even = np.isclose(np.diff(time), interval, rtol=1e-3)
    count = time.size if even.all() else int(np.argmin(even)) + 1
    if count < _LEAST_RECORDS or not np.isfinite(off[:count]).all():
        return None
    found = spectrum(off[:count, None, :], interval)
    return found.frequency, np.asarray(found.density.sum(axis=(1, 2)))


def spectrum_chart(run: Run) -> chart.Chart:
    """Return the chart of the spectral density of the tip's error."""
    return chart.Chart("spectrum", "Error over frequency (Hz)", (spectrum_panel(run),))


def spectrum_panel(run: Run) -> chart.Panel:
    """Return the spectral density of the tip's error, with and without control."""
    found = [error_spectrum(data["time"].values, miss(data)) for _, data in run.members]
    known = [each for each in found if each is not None]
    top = largest(*(density for _, density in known))
    if not known or top == 0.0:
        words = "the tip never errs" if known else "too short for a spectrum"
        return replace(_SPECTRUM, nothing=words)
    squares = length_unit(top**0.5)
    traces = []
    for (who, _), each, role in zip(run.members, found, chart.MEMBER_ROLES, strict=False):
        if each is not None:
            frequency, density = each
            values = np.where(density > 0.0, density, np.nan)
            behind = role == "free"
            traces.append(chart.Trace(who or "tip error", frequency, values, role, behind=behind))
    seen = [f[density > top / 10**_DECADES] for f, density in known]
    unit, low = Unit(squares.factor**2, f"{squares.name}²/Hz"), top / 10**_DECADES
    over = min(float(f[0]) for f, _ in known), 1.3 * max(float(f[-1]) for f in seen if f.size)
    return replace(_SPECTRUM, unit=unit, traces=tuple(traces), low=low, high=3 * top, over=over)


def tip_chart(run: Run) -> chart.Chart:
    """Return errors of the tip's position and direction, and the water's speed at the tip.

    In space also the tip's direction.
    """
    spatial = "tip_direction" in run.result
    panels = [_error(run), _components(run)]
    panels += [_direction(run.result)] if spatial else []
    return chart.Chart("tip_error", "Tip", (*panels, _off_direction(run), _speed(run.result)))


def _error(run: Run) -> chart.Panel:
    unit = length_unit(largest(*(data["tip_error"].values for _, data in run.members)))
    traces, levels = [], []
    # the run without control is drawn behind, as the reference
    for (label, data), role in zip(run.members, chart.MEMBER_ROLES, strict=False):
        values, mean = data["tip_error"].values, chart.rms(data["tip_error"].values)
        summary = f"RMS {unit.text(mean)} (dashed), maximum {unit.text(largest(values))}"
        behind = role == "free"
        traces.append(chart.Trace(label, _time(data), values, role, behind=behind, summary=summary))
        levels.append(chart.Level(mean, role, "dashed"))
    high = None if largest(run.result["tip_error"].values) > 0 else 1.0 / unit.factor
    return replace(_ERROR, unit=unit, traces=tuple(traces), levels=tuple(levels), high=high)


def _components(run: Run) -> chart.Panel:
    misses = [
        (label, data, data["tip_position"].values - data["tip_target"].values)
        for label, data in run.members
    ]
    unit = length_unit(largest(*(miss for _, _, miss in misses)))
    traces = []
    for label, data, miss in misses:
        behind = label == "without control"
        for part, axis in enumerate(map(str, data["axis"].values)):
            name = f"{axis}, {label}" if label else axis
            traces.append(chart.Trace(name, _time(data), miss[:, part], axis, behind=behind))
    columns = 2 if len(misses) > 1 else len(AXES[3])
    return replace(_MISS, unit=unit, traces=tuple(traces), columns=columns)


def _direction(data: xr.Dataset) -> chart.Panel:
    aimed, traces = "tip_direction_target" in data, []
    for axis in AXES[3]:
        part = data["tip_direction"].sel(axis=axis).values
        traces.append(chart.Trace(axis, _time(data), part, axis))
        if aimed:
            wanted = data["tip_direction_target"].sel(axis=axis).values
            words = f"{axis}, where it should"
            traces.append(chart.Trace(words, _time(data), wanted, axis, "dashed", quiet=True))
    also: tuple[tuple[str, Literal["dashed"]], ...] = (("where it should", "dashed"),)
    return replace(_DIRECTION, traces=tuple(traces), also=also if aimed else ())


def _off_direction(run: Run) -> chart.Panel:
    traces = []
    for (label, data), role in zip(run.members, chart.MEMBER_ROLES, strict=False):
        off = off_direction(data)
        if off is not None:
            summary = f"RMS {DEGREES.text(chart.rms(off))}, maximum {DEGREES.text(largest(off))}"
            behind = role == "free"
            traces.append(
                chart.Trace(label, _time(data), off, role, behind=behind, summary=summary)
            )
    high = _ROOM * largest(*(trace.values for trace in traces)) or 1.0 / DEGREES.factor
    nothing = "" if traces else "no direction recorded"
    return replace(_OFF, traces=tuple(traces), high=high, nothing=nothing)


def off_direction(data: xr.Dataset) -> Float[np.ndarray, " time"] | None:
    """Return the angle (rad) between the tip's direction and its target; None without one."""
    if {"tip_direction", "tip_direction_target"} <= set(data):
        return angle_between(data["tip_direction"].values, data["tip_direction_target"].values)
    if {"tip_angle", "tip_angle_target"} <= set(data):
        return np.abs(short_way(data["tip_angle"].values - data["tip_angle_target"].values))
    return None


def _speed(data: xr.Dataset) -> chart.Panel:
    if "flow_velocity" not in data:
        return replace(_WATER, nothing="no flow recorded")
    speed = np.linalg.norm(data["flow_velocity"].isel(node=-1).values, axis=-1)
    top = largest(speed)
    summary = f"mean {si_unit(1.0, 'm/s').text(float(np.nanmean(speed)))}"
    traces = (chart.Trace("", _time(data), speed, "ink", summary=summary),)
    high, nothing = _ROOM * top or 1.0, "" if top else "still water"
    return replace(_WATER, traces=traces, low=0.0, high=high, nothing=nothing)


def _time(data: xr.Dataset) -> Float[np.ndarray, " time"]:
    return np.asarray(data["time"].values, float)
