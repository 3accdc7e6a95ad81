"""Files of measured currents as services, models and instruments write them, with known values.

The current in a file is straight in time and in height, so that straight lines fill its gaps
without an error.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import netCDF4
import numpy as np
import pytest

from crinoid.recording import propose, read_dataset
from crinoid.recording.selection import read_selection
from crinoid.scenario import ScenarioError
from crinoid.scenario.flow import MeasuredFlow

BED = -20.0
"""Height z of the bed (m)."""
START = np.datetime64("2024-03-01T06:00:00", "ms")
"""First instant of each file."""
COUNT, STEP = 4, 600.0
"""Instants of a file, and the time between them (s)."""
DEPTHS = np.array([2.0, 5.0, 9.5])
Z = (-2.0, -5.0, -9.5)
EAST_NORTH = {"velocity": ["u", "v", "0"], "heading_deg": 90.0}

M_PER_S = {"units": "m s-1"}
EAST = {"standard_name": "eastward_sea_water_velocity"} | M_PER_S
NORTH = {"standard_name": "northward_sea_water_velocity"} | M_PER_S
DOWN = {"standard_name": "depth", "units": "m", "positive": "down", "axis": "Z"}
UNITS = {"s": "seconds", "h": "hours", "D": "days"}


def straight(index, z):
    """Return a current toward the east and the north (m/s) at instants 0, 1 ... and heights z."""
    return 0.40 + 0.02 * index + 0.01 * z, -0.10 + 0.01 * index - 0.004 * z


def speed_and_direction(index, z):
    """Return a speed (m/s) and the direction toward which the water flows (degrees)."""
    return 0.40 + 0.02 * index + 0.01 * z, 60.0 + 5.0 * index + 0.0 * z


def turning(index, z):
    """Return `speed_and_direction` as components toward the east and the north (m/s)."""
    speed, direction = speed_and_direction(index, z)
    return speed * np.sin(np.radians(direction)), speed * np.cos(np.radians(direction))


def over(function, heights=0.0, count=COUNT):
    """Return the two parts of a current at each instant and height: shape (time, level)."""
    return function(np.arange(count)[:, None], np.atleast_1d(heights)[None, :])


def since(epoch, unit, *, count=COUNT, step=STEP):
    """Return the instants of a file since an epoch, in a unit such as ``h`` or ``D``."""
    times = START + (1e3 * step * np.arange(count)).astype("timedelta64[ms]")
    return (times - np.datetime64(epoch)) / np.timedelta64(1, unit)


def dates(pattern, *, count=COUNT, step=STEP):
    """Return the instants of a file as texts."""
    times = START + (1e3 * step * np.arange(count)).astype("timedelta64[ms]")
    return [each.strftime(pattern) for each in times.tolist()]


def clock(name="time", epoch="1970-01-01", unit="s", **options):
    """Return the variable of the time in a netCDF file."""
    attributes = {"standard_name": "time", "units": f"{UNITS[unit]} since {epoch}", "axis": "T"}
    return (name,), since(epoch, unit, **options), attributes


def store(path, variables, *, form="NETCDF4", **attributes):
    """Write a netCDF file of ``{name: (dimensions, values, attributes)}``, values as they are."""
    with netCDF4.Dataset(path, "w", format=form) as file:
        put(file, variables)
        file.setncatts(attributes)
    return path


def put(group, variables):
    """Write variables into a file or a group; nothing is packed or filled on the way."""
    for name, (dimensions, values, attributes) in variables.items():
        values = np.asarray(values)
        for dimension, size in zip(dimensions, values.shape, strict=True):
            if dimension not in group.dimensions:
                group.createDimension(dimension, size)
        kind = str if values.dtype.kind == "U" else values.dtype
        fill = attributes.get("_FillValue")
        variable = group.createVariable(name, kind, dimensions, fill_value=fill)
        variable.set_auto_maskandscale(False)
        variable.setncatts({key: each for key, each in attributes.items() if key != "_FillValue"})
        variable[...] = values


def with_gap(values, index, level, mark):
    """Return values with a mark in place of one that is missing or bad."""
    values = np.array(values)
    values[index, level] = mark
    return values


ISO = dates("%Y-%m-%dT%H:%M:%SZ")


def lines(
    *head, row="{t},{u},{v}", times=ISO, heights=(0.0,), current=straight, scale=(1.0, 1.0),
    digits=3, decimal=".", change=("", ""), newest_first=False, end="\n", encoding="utf-8",
    name="a.csv",
):  # fmt: skip
    """Return what writes a head and a row for each instant and height, with one text changed."""

    def write(folder):
        first, second = over(current, heights, len(times))
        rows = []
        for k, time in enumerate(times):
            for i, z in enumerate(heights):
                parts = scale[0] * first[k, i], scale[1] * second[k, i]
                u, v = (f"{part:.{digits}f}".replace(".", decimal) for part in parts)
                rows.append(row.format(t=time, u=u, v=v, z=z, depth=-z, k=k))
        text = end.join([*head, *(rows[::-1] if newest_first else rows), ""])
        (folder / name).write_bytes(text.replace(*change).encode(encoding))
        return folder / name

    return write


@dataclass(frozen=True)
class Played:
    """A file that crinoid plays, and the current in it."""

    write: Callable[[Path], Path]
    """Function that writes the file into a folder and returns its path."""
    z: tuple[float, ...] | None = None
    """Heights of the levels (m); None for a record at one point."""
    keys: dict | None = None
    """Keys of the flow; None if `propose` finds them."""
    place: dict = field(default_factory=dict)
    """Keys that no file can propose, such as the point of a grid."""
    at: float = 0.0
    """Height of a record at one point (m)."""
    current: Callable = straight
    count: int = COUNT
    step: float = STEP
    gaps: tuple[tuple[int, int], ...] = ()
    """Instant and level of each value that is missing."""
    remark: str = ""
    """Pattern of a remark."""
    bed: float | None = BED
    moving: bool = False
    """Whether the levels move: then ``z`` has the inner ones, and outer ones are close."""

    def check(self, folder):
        """Write the file, play it, and compare what is played."""
        path = self.write(folder)
        keys = propose(read_dataset(str(path)), str(path)) if self.keys is None else self.keys
        keys = {"kind": "measured", "file": str(path)} | keys | self.place
        record = read_selection(MeasuredFlow(**keys), self.bed)
        times = self.step * np.arange(self.count)
        np.testing.assert_allclose(record.time, times, atol=1e-4)  # days in double precision
        levels, velocity, filled = record.levels, record.velocity, record.filled
        if self.z is None:
            assert levels is None or np.allclose(levels, self.at)
            assert velocity.shape[1] == 1
            heights = np.array([self.at])
        else:
            # a file may begin at the surface or at the bed
            order = np.argsort(levels)
            heights, velocity, filled = levels[order], velocity[:, order], filled[:, order]
            if self.moving:
                inner = [int(np.argmin(np.abs(heights - each))) for each in np.sort(self.z)]
                outer = np.delete(np.arange(heights.size), inner)
                expected = np.stack(over(self.current, heights[outer], self.count), axis=-1)
                np.testing.assert_allclose(velocity[:, outer, :2], expected, atol=5e-3)
                heights, velocity, filled = heights[inner], velocity[:, inner], filled[:, inner]
            np.testing.assert_allclose(heights, np.sort(self.z), atol=1e-5)  # single precision
        expected = np.stack(over(self.current, heights, self.count), axis=-1)
        missing = np.zeros(expected.shape[:2], bool)
        for index, level in self.gaps:
            place = 0 if self.z is None else list(np.sort(self.z)).index(self.z[level])
            missing[index, place] = True
            expected[index, place] = 0.5 * (expected[index - 1, place] + expected[index + 1, place])
        np.testing.assert_allclose(velocity[:, :, :2], expected, atol=1e-6)
        assert not velocity[:, :, 2:].any()
        np.testing.assert_array_equal(filled, missing)
        assert re.search(self.remark, "\n".join(record.remarks), re.I), record.remarks


@dataclass(frozen=True)
class Refused:
    """A file that crinoid refuses, and a pattern of the hint."""

    write: Callable[[Path], Path]
    hint: str
    keys: dict = field(default_factory=lambda: EAST_NORTH)

    def check(self, folder):
        """Write the file and let it be refused in one line."""
        keys = {"kind": "measured", "file": str(self.write(folder))} | self.keys
        with pytest.raises(ScenarioError) as caught:
            read_selection(MeasuredFlow(**keys), BED)
        (line,) = caught.value.lines
        assert re.search(self.hint, line, re.I), line
