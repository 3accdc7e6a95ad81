"""Logs of experiments: tables of measured quantities and commands over time, and results."""

from __future__ import annotations

from collections.abc import Container, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import numpy as np
import xarray as xr
from jaxtyping import Float

from crinoid.actuation import Input
from crinoid.recording.axes import find
from crinoid.recording.logs import is_bag
from crinoid.recording.numbers import Column, labels_of
from crinoid.recording.readers import read_dataset
from crinoid.recording.series import Series, read_series
from crinoid.recording.texts import listed
from crinoid.recording.units import angle_factor, length_factor
from crinoid.results.result import RESULT, Result, ResultError
from crinoid.results.result_file import attributes
from crinoid.scenario import Mistake, ScenarioError, refusal
from crinoid.scenario.sensor import Sampling

TIME, HOLD, MARKER = "time", "hold", "marker"  # columns of a table
LARGEST = 1e12  # larger numbers mark missing values


class Commands(NamedTuple):
    """Recorded commands, each valid until the time of the next."""

    time: Float[np.ndarray, " row"]  # times of the run (s), increasing
    values: Float[np.ndarray, "row input"]  # commands of all inputs, each in its unit (m, rad, 1)


def commands_of(result: Result, inputs: Sequence[Input]) -> Commands | None:
    """Return the commands in a result, each from its time step on; None without control."""
    data, step = result.dataset, result.scenario.simulation.time_step
    if not result.scenario.control.acts:
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


class LogTable:
    """A table over time, or over holds where they are allowed.

    It has some of the ``quantities``; of rows with markers the first ``of_marker`` of them. The
    commands of some inputs have their names.
    """

    def __init__(
        self,
        file: str,
        quantities: Sequence[Column],
        inputs: Sequence[Input],
        *,
        of_marker: int | None = None,
        holds: bool = False,
    ) -> None:
        with read_dataset(file) as dataset:
            self.names = there = [str(name) for name in dataset.variables]
            self.file, self.along = file, HOLD if holds and HOLD in there else TIME
            quantities = quantities[:of_marker] if MARKER in there else quantities
            self.measured = [column for column in quantities if column.name in there]
            if not self.measured:
                names = ", ".join(column.name for column in quantities)
                must = f"have {self.along} and some of {names}"
                raise refusal("file", f"has {listed(sorted(there))}", must)
            self.clock = HOLD if self.along == HOLD else find(dataset, TIME, "time_column", file)
            dims = dataset[self.clock].dims
            self._rows = [name for name in there if dataset[name].dims == dims]
            self.labels = _markers_in(dataset, self.clock)
            """Marker of each row; None without a column of them."""
        self._inputs = [column_of(each.name, each.unit) for each in inputs]
        self.played = [column for column in self._inputs if column.name in there]  # of commands

    def series(
        self, columns: Sequence[Column], label: str | None = None, *, gaps: bool = False
    ) -> Series:
        """Return columns of the rows of a marker, or of all rows (`read_series`)."""
        only = None if label is None else (MARKER, label)
        return read_series(self.file, TIME, [*columns], 0.0, only, gaps=gaps)

    def commands(self, labels: Sequence[str | None]) -> tuple[Commands | None, list[Series]]:
        """Return the commands in the rows of some markers, and their series; others rest."""
        if not self.played:
            return None, []
        parts = [self.series(self.played, label) for label in labels]
        times, first = np.unique(np.concatenate([part.time for part in parts]), return_index=True)
        values = np.zeros((times.size, len(self._inputs)))
        at = [self._inputs.index(column) for column in self.played]
        values[:, at] = np.concatenate([part.values for part in parts])[first]
        return Commands(times, values), parts

    def not_read(self, known: Container[str]) -> list[str]:
        """Return a note on the columns that are not ``known``, if there are any."""
        read = {self.clock, MARKER, *(each.name for each in (*self.measured, *self.played))}
        others = [name for name in self._rows if name not in read and name not in known]
        return [f"not read: {listed(others)}"] if others else []


def _markers_in(dataset: xr.Dataset, clock: str) -> list[str] | None:
    if MARKER not in dataset.variables:
        return None
    if dataset[MARKER].dims != dataset[clock].dims:
        dims = ", ".join(map(str, dataset[MARKER].dims)) or "nothing"
        raise refusal(MARKER, f"marker has dimensions {dims}", f"have those of {clock}")
    return labels_of(dataset[MARKER])


def column_of(name: str, unit: str) -> Column:
    """Return the column of a quantity; without a unit in the file angles are in degrees."""
    known = {"m": (length_factor, "m"), "rad": (angle_factor, "degrees")}
    factor, written = known.get(unit, ({unit: 1.0}.get, unit))
    return Column(name, name, factor, written, LARGEST)


@contextmanager
def record_errors() -> Iterator[None]:
    """Raise the mistakes of a record under the name RECORD."""
    try:
        yield
    except ResultError as error:
        raise refusal("RECORD", str(error)) from error
    except ScenarioError as error:
        mistakes = [Mistake("RECORD", mistake.text) for mistake in error.mistakes]
        raise ScenarioError(mistakes) from error


def result_folder(path: Path) -> Path | None:
    """Return the folder of a result of crinoid; None if the path is of another file."""
    if path.is_dir():
        return None if is_bag(path) else path
    return path.parent if path.name == RESULT and attributes(path) else None


def readings_of(
    result: Result, sensor: Sampling, names: Sequence[str]
) -> tuple[Float[np.ndarray, " sample"], Float[np.ndarray, "sample value"]]:
    """Return the times (s) at which a sensor measured in a run, and some of its readings."""
    data, step = result.dataset, result.scenario.simulation.time_step
    time, period = data["time"].values, 1 / result.scenario.rate_hz(sensor.rate_hz)
    # a sample is taken at the first time step at or after a tick
    ticks = np.arange(int(time[-1] / period + 2)) * period
    samples = step * np.ceil(ticks / step - 1e-6)
    newest = np.searchsorted(samples, time - max(step, sensor.delay) + 1e-6 * step) - 1
    rows = np.flatnonzero(newest >= 0)
    times, first = np.unique(samples[newest[rows]], return_index=True)
    # the saved instants that first know a sample
    return times, data["sensor_reading"].sel(reading=[*names]).values[rows[first]]
