"""Recorded readings of sensors, commands and states of actuators, from a table or a result."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from crinoid.actuation import Input
from crinoid.control import Sensor
from crinoid.inverse import logs
from crinoid.inverse.marker import TIP
from crinoid.recording.numbers import Column
from crinoid.recording.texts import listed
from crinoid.results.result import Result
from crinoid.scenario import Scenario, refusal
from crinoid.scenario.sensor import Sampling


class Readings(NamedTuple):
    """Readings of a sensor, each with at least one value."""

    time: Float[np.ndarray, " row"]  # times of the measurements (s), increasing
    values: Float[np.ndarray, "row value"]  # values in SI units; nan where one is missing

    @staticmethod
    def of(time: Float[np.ndarray, " row"], values: Float[np.ndarray, "row value"]) -> Readings:
        """Leave out rows without any value."""
        there = np.isfinite(values).any(axis=1)
        return Readings(time[there], values[there])


class ReadingRecord(NamedTuple):
    """A log of an experiment, as an observer reads it."""

    readings: tuple[Readings | None, ...]
    """Those of each sensor of the scenario, that of the tip first; None if the log has none."""
    commands: logs.Commands | None
    states: dict[str, Readings]
    """Measured drives of actuators by the names of their inputs, those of the base included."""
    commanded: tuple[str, ...]  # inputs that have commands; the others are at rest
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
    with logs.record_errors():
        if folder := logs.result_folder(path):
            return _of_result(Result.load(folder), scenario, sensors, inputs)
        return _of_table(str(path), scenario, sensors, inputs)


def _columns(scenario: Scenario, sensors: Sequence[Sensor]) -> list[list[Column]]:
    axes = scenario.arm.dimension
    found = []
    for index, sensor in enumerate(sensors):
        names = sensor.measurand.names(axes)
        before = f"{sensor.name}." if index else ""
        found.append([logs.column_of(f"{before}{name}", unit) for name, unit in names])
    return found


def _of_table(
    file: str, scenario: Scenario, sensors: Sequence[Sensor], inputs: Sequence[Input]
) -> ReadingRecord:
    columns = _columns(scenario, sensors)
    log = logs.LogTable(file, [column for some in columns for column in some], inputs)
    labels = set(log.labels or ())
    if log.labels is not None and TIP not in labels:
        raise refusal(logs.MARKER, f"marker has {listed(sorted(labels))}", f"have rows of {TIP}")
    followed = {each.name: logs.column_of(f"{each.name}.state", each.unit) for each in inputs}
    followed = {name: column for name, column in followed.items() if column.name in log.names}
    notes = log.not_read([column.name for column in followed.values()])
    if others := sorted(labels - {TIP}):
        notes.append(f"rows of markers other than {TIP} are not read: {listed(others)}")
    only = None if log.labels is None else TIP
    series = log.series(log.measured, only, gaps=True)
    names = (column.name for column in log.measured)
    values = dict(zip(names, series.values.T, strict=True))
    nothing = np.full(series.time.size, np.nan)
    readings = []
    for some in columns:
        of_sensor = np.stack([values.get(column.name, nothing) for column in some], axis=1)
        found = Readings.of(series.time, of_sensor)
        readings.append(found if found.time.size else None)
    commands, parts = log.commands([only])
    drives = {name: log.series([column], only) for name, column in followed.items()}
    states = {name: Readings(drive.time, drive.values) for name, drive in drives.items()}
    remarks = (note for each in (series, *parts, *drives.values()) for note in each.notes)
    notes = [*dict.fromkeys(remarks), *notes]
    commanded = tuple(column.name for column in log.played)
    return ReadingRecord(tuple(readings), commands, states, commanded, tuple(notes))


def _of_result(
    result: Result, scenario: Scenario, sensors: Sequence[Sensor], inputs: Sequence[Input]
) -> ReadingRecord:
    data, ran = result.dataset, result.scenario
    if ran.arm.dimension != scenario.arm.dimension:
        text = f"the arm has {ran.arm.dimension} axes; must have {scenario.arm.dimension}"
        raise refusal("file", text)
    there = {str(name) for name in data["reading"].values}
    tables: dict[str, Sampling] = {each.called: each for each in ran.sensors}
    readings: list[Readings | None] = []
    for sensor in sensors:
        table = tables.get(sensor.name, ran.sensor if sensor is sensors[0] else None)
        names = [f"{sensor.name}.{name}" for name, _ in sensor.measurand.names(ran.arm.dimension)]
        if table is None or not set(names) <= there:
            readings.append(None)
            continue
        readings.append(Readings.of(*logs.readings_of(result, table, names)))
    if not any(each is not None and each.time.size for each in readings):
        raise refusal("file", "the run has no reading of a sensor of the scenario")
    commands = logs.commands_of(result, inputs)
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
