"""Recorded readings of sensors, commands and states of actuators, from a table or a result."""

from __future__ import annotations

from collections.abc import Container, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import numpy as np
import xarray as xr
from jaxtyping import Float, Int

from crinoid.actuation import Input
from crinoid.control import Sensor
from crinoid.inverse.commands import Commands, commands_of
from crinoid.inverse.marker import TIP
from crinoid.recording.axes import find
from crinoid.recording.logs import is_bag
from crinoid.recording.numbers import Column, labels_of
from crinoid.recording.readers import read_dataset
from crinoid.recording.series import read_series
from crinoid.recording.texts import listed
from crinoid.recording.units import angle_factor, length_factor
from crinoid.results.result import RESULT, Result, ResultError, attributes
from crinoid.scenario import Mistake, Scenario, ScenarioError, refusal
from crinoid.scenario.sensor import Sampling

TIME, MARKER = "time", "marker"
"""Columns of a record."""
_STATE = "state"
"""Ending of the columns with measured states of actuators."""
LARGEST = 1e12
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
    commanded: tuple[str, ...]
    """Inputs that have commands; the others are at rest."""
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
    inputs, measured states of actuators that name and ``.state``. With a column ``marker`` the
    rows of the tip count.

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
    driven = [column_of(each.name, each.unit) for each in inputs]
    played = [column for column in driven if column.name in there]
    followed = [(each, column_of(f"{each.name}.{_STATE}", each.unit)) for each in inputs]
    followed = [(each, column) for each, column in followed if column.name in there]
    known = {column.name for column in (*measured, *played, *(column for _, column in followed))}
    with read_dataset(file) as dataset:
        clock = dataset[find(dataset, TIME, "time_column", file)]
        labels = markers_in(dataset, clock)
        notes = not_read(dataset, clock, {MARKER, *known})
    if labels is not None and TIP not in labels:
        raise refusal(MARKER, f"marker has {listed(sorted({*labels}))}", f"have rows of {TIP}")
    if others := sorted({*(labels or ())} - {TIP}):
        notes.append(f"rows of markers other than {TIP} are not read: {listed(others)}")
    only = None if labels is None else (MARKER, TIP)
    series = read_series(file, TIME, measured, 0.0, only, gaps=True)
    values = dict(zip((column.name for column in measured), series.values.T, strict=True))
    nothing = np.full(series.time.size, np.nan)
    readings = []
    for some in columns:
        of_sensor = np.stack([values.get(column.name, nothing) for column in some], axis=1)
        found = Readings.of(series.time, of_sensor)
        readings.append(found if found.time.size else None)
    parts = [read_series(file, TIME, played, 0.0, only)] if played else []
    drives = [read_series(file, TIME, [column], 0.0, only) for _, column in followed]
    states = {
        each.name: Readings(drive.time, drive.values)
        for (each, _), drive in zip(followed, drives, strict=True)
    }
    commands = Commands.of(parts, [driven.index(column) for column in played], len(inputs))
    commanded = tuple(column.name for column in played)
    remarks = dict.fromkeys(note for each in (series, *parts, *drives) for note in each.notes)
    notes = [*remarks, *notes]
    return ReadingRecord(tuple(readings), commands, states, commanded, tuple(notes))


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
    commands = commands_of(result, inputs)
    if commands is None:
        return ReadingRecord(tuple(readings), None, {}, (), ())
    every = [*data["channel"].values, *(data["input"].values if "input" in data else ())]
    notes, period = [], 1 / ran.control_rate_hz
    if ran.output_interval > period * (1 + 1e-9):
        notes.append(
            f"the result lacks commands: its output.interval of {ran.output_interval:g} s exceeds "
            f"the control period of {period:g} s"
        )
    return ReadingRecord(tuple(readings), commands, {}, tuple(map(str, every)), tuple(notes))


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


def markers_in(dataset: xr.Dataset, clock: xr.DataArray) -> list[str] | None:
    """Return the marker of each row of a record; None without a column of them."""
    if MARKER not in dataset.variables:
        return None
    if dataset[MARKER].dims != clock.dims:
        dims = ", ".join(map(str, dataset[MARKER].dims)) or "nothing"
        raise refusal(MARKER, f"marker has dimensions {dims}", f"have those of {clock.name}")
    return labels_of(dataset[MARKER])


def not_read(dataset: xr.Dataset, clock: xr.DataArray, known: Container[str]) -> list[str]:
    """Return a note on the columns of a record that are not ``known``, if there are any."""
    rows = [str(name) for name, each in dataset.variables.items() if each.dims == clock.dims]
    others = [name for name in rows if name != clock.name and name not in known]
    return [f"not read: {listed(others)}"] if others else []


def column_of(name: str, unit: str) -> Column:
    """Return the column of a quantity; without a unit in the file angles are in degrees."""
    known = {"m": (length_factor, "m"), "rad": (angle_factor, "degrees")}
    factor, written = known.get(unit, ({unit: 1.0}.get, unit))
    return Column(name, name, factor, written, LARGEST)
