"""Recorded motions of the tip, with their commands, and checks of their frame and markers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import xarray as xr
from jaxtyping import Bool, Float

from crinoid.actuation import Input
from crinoid.foundation.axes import POSE
from crinoid.recording.opening import opened
from crinoid.recording.series import Column, read_series
from crinoid.recording.table import angle_factor, length_factor, listed
from crinoid.results.result import RESULT, Result, ResultError, attributes
from crinoid.scenario import Mistake, ScenarioError

TIME = "time"
_LARGEST = 1e12
"""Larger numbers mark missing values."""
LOST = 0.25
"""Largest share of the rows that may be set aside as lost markers."""
_REACH = 1.25
"""Largest distance of a record from the root, over the arm's length in the run."""
_STUCK = 0.02
"""Path of the tip in the run, over the arm's length, along which a resting marker is stuck."""
_CLEARLY = 0.2
"""Largest distance of another reading from the run, over that of the record and the length."""

Places = Float[np.ndarray, "time axis"]


class Commands(NamedTuple):
    """Recorded commands, each valid until the time of the next."""

    time: Float[np.ndarray, " row"]
    values: Float[np.ndarray, "row input"]


@dataclass(frozen=True)
class RecordedMotion:
    """Measured motion of the tip."""

    time: Float[np.ndarray, " time"]
    """Times (s) since the start of the run, increasing."""
    names: tuple[str, ...]
    """Measured coordinates of the tip (`crinoid.foundation.axes.POSE`)."""
    values: Float[np.ndarray, "time quantity"]
    """Values of the coordinates in the world (m; rad; components of a unit vector)."""
    commands: Commands | None
    """Commands of all inputs (m, rad, or in their units); None without recorded ones."""
    notes: tuple[str, ...] = ()
    """Notes on assumptions and omitted rows."""


def read_record(path: Path, axes: int, inputs: Sequence[Input]) -> RecordedMotion:
    """Read a record: a table, or the sensor readings in a result, for an arm of some axes.

    A table is a CSV or netCDF file with a column ``time`` and some of
    `crinoid.foundation.axes.POSE` and of the names of the inputs. A result is given by its folder
    or its ``result.nc``.
    """
    try:
        if path.is_dir() or (path.name == RESULT and attributes(path)):
            return _of_result(path if path.is_dir() else path.parent, axes, inputs)
        return _of_table(str(path), axes, inputs)
    except ResultError as error:
        raise ScenarioError.of("RECORD", str(error)) from error
    except ScenarioError as error:
        mistakes = [Mistake("RECORD", mistake.text) for mistake in error.mistakes]
        raise ScenarioError(mistakes) from error


def _of_table(file: str, axes: int, inputs: Sequence[Input]) -> RecordedMotion:
    columns = [_column(name, "rad" if name == "angle" else "m") for name in POSE[axes][:axes]]
    columns += [_column(name, "rad" if axes == 2 else "1") for name in POSE[axes][axes:]]
    driven = [_column(each.name, each.unit) for each in inputs]
    with opened(file, TIME) as dataset:
        there = {str(name) for name in dataset.variables}
    measured = [column for column in columns if column.name in there]
    played = [column for column in driven if column.name in there]
    if not measured:
        text = f"has {listed(sorted(there))}; must have time and some of {', '.join(POSE[axes])}"
        raise ScenarioError.of("file", text)
    motion = read_series(file, TIME, measured, 0.0)
    commands = None
    notes = motion.notes
    if played:
        series = read_series(file, TIME, played, 0.0)
        values = np.zeros((series.time.size, len(inputs)))
        values[:, [driven.index(column) for column in played]] = series.values
        commands = Commands(series.time, values)
        notes = tuple(dict.fromkeys((*notes, *series.notes)))
    names = tuple(column.name for column in measured)
    return _after_start(RecordedMotion(motion.time, names, motion.values, commands, notes))


def _after_start(record: RecordedMotion) -> RecordedMotion:
    """Remove rows before the start of the run, and refuse a record without later rows."""
    if record.time[-1] <= 0:
        text = f"ends at {record.time[-1]:.6g} s of the run; must have times after 0"
        raise ScenarioError.of("file", text)
    after = record.time >= 0
    if after.all():
        return record
    note = f"{int((~after).sum())} rows before the start of the run are left out"
    notes = (*record.notes, note)
    return replace(record, time=record.time[after], values=record.values[after], notes=notes)


def _column(name: str, unit: str) -> Column:
    if unit == "m":
        return Column(name, name, length_factor, "m", _LARGEST)
    if unit == "rad":
        return Column(name, name, angle_factor, "degrees", _LARGEST)
    return Column(name, name, lambda units: 1.0 if units.strip() == unit else None, unit, _LARGEST)


def _of_result(folder: Path, axes: int, inputs: Sequence[Input]) -> RecordedMotion:
    """Return the readings of the tip in a result, at the times of their measurement."""
    result = Result.load(folder)
    data, scenario = result.dataset, result.scenario
    if scenario.arm.dimension != axes:
        text = f"{folder}: the arm has {scenario.arm.dimension} axes; must have {axes}"
        raise ScenarioError.of("file", text)
    columns = {str(name): row for row, name in enumerate(data["reading"].values)}
    names = tuple(name for name in POSE[axes] if f"tip.{name}" in columns)
    time, step = data["time"].values, scenario.simulation.time_step
    period = 1 / scenario.sensor_rate_hz
    # a sample is taken at the first time step at or after a tick
    ticks = np.arange(int(time[-1] / period + 2)) * period
    samples = step * np.ceil(ticks / step - 1e-6)
    newest = np.searchsorted(samples, time - max(step, scenario.sensor.delay) + 1e-6 * step) - 1
    rows = np.flatnonzero(newest >= 0)
    times, first = np.unique(samples[newest[rows]], return_index=True)
    if times.size < 2:
        text = f"{folder}: the run has {times.size} readings of the tip; must have at least 2"
        raise ScenarioError.of("file", text)
    readings = data["sensor_reading"].values[rows[first]]
    values = readings[:, [columns[f"tip.{name}"] for name in names]]
    return RecordedMotion(times, names, values, _commands(result, step, inputs))


def _commands(result: Result, step: float, inputs: Sequence[Input]) -> Commands | None:
    data = result.dataset
    if result.scenario.control.kind == "none":
        return None
    rows = _by_name(data, "base_command", "channel")
    if "actuator_command" in data:
        rows |= _by_name(data, "actuator_command", "input")
    none = np.zeros(data.sizes["time"])
    values = np.stack([rows.get(each.name, none) for each in inputs], axis=1)
    # a result has the command of a time step at its end
    return Commands(data["time"].values - step, values)


def _by_name(data: xr.Dataset, variable: str, dim: str) -> dict[str, np.ndarray]:
    return dict(zip(map(str, data[dim].values), data[variable].values.T, strict=True))


def within_reach(
    names: Sequence[str], measured: Places, root: Places, tip: Places, length: float
) -> tuple[Bool[np.ndarray, " time"], list[str]]:
    """Return the rows that the arm can reach, and a note if the record fits in another reading.

    Places (m) have the axes ``names``. Root and tip are those of a run whose arm is at most
    ``length`` (m) long.
    """
    inside = np.linalg.norm(measured - root, axis=1) <= _REACH * length
    turned = np.where(np.array(names) == "z", -1.0, 1.0) * measured
    frames: list[tuple[str, Places, Places | float]] = [
        ("all else is right", measured, 0.0),
        ("positions are measured from the base", measured, root),
        ("heights are positive down", turned, 0.0),
        ("positions are measured from the base, positive down", turned, root),
        ("axes are swapped", np.hstack([measured[:, :-2], measured[:, :-3:-1]]), 0.0),
    ]
    frames += [(f"lengths are in mm; {words}", 1e-3 * each, at) for words, each, at in frames]
    distances = [np.median(np.linalg.norm(at + each - tip, axis=1)) for _, each, at in frames]
    best = int(np.argmin(distances))
    near = distances[best] < _CLEARLY * min(distances[0], length)
    hint = f"Likely cause: {frames[best][0]}." if near else ""
    where = _ranges(names, measured)
    if inside.mean() < 1 - LOST:
        text = (
            f"got the tip at {where}; must lie within {_REACH * length:.3g} m of the root at "
            f"{_ranges(names, root)}. {hint or 'Check units, origin, axes and the sign of z.'}"
        )
        raise ScenarioError.of("RECORD", text)
    note = f"the record has the tip at {where}, the run at {_ranges(names, tip)}. {hint}"
    return inside, [note] if hint and distances[0] > _STUCK * length else []


def stuck(measured: Places, tip: Places, length: float) -> Bool[np.ndarray, " time"]:
    """Return the rows of a marker that rests while the tip (m) of the fit moves.

    ``length`` (m) is that of the arm.
    """
    same = np.all(np.diff(measured, axis=0) == 0, axis=1)
    starts = np.flatnonzero(np.append(True, ~same))
    path = np.maximum.reduceat(tip, starts) - np.minimum.reduceat(tip, starts)
    return np.repeat(path.max(axis=1) > _STUCK * length, np.diff(starts, append=len(tip)))


def _ranges(names: Sequence[str], places: Places) -> str:
    ends = zip(names, places.min(axis=0), places.max(axis=0), strict=True)
    return ", ".join(f"{name} = {low:.4g} to {high:.4g} m" for name, low, high in ends)
