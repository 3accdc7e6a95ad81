"""Series over the time of a run: prescribed motions and paths of the target from files."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import pandas as pd
import xarray as xr
from jaxtyping import Bool, Float

from crinoid.foundation.axes import ANGLES, AXES
from crinoid.recording.axes import as_numbers, find, only_dimension, seconds
from crinoid.recording.numbers import Column, check_count, labels_of, numbers_of, quantity
from crinoid.recording.readers import read_dataset
from crinoid.recording.response import VesselResponse, read_response
from crinoid.recording.texts import REMARKS, short
from crinoid.recording.units import angle_factor, length_factor, no_unit, time_factor
from crinoid.recording.vessel import vessel_motion
from crinoid.scenario import Scenario, Target, counted, refusal
from crinoid.scenario.base_motion import FileMotion, ResponseMotion, VesselMotion, too_steep
from crinoid.scenario.quantity import OPPOSITE

_MOST = 0.5
"""Smallest measured share of a level."""
_LATE = 1.5
"""Interval, over the usual one, above which samples are missing."""
_SOME = 0.2
"""Largest share of such intervals: more are no gaps, but points at uneven times."""
_SHIFT, _DEPTHS, _TURNS, _LONG = 1e3, 2e4, 100.0, 1e15
"""Greatest shift (m), depth (m), turn (rad) and length of a vector without a unit."""


def absent_rows(time: np.ndarray) -> tuple[float, np.ndarray]:
    """Return the usual interval of a record (s), and the rows that are absent in each step."""
    steps = np.diff(time)
    usual = float(np.median(steps))
    return usual, np.where(steps > _LATE * usual, np.rint(steps / usual) - 1, 0)


class FilledRecord(NamedTuple):
    """A record without gaps."""

    time: Float[np.ndarray, " time"]
    """Time (s), with the instants that are missing in the file."""
    levels: Float[np.ndarray, " level"] | None
    """Heights z (m), in the order of the file; None for a record at one point."""
    velocity: Float[np.ndarray, "time level component"]
    """Velocity (m/s); zero for a component named ``0``."""
    filled: Bool[np.ndarray, "time level"]
    """Whether a component is missing."""
    remarks: list[str]
    """Assumptions, omitted levels and filled gaps, a sentence each."""


def fill(
    time: Float[np.ndarray, " time"],
    levels: Float[np.ndarray, " level"] | None,
    velocity: Float[np.ndarray, "time level component"],
    names: list[str],
    remarks: list[str],
) -> FilledRecord:
    """Fill the gaps of a record (NaN) by straight lines in time, and omit empty levels."""
    usual, absent = absent_rows(time)
    if absent.sum() >= time.size:
        text = f"most samples are missing at the usual interval of {usual:.6g} s"
        raise refusal("time", text, "be a record in one piece", "Cut one out.")
    places = np.concatenate([[0], np.cumsum(absent + 1)]).astype(int)
    whole = np.interp(np.arange(places[-1] + 1), places, time)
    shape = (whole.size, *velocity.shape[1:])
    rows = pd.DataFrame(velocity.reshape(time.size, -1), places).reindex(range(whole.size))
    there = rows.notna().to_numpy().reshape(shape)
    lines = rows.set_axis(whole).interpolate("index", limit_direction="both")
    share = there.mean(axis=0)
    full = (share >= _MOST).all(axis=1)
    if not full.any():
        least = share.max(axis=0)
        which = int(np.argmin(least))
        must = "have half of the values" + ("" if levels is None else " at one level")
        raise refusal("file", f"{1 - least[which]:.0%} of {names[which]} is missing", must)
    if levels is not None and not full.all():
        heights = ", ".join(f"{height:.6g}" for height in np.sort(levels[~full]))
        remarks.append(f"most is missing at z = {heights} m: left out")
    there = there[:, full]
    for component, name in enumerate(names):
        # between two samples of a level, or to the ends of the record
        gaps = [
            np.diff(np.concatenate([whole[:1], whole[level], whole[-1:]])).max()
            for level in there[..., component].T
            if not level.all()
        ]
        if gaps and name != "0":
            text = (
                f"{1 - there[..., component].mean():.2%} of {name} is missing and was filled by "
                f"straight lines, the longest gap {max(gaps):.4g} s"
            )
            remarks.extend([text] if text not in remarks else [])
    filled = np.ascontiguousarray(lines).reshape(shape)[:, full]
    levels = None if levels is None else levels[full]
    return FilledRecord(whole, levels, filled, np.logical_not(there.all(axis=2)), remarks)


@dataclass(frozen=True)
class Series:
    """Columns of numbers over time, in SI units."""

    time: Float[np.ndarray, " time"]
    """Time of the run (s), increasing."""
    values: Float[np.ndarray, "time column"]
    notes: tuple[str, ...]
    """Assumptions and omitted rows, a sentence each."""

    def during(
        self, duration: float
    ) -> tuple[Float[np.ndarray, " part"], Float[np.ndarray, "part column"]]:
        """Return times and values from the last before a run to the first after it."""
        first = max(int(np.searchsorted(self.time, 0.0, side="right")) - 1, 0)
        last = int(np.searchsorted(self.time, duration)) + 1
        return self.time[first:last], self.values[first:last]


def values_in(
    dataset: xr.Dataset, columns: list[Column], first: xr.DataArray, file: str, remarks: list[str]
) -> Float[np.ndarray, "row column"]:
    """Return columns of a file in SI units, with the dimension of its ``first`` column."""
    along = only_dimension(first, str(first.name))
    values = np.empty((first.size, len(columns)))
    for index, column in enumerate(columns):
        variable = dataset[find(dataset, column.name, column.key, file)]
        if variable.dims != (along,):
            dims = ", ".join(map(str, variable.dims)) or "nothing"
            text = f"{column.name} has dimensions {dims}"
            raise refusal(column.key, text, f"have those of {first.name}")
        values[:, index] = quantity(dataset, variable, column, remarks)
    return values


def read_series(
    file: str,
    time_column: str,
    columns: list[Column],
    skip: float,
    only: tuple[str, str] | None = None,
    *,
    gaps: bool = False,
    time_key: str = "time_column",
) -> Series:
    """Read columns of a CSV or netCDF file.

    Times that are numbers are those of the run, dates count from the first one; ``skip`` is the
    time of the file when the run begins. Rows with a missing value are omitted, or only those
    without any value where ``gaps`` may stay. With ``only``, a column and a label in it, other rows
    do not count. ``time_key`` is the key that names the column of times.
    """
    with read_dataset(file) as dataset:
        remarks: list[str] = dataset.attrs.get(REMARKS, "").splitlines()
        name = find(dataset, time_column, time_key, file)
        along = only_dimension(dataset[name], time_key)
        check_count(dataset[name].size * len(columns), file, "this path")
        clock = as_numbers(dataset[name], time_key)
        units = str(clock.attrs.get("units", ""))
        begin = numbers_of(clock, time_key, "times")[:1]
        if only is not None:
            chosen = np.flatnonzero(np.array(labels_of(dataset[only[0]])) == only[1])
            dataset, clock = dataset.isel({along: chosen}), clock.isel({along: chosen})
        time = seconds(clock, remarks, key=time_key)
        since = begin[0] if " since " in units else 0
        start = numbers_of(clock, time_key, "times")[0]
        time += float(start - since) * (time_factor(units) or 1)
        values = values_in(dataset, columns, clock, file, remarks)
    there = (np.any if gaps else np.all)(np.isfinite(values), axis=1)
    if there.sum() < 2:
        which = "with a value" if gaps else "without a missing value"
        text = f"{short(file)} has {counted(int(there.sum()), 'row')} {which}"
        raise refusal("file", text, "have at least 2")
    time, values, lacking = time[there], values[there], int((~there).sum())
    if lacking:
        lack, are = ("lacks", "is") if lacking == 1 else ("lack", "are")
        remarks.append(
            f"{lacking} of {there.size} rows {lack} a value and {are} left out, the longest gap "
            f"{np.diff(time).max():.4g} s"
        )
    usual, absent = absent_rows(time)
    if 0 < np.count_nonzero(absent) <= _SOME * absent.size:  # else it has no usual interval
        at = int(np.argmax(absent))
        remarks.append(
            f"{int(absent.sum())} rows are absent at the usual interval of {usual:.4g} s, the "
            f"longest gap {time[at + 1] - time[at]:.4g} s, from {time[at]:.6g} s on"
        )
    for column, turn in zip(columns, values.T, strict=True):
        jumps = np.abs(np.diff(turn)) > np.pi
        if column.wraps and jumps.any():
            remarks.append(
                f"{column.name} jumps by more than 180 degrees between two rows, first at "
                f"{time[1:][jumps][0]:.6g} s: the turn goes on by the shorter way round"
            )
            turn[:] = np.unwrap(turn)
    return Series(time - skip, values, tuple(remarks))


def series_readers(scenario: Scenario) -> dict[str, Callable[[], Series | VesselResponse]]:
    """Return a reader of each series, or RAOs, of a scenario by the key of its table."""
    duration, axes = scenario.simulation.duration, AXES[scenario.arm.dimension]
    readers: dict[str, Callable[[], Series | VesselResponse]] = {}
    for index, motion in enumerate(scenario.base.motion):
        match motion:
            case FileMotion():
                readers[f"base.motion.{index}"] = lambda motion=motion: _motion(motion, scenario)
            case VesselMotion():
                readers[f"base.motion.{index}"] = lambda motion=motion: _vessel(motion, scenario)
            case ResponseMotion():
                readers[f"base.motion.{index}"] = lambda m=motion: read_response(m, scenario)
    if scenario.target.path == "file":
        readers["target"] = lambda: _path(scenario.target, axes, duration)
    return readers


def _motion(motion: FileMotion, scenario: Scenario) -> Series:
    name, turns = motion.value_column or motion.channel, motion.channel in ANGLES
    column = _displacement("value_column", name, turns=turns)
    series = read_series(motion.file, motion.time_column, [column], motion.skip)
    return whole(series, scenario.simulation.duration)


def _displacement(key: str, name: str, *, turns: bool) -> Column:
    """Return a column of turns or of shifts."""
    if turns:
        return Column(key, name, angle_factor, "degrees", _TURNS, wraps=True)
    return Column(key, name, length_factor, "m", _SHIFT)


def whole(series: Series, duration: float, key: str = "time_column") -> Series:
    """Return a series that spans a run, or refuse it."""
    first, last = series.time[[0, -1]]
    if first > 0:
        raise refusal(key, f"begins at {first:.6g} s of the run", "begin at 0 or earlier")
    if last < duration * (1 - 1e-9):
        text = f"ends at {last:.6g} s of the run"
        raise refusal(key, text, f"end at simulation.duration = {duration} or later")
    return series


def _vessel(motion: VesselMotion, scenario: Scenario) -> Series:
    """Return the motion of the channels of a base that a vessel carries."""
    base, axes, columns, signs = scenario.base, scenario.arm.dimension, [], {}
    for name, (sign, column) in motion.columns.given(scenario.arm.dimension).items():
        signs[name] = sign
        if sign:
            turns = name not in ("surge", "sway", "heave")
            columns.append(_displacement(f"columns.{name}", column, turns=turns))
    if not columns:
        raise refusal("columns", "every motion is 0", "name a column")
    series = read_series(motion.file, motion.time_column, columns, motion.skip)
    series = whole(series, scenario.simulation.duration)
    read, still = iter(series.values.T), np.zeros(series.time.size)
    moved = {name: sign * next(read) if sign else still for name, sign in signs.items()}
    for name in moved.keys() & {"surge", "sway", "yaw"}:  # of which a log has positions, headings
        moved[name] = moved[name] - np.interp(0.0, series.time, moved[name])
    values = vessel_motion(moved, motion.offset, base.angles)
    if axes == 3 and not np.isfinite(values).all():
        raise too_steep(base.angles[1])
    return replace(series, values=values)


def _path(target: Target, axes: tuple[str, ...], duration: float) -> Series:
    columns = [
        Column(f"tip_columns.{index}", name, length_factor, "m", _DEPTHS)
        for index, name in enumerate(target.tip_columns or axes)
    ]
    if target.angle_column is not None:
        angle = Column("angle_column", target.angle_column, angle_factor, "degrees", _TURNS, True)
        columns.append(angle)
    columns += [
        Column(f"direction_columns.{index}", name, no_unit, "1", _LONG)
        for index, name in enumerate(target.direction_columns or ())
    ]
    assert target.file is not None
    series = read_series(target.file, target.time_column or "time", columns, target.skip or 0.0)
    if series.time[-1] <= 0:
        text = f"the path ends at {series.time[-1]:.6g} s of the run"
        raise refusal("skip", text, "leave a part of the path", "Lower it.")
    if series.time[0] >= duration:
        text = f"the path begins at {series.time[0]:.6g} s of a run of {duration:g} s"
        raise refusal("skip", text, "be the time of the file when the run begins (s)")
    return series if target.direction_columns is None else _pointed(series)


def _pointed(series: Series) -> Series:
    """Return the series with unit vectors in its last three columns."""
    vectors = series.values[:, -3:]
    largest = np.abs(vectors).max(axis=1, keepdims=True)
    if not largest.all():
        raise refusal("direction_columns", "a vector is 0", "have a direction in each row")
    vectors = vectors / largest  # squares of very small numbers are 0
    vectors /= np.linalg.norm(vectors, axis=1, keepdims=True)
    opposite = np.flatnonzero((vectors[1:] * vectors[:-1]).sum(axis=1) < OPPOSITE)
    if opposite.size:
        text = f"turn to the opposite at {series.time[opposite[0] + 1]:.6g} s of the run"
        raise refusal("direction_columns", text, "turn by less", "Add a direction between.")
    return replace(series, values=np.hstack([series.values[:, :-3], vectors]))
