"""Columns of numbers over the time of a run: a prescribed motion, a target's path."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from crinoid.recording.coordinates import factor_to, only_dimension, seconds
from crinoid.recording.marks import check_marks
from crinoid.recording.opening import check_count, find, numbers_of, opened, short
from crinoid.recording.refusal import refusal
from crinoid.recording.units import time_factor
from crinoid.scenario.errors import counted


class Column(NamedTuple):
    """Variable to read."""

    key: str
    """Under which the scenario names it."""
    name: str
    """In the file."""
    factor_of: Callable[[str], float | None]
    """Function that turns a unit into SI."""
    unit: str
    """If the file names none."""
    most: float
    """Largest size of a value; larger ones stand for missing values (SI)."""
    wraps: bool = False
    """Whether it is an angle, of which an instrument may leave out whole turns."""


@dataclass(frozen=True)
class Series:
    """The values read, in SI units."""

    time: Float[np.ndarray, " time"]
    """Time of the run (s), increasing."""
    values: Float[np.ndarray, "time column"]
    notes: tuple[str, ...]
    """Notes on what was assumed and left out."""

    def during(
        self, duration: float
    ) -> tuple[Float[np.ndarray, " part"], Float[np.ndarray, "part column"]]:
        """Return times and values from the last before a run to the first after it."""
        first = max(int(np.searchsorted(self.time, 0.0, side="right")) - 1, 0)
        last = int(np.searchsorted(self.time, duration)) + 1
        return self.time[first:last], self.values[first:last]


def read_series(file: str, time_column: str, columns: list[Column], skip: float) -> Series:
    """Read columns of a CSV or netCDF file.

    Times that are numbers are those of the run, dates count from the first one; ``skip`` is the
    time of the file when the run begins. Rows in which anything is missing are left out.
    """
    with opened(file, time_column) as dataset:
        remarks: list[str] = []
        clock = dataset[find(dataset, time_column, "time_column", file)]
        along = only_dimension(clock, "time_column")
        check_count(clock.size * len(columns), file, "this path")
        time = seconds(clock, remarks, key="time_column")
        units = str(clock.attrs.get("units", ""))
        if " since " not in units:
            time += float(numbers_of(clock, "time_column", "times")[0]) * (time_factor(units) or 1)
        values = np.empty((time.size, len(columns)))
        for index, (key, name, factor_of, unit, limit, _) in enumerate(columns):
            variable = dataset[find(dataset, name, key, file)]
            if variable.dims != (along,):
                dims = ", ".join(map(str, variable.dims)) or "nothing"
                raise refusal(key, f"{name} runs over {dims}, takes a column beside {time_column}")
            numbers = numbers_of(variable, key, "numbers").astype(float)
            factor = factor_to(variable, factor_of, key, unit, remarks)
            values[:, index] = factor * numbers
            most = float(np.nanmax(np.abs(numbers), initial=0.0))
            if most > limit / factor:
                text = f"{name} reaches {most:g}, takes up to {limit / factor:.4g}; missing values "
                raise refusal(key, text + "take an empty cell, or in a netCDF file a _FillValue")
            check_marks(numbers, key, name)
    there = np.isfinite(values).all(axis=1)
    if there.sum() < 2:
        rows = counted(int(there.sum()), "row")
        text = f"{short(file)} has {rows} without a missing value, takes 2 or more"
        raise refusal("file", text)
    if not there.all():
        gap, lacking = np.diff(time[there]).max(), int((~there).sum())
        lack, are = ("lacks", "is") if lacking == 1 else ("lack", "are")
        remarks.append(
            f"{lacking} of {there.size} rows {lack} a value and {are} left out, the longest gap "
            f"{gap:.4g} s"
        )
    values = values[there]
    for index, column in enumerate(columns):
        jumps = np.abs(np.diff(values[:, index])) > np.pi
        if column.wraps and jumps.any():
            values[:, index] = np.unwrap(values[:, index])
            remarks.append(
                f"{column.name} jumps by more than 180 degrees between two rows, first at "
                f"{time[there][1:][jumps][0]:.6g} s: the turn goes on by the shorter way round"
            )
    return Series(time[there] - skip, values, tuple(remarks))
