"""The series that a scenario names: of prescribed motions and of the target's path."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from crinoid.recording.refusal import refusal
from crinoid.recording.series import Column, Series, read_series
from crinoid.recording.units import angle_factor, length_factor
from crinoid.scenario import FileMotion, Scenario, Target
from crinoid.scenario.quantity import OPPOSITE
from crinoid.space import ANGLES, AXES

_SHIFT, _DEPTHS, _TURNS, _LONG = 1e3, 2e4, 100.0, 1e15
"""No motion goes as far (m), nothing in the sea lies as deep (m), nothing turns as often (rad), no
vector that only points is as long."""


def series_readers(scenario: Scenario) -> dict[str, Callable[[], Series]]:
    """Return what reads each series that a scenario names, by the key of its table."""
    duration, axes = scenario.simulation.duration, AXES[scenario.arm.dimension]
    readers: dict[str, Callable[[], Series]] = {
        f"base.motion.{index}": lambda motion=motion: _motion(motion, duration)
        for index, motion in enumerate(scenario.base.motion)
        if isinstance(motion, FileMotion)
    }
    if scenario.target.path == "file":
        readers["target"] = lambda: _path(scenario.target, axes, duration)
    return readers


def _motion(motion: FileMotion, duration: float) -> Series:
    turns = motion.channel in ANGLES
    column = Column(
        "value_column",
        motion.value_column or motion.channel,
        angle_factor if turns else length_factor,
        "degrees" if turns else "m",
        _TURNS if turns else _SHIFT,
        turns,
    )
    series = read_series(motion.file, motion.time_column, [column], motion.skip)
    first, last = series.time[[0, -1]]
    if first > 0:
        raise refusal("time_column", f"begins at {first:.6g} s of the run, takes 0 or before")
    if last < duration * (1 - 1e-9):
        text = f"ends at {last:.6g} s of the run, takes simulation.duration = {duration} or later"
        raise refusal("time_column", text)
    return series


def _path(target: Target, axes: tuple[str, ...], duration: float) -> Series:
    columns = [
        Column(f"tip_columns.{index}", name, length_factor, "m", _DEPTHS)
        for index, name in enumerate(target.tip_columns or axes)
    ]
    if target.angle_column is not None:
        angle = Column("angle_column", target.angle_column, angle_factor, "degrees", _TURNS, True)
        columns.append(angle)
    for index, name in enumerate(target.direction_columns or ()):
        columns.append(Column(f"direction_columns.{index}", name, _plain, "1", _LONG))
    assert target.file is not None
    series = read_series(target.file, target.time_column or "time", columns, target.skip or 0.0)
    if series.time[-1] <= 0:
        text = f"leaves nothing: the path ends at {series.time[-1]:.6g} s of the run"
        raise refusal("skip", f"{text}, takes less, or a file that ends after 0")
    if series.time[0] >= duration:
        text = f"got {target.skip or 0.0}, with which the path begins at {series.time[0]:.6g} s of "
        text += f"a run of {duration:g} s; takes the time of the file when the run begins (s)"
        raise refusal("skip", text)
    return series if target.direction_columns is None else _pointed(series)


def _pointed(series: Series) -> Series:
    """Return the series with the vectors in its last three columns made unit vectors."""
    values = series.values.copy()
    vectors = values[:, -3:]
    largest = np.abs(vectors).max(axis=1, keepdims=True)
    if not largest.all():
        raise refusal("direction_columns", "hold a vector that is 0, which has no direction")
    vectors /= largest  # squares of very small numbers are 0
    vectors /= np.linalg.norm(vectors, axis=1, keepdims=True)
    opposite = np.flatnonzero((vectors[1:] * vectors[:-1]).sum(axis=1) < OPPOSITE)
    if opposite.size:
        text = f"turn to the opposite at {series.time[opposite[0] + 1]:.6g} s of the run"
        raise refusal("direction_columns", f"{text}; take one more direction between")
    return replace(series, values=values)


def _plain(units: str) -> float | None:
    return 1.0 if units.strip() in ("1", "-", "m/m") else None
