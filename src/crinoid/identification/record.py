"""A recorded motion of the tip, and the commands that went with it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from crinoid.actuation import Input
from crinoid.recording.opening import opened
from crinoid.recording.refusal import listed
from crinoid.recording.series import Column, Series, read_series
from crinoid.recording.units import angle_factor, length_factor
from crinoid.result import RESULT, Result, ResultError, attributes
from crinoid.scenario import Mistake, ScenarioError
from crinoid.space import POSE

TIME = "time"
_MOST = 1e12
"""Larger numbers stand for missing values."""


class Commands(NamedTuple):
    """Commands, each from its time until that of the next."""

    time: Float[np.ndarray, " row"]
    values: Float[np.ndarray, "row input"]


@dataclass(frozen=True)
class Record:
    """A motion of the tip as it was measured."""

    time: Float[np.ndarray, " time"]
    """Times (s) since the start of the run, increasing."""
    names: tuple[str, ...]
    """Coordinates of the tip that were measured (`crinoid.space.POSE`)."""
    values: Float[np.ndarray, "time quantity"]
    """Their values in the world (m; rad; components of a unit vector)."""
    commands: Commands | None
    """Commands of all inputs (m, rad, or in their units); None where none were recorded."""
    notes: tuple[str, ...] = ()
    """Notes on what was assumed and left out."""


def read_record(path: Path, axes: int, inputs: Sequence[Input]) -> Record:
    """Read a record: a table of columns, or the readings in a result.

    Parameters
    ----------
    path
        CSV or netCDF file with a column ``time`` and some of `crinoid.space.POSE` and of the names
        of the inputs; or a result, its `result.nc` or the folder of that.
    axes
        Dimension of the arm.
    inputs
        Inputs of the arm.
    """
    try:
        if path.is_dir() or (path.name == RESULT and attributes(path)):
            return _of_result(path if path.is_dir() else path.parent, axes, inputs)
        return _of_table(str(path), axes, inputs)
    except ResultError as error:
        raise ScenarioError([Mistake("RECORD", str(error))]) from error
    except ScenarioError as error:
        mistakes = [Mistake("RECORD", mistake.text) for mistake in error.mistakes]
        raise ScenarioError(mistakes) from error


def _of_table(file: str, axes: int, inputs: Sequence[Input]) -> Record:
    columns = [_column(name, "rad" if name == "angle" else "m") for name in POSE[axes][:axes]]
    columns += [_column(name, "rad" if axes == 2 else "1") for name in POSE[axes][axes:]]
    driven = [_column(each.name, each.unit) for each in inputs]
    with opened(file, TIME) as dataset:
        there = {str(name) for name in dataset.variables}
    measured = [column for column in columns if column.name in there]
    played = [column for column in driven if column.name in there]
    if not measured:
        text = f"has {listed(sorted(there))}, takes time and some of {', '.join(POSE[axes])}"
        raise ScenarioError([Mistake("file", text)])
    motion = read_series(file, TIME, measured, 0.0)
    commands = None
    notes = motion.notes
    if played:
        series = read_series(file, TIME, played, 0.0)
        values = np.zeros((series.time.size, len(inputs)))
        values[:, [driven.index(column) for column in played]] = series.values
        commands = Commands(series.time, values)
        notes = tuple(dict.fromkeys((*notes, *series.notes)))
    return _started(Record(motion.time, _names(measured), motion.values, commands, notes), motion)


def _started(record: Record, motion: Series) -> Record:
    """Refuse a record of which nothing is after the start of the run."""
    if motion.time[-1] <= 0:
        text = f"ends at {motion.time[-1]:.6g} s of the run, takes times after 0"
        raise ScenarioError([Mistake("file", text)])
    after = record.time >= 0
    if after.all():
        return record
    note = f"{int((~after).sum())} rows before the start of the run are left out"
    return Record(
        record.time[after],
        record.names,
        record.values[after],
        record.commands,
        (*record.notes, note),
    )


def _names(columns: list[Column]) -> tuple[str, ...]:
    return tuple(column.name for column in columns)


def _column(name: str, unit: str) -> Column:
    if unit == "m":
        return Column(name, name, length_factor, "m", _MOST)
    if unit == "rad":
        return Column(name, name, angle_factor, "degrees", _MOST)
    return Column(name, name, lambda units: 1.0 if units.strip() == unit else None, unit, _MOST)


def _of_result(folder: Path, axes: int, inputs: Sequence[Input]) -> Record:
    """Return what the sensor of the tip read in a result, at the times when it was measured."""
    result = Result.load(folder)
    data, scenario = result.dataset, result.scenario
    if scenario.arm.dimension != axes:
        text = f"{folder}: the arm has {scenario.arm.dimension} axes, takes {axes}"
        raise ScenarioError([Mistake("file", text)])
    columns = {str(name): row for row, name in enumerate(data["reading"].values)}
    names = tuple(name for name in POSE[axes] if f"tip.{name}" in columns)
    time, step = data["time"].values, scenario.simulation.time_step
    period = 1 / scenario.sensor_rate_hz
    # samples are taken at the first step that begins at or after a tick
    ticks = np.arange(int(time[-1] / period + 2)) * period
    samples = step * np.ceil(ticks / step - 1e-6)
    newest = np.searchsorted(samples, time - max(step, scenario.sensor.delay) + 1e-6 * step) - 1
    rows = np.flatnonzero(newest >= 0)
    taken, first = np.unique(samples[newest[rows]], return_index=True)
    if taken.size < 2:
        text = f"{folder}: the run holds {taken.size} readings of the tip, takes 2 or more"
        raise ScenarioError([Mistake("file", text)])
    readings = data["sensor_reading"].values[rows[first]]
    values = readings[:, [columns[f"tip.{name}"] for name in names]]
    return Record(taken, names, values, _commands(result, step, inputs))


def _commands(result: Result, step: float, inputs: Sequence[Input]) -> Commands | None:
    data = result.dataset
    if result.scenario.control.kind == "none":
        return None
    rows = {str(name): data["base_command"].values[:, at] for at, name in _labels(data, "channel")}
    if "actuator_command" in data:
        given = data["actuator_command"].values
        rows |= {str(name): given[:, at] for at, name in _labels(data, "input")}
    none = np.zeros(data.sizes["time"])
    values = np.stack([rows.get(each.name, none) for each in inputs], axis=1)
    # saved at the end of the step for which it was given
    return Commands(data["time"].values - step, values)


def _labels(data: object, dim: str) -> list[tuple[int, str]]:
    return list(enumerate(map(str, data[dim].values)))  # type: ignore[index]
