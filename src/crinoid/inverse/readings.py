"""Recorded readings of sensors, commands and states of actuators, from a table or a result."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import numpy as np
import xarray as xr
from jaxtyping import Float, Int

from crinoid.actuation import Input
from crinoid.control import Sensor
from crinoid.inverse.commands import Commands, commands_of
from crinoid.recording.logs import is_bag
from crinoid.recording.numbers import Column
from crinoid.recording.readers import read_dataset
from crinoid.recording.series import read_series
from crinoid.recording.texts import listed
from crinoid.recording.units import angle_factor, length_factor
from crinoid.results.result import RESULT, Result, ResultError, attributes
from crinoid.scenario import Mistake, Scenario, ScenarioError, refusal
from crinoid.scenario.sensor import Sampling

TIME = "time"
"""Column of a record."""
_STATE = "state"
"""Ending of the columns with measured states of actuators."""
_LARGEST = 1e12
"""Larger numbers mark missing values."""


class Readings(NamedTuple):
    """Readings of a sensor, each with at least one value."""

    time: Float[np.ndarray, " row"]
    """Times of the measurements (s), increasing."""
    values: Float[np.ndarray, "row value"]
    """Values in SI units; nan where one is missing."""

    @staticmethod
    def of(time: Float[np.ndarray, " row"], values: Float[np.ndarray, "row value"]) -> Readings:
        """Leave out rows without any value."""
        there = np.isfinite(values).any(axis=1)
        return Readings(time[there], values[there])


class ReadingRecord(NamedTuple):
    """A log of an experiment, as an observer reads it."""

    readings: tuple[Readings | None, ...]
    """Those of each sensor of the scenario, that of the tip first; None if the log has none."""
    commands: Commands | None
    states: dict[str, Readings]
    """Measured drives of actuators by the names of their inputs, those of the base included."""
    notes: tuple[str, ...]

    @property
    def ends(self) -> tuple[float, float]:
        """First and last time of a reading (s)."""
        times = [each.time for each in self.readings if each is not None]
        return min(time[0] for time in times), max(time[-1] for time in times)


def read_readings(
    path: Path, scenario: Scenario, sensors: Sequence[Sensor], inputs: Sequence[Input]
) -> ReadingRecord:
    """Read a log: a table, or the readings and commands in a result.

    A table has a column ``time``. The values of the tip are `crinoid.foundation.axes.POSE`, those
    of another sensor its name, a dot and the name of the value. Commands have the names of their
    inputs, measured states of actuators that name and ``.state``.

    Raises
    ------
    ScenarioError
        If the file cannot be read or has no reading of a sensor of the scenario.
    """
    with record_errors():
        if folder := result_folder(path):
            return _of_result(Result.load(folder), scenario, sensors, inputs)
        return _of_table(str(path), scenario, sensors, inputs)


def _columns(scenario: Scenario, sensors: Sequence[Sensor]) -> list[list[Column]]:
    """Return the columns of each sensor."""
    axes = scenario.arm.dimension
    found = []
    for index, sensor in enumerate(sensors):
        names = sensor.measurand.names(axes)
        before = f"{sensor.name}." if index else ""
        found.append([column_of(f"{before}{name}", unit) for name, unit in names])
    return found


def _of_table(
    file: str, scenario: Scenario, sensors: Sequence[Sensor], inputs: Sequence[Input]
) -> ReadingRecord:
    columns = _columns(scenario, sensors)
    every = [column for some in columns for column in some]
    with read_dataset(file) as dataset:
        there = [str(name) for name in dataset.variables]
    measured = [column for column in every if column.name in there]
    if not measured:
        names = ", ".join(column.name for column in every)
        raise refusal("file", f"has {listed(sorted(there))}", f"have {TIME} and some of {names}")
    series = read_series(file, TIME, measured, 0.0, gaps=True)
    values = dict(zip((column.name for column in measured), series.values.T, strict=True))
    nothing = np.full(series.time.size, np.nan)
    readings = []
    for some in columns:
        of_sensor = np.stack([values.get(column.name, nothing) for column in some], axis=1)
        found = Readings.of(series.time, of_sensor)
        readings.append(found if found.time.size else None)
    driven = [column_of(each.name, each.unit) for each in inputs]
    played = [column for column in driven if column.name in there]
    parts = [read_series(file, TIME, played, 0.0)] if played else []
    notes = [*series.notes, *(note for part in parts for note in part.notes)]
    states = {}
    for each in inputs:
        column = column_of(f"{each.name}.{_STATE}", each.unit)
        if column.name in there:
            state = read_series(file, TIME, [column], 0.0)
            states[each.name] = Readings(state.time, state.values)
            notes += state.notes
    known = {TIME, *(column.name for column in (*measured, *played))}
    known |= {f"{name}.{_STATE}" for name in states}
    if others := [name for name in there if name not in known]:
        notes.append(f"not read: {listed(others)}")
    commands = Commands.of(parts, [driven.index(column) for column in played], len(inputs))
    return ReadingRecord(tuple(readings), commands, states, tuple(dict.fromkeys(notes)))


def _of_result(
    result: Result, scenario: Scenario, sensors: Sequence[Sensor], inputs: Sequence[Input]
) -> ReadingRecord:
    data, ran = result.dataset, result.scenario
    if ran.arm.dimension != scenario.arm.dimension:
        text = f"the arm has {ran.arm.dimension} axes; must have {scenario.arm.dimension}"
        raise ScenarioError.of("file", text)
    rows = {str(name): row for row, name in enumerate(data["reading"].values)}
    tables: dict[str, Sampling] = {each.called: each for each in ran.sensors}
    readings: list[Readings | None] = []
    for sensor in sensors:
        table = tables.get(sensor.name, ran.sensor if sensor is sensors[0] else None)
        names = [f"{sensor.name}.{name}" for name, _ in sensor.measurand.names(ran.arm.dimension)]
        if table is None or not set(names) <= set(rows):
            readings.append(None)
            continue
        time, instants = sampled(data, ran, table)
        values = data["sensor_reading"].values[instants][:, [rows[name] for name in names]]
        readings.append(Readings.of(time, values))
    if not any(each is not None and each.time.size for each in readings):
        raise ScenarioError.of("file", "the run has no reading of a sensor of the scenario")
    return ReadingRecord(tuple(readings), commands_of(result, inputs), {}, ())


@contextmanager
def record_errors() -> Iterator[None]:
    """Raise the mistakes of a record under the name RECORD."""
    try:
        yield
    except ResultError as error:
        raise ScenarioError.of("RECORD", str(error)) from error
    except ScenarioError as error:
        mistakes = [Mistake("RECORD", mistake.text) for mistake in error.mistakes]
        raise ScenarioError(mistakes) from error


def result_folder(path: Path) -> Path | None:
    """Return the folder of a result of crinoid; None if the path is of another file."""
    if path.is_dir():
        return None if is_bag(path) else path
    return path.parent if path.name == RESULT and attributes(path) else None


def sampled(
    data: xr.Dataset, scenario: Scenario, sensor: Sampling
) -> tuple[Float[np.ndarray, " sample"], Int[np.ndarray, " sample"]]:
    """Return the times (s) at which a sensor measured, and the saved instants that first know."""
    time, step = data["time"].values, scenario.simulation.time_step
    period = 1 / scenario.rate_hz(sensor.rate_hz)
    # a sample is taken at the first time step at or after a tick
    ticks = np.arange(int(time[-1] / period + 2)) * period
    samples = step * np.ceil(ticks / step - 1e-6)
    newest = np.searchsorted(samples, time - max(step, sensor.delay) + 1e-6 * step) - 1
    rows = np.flatnonzero(newest >= 0)
    times, first = np.unique(samples[newest[rows]], return_index=True)
    return times, rows[first]


def column_of(name: str, unit: str) -> Column:
    """Return the column of a quantity; without a unit in the file angles are in degrees."""
    known = {"m": (length_factor, "m"), "rad": (angle_factor, "degrees")}
    factor, written = known.get(unit, ({unit: 1.0}.get, unit))
    return Column(name, name, factor, written, _LARGEST)
