"""Measures of a run: errors of the tip, motion of the inputs, loads on the submarine."""

import csv
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from jaxtyping import Float

from crinoid.foundation.atomic_file import atomic_write
from crinoid.results.result import Result

_LAST = 0.1
"""Share of a run, at its end, that counts as steady."""
_BAND = 0.05
"""Error of a settled tip over the largest error without control."""


class TipError(NamedTuple):
    """Errors of the position (m) or angle (rad) of the tip over the saved instants of a run."""

    rms: float
    maximum: float
    steady: float
    """Mean over the last tenth of the run."""
    fluctuation: float
    """RMS distance of the tip from its own mean position, or angle from its own mean direction."""


class InputUse(NamedTuple):
    """Use of an input: motion of a servo (m or rad), or drive of an actuator in its unit."""

    rms: float
    low: float
    high: float


class PeakLoad(NamedTuple):
    """Largest load of the arm on the submarine over the saved instants of a run."""

    force: float
    """N."""
    moment: float
    """N m."""


def tip_error(result: Result) -> TipError:
    """Return the errors of the tip's position."""
    data = result.dataset
    tip = data["tip_position"].values
    wander = np.linalg.norm(tip - tip.mean(axis=0), axis=1)
    return _sum_up(data["tip_error"].values, wander, _steady(result))


def angle_error(result: Result) -> TipError:
    """Return the errors of the tip's direction (rad)."""
    data = result.dataset
    if "tip_direction" in data:
        direction = data["tip_direction"].values
        error = angle_between(direction, data["tip_direction_target"].values)
        wander = angle_between(direction, direction.mean(axis=0))
    else:
        angle = data["tip_angle"].values
        error = np.abs(short_way(angle - data["tip_angle_target"].values))
        wander = np.abs(angle - angle.mean())
    return _sum_up(error, wander, _steady(result))


def angle_between(
    one: Float[np.ndarray, "time axis=3"], other: Float[np.ndarray, "*time axis=3"]
) -> Float[np.ndarray, " time"]:
    """Return the angle between directions (rad), exact also where it is small."""
    sine = np.linalg.norm(np.cross(one, other), axis=-1)
    return np.asarray(np.arctan2(sine, np.sum(one * other, axis=-1)))


def short_way(turn: Float[np.ndarray, " time"]) -> Float[np.ndarray, " time"]:
    """Return turns (rad) the short way round, from -pi to pi."""
    return np.asarray(turn - 2 * np.pi * np.round(turn / (2 * np.pi)))


def input_use(result: Result) -> dict[str, InputUse]:
    """Return the use of each input that a controller drives; empty without a controller."""
    found = {name: driven(result.dataset, name) for name in result.scenario.driven}
    return {
        name: InputUse(_rms(values), float(values.min()), float(values.max()))
        for name, values in found.items()
    }


def driven(data: xr.Dataset, name: str) -> Float[np.ndarray, " time"]:
    """Return the displacement of a channel's servo, or the drive of an actuator."""
    if name in data["channel"]:
        return np.asarray(data["base_servo"].sel(channel=name).values)
    return np.asarray(data["actuator_state"].sel(input=name).values)


def input_speed(result: Result) -> dict[str, float]:
    """Return the RMS speed of each input that can move, a controller or not.

    Speeds are means between saved instants: of a servo's displacement (m/s or rad/s), or of the
    drive of an actuator in its unit per s.
    """
    data = result.dataset
    span = np.diff(data["time"].values)
    moves = data["channel_lower"].values < data["channel_upper"].values
    names = [*data["channel"].values[moves], *(data["input"].values if "input" in data else ())]
    found = {str(name): np.diff(driven(data, name)) for name in names}
    return {
        name: float(np.sqrt(np.sum(move**2 / span) / span.sum())) for name, move in found.items()
    }


def spent_work(result: Result) -> float:
    """Return the work of base and actuators on the arm (J), without the work that it returned.

    The sum of the increases from one saved instant to the next.
    """
    work = result.dataset["energy"].sel(kind="actuation").values
    return float(np.sum(np.maximum(np.diff(work), 0.0)))


def peak_load(result: Result) -> PeakLoad:
    """Return the largest force and the largest moment of the arm on the submarine."""
    data = result.dataset

    def peak(variable: xr.DataArray) -> float:
        values = variable.values
        return float(np.max(np.linalg.norm(values, axis=1) if values.ndim == 2 else abs(values)))

    return PeakLoad(peak(data["base_force"]), peak(data["base_moment"]))


def settling_time(result: Result) -> float | None:
    """Return the settling time of the tip (s): its last entry into a band; None if it ends outside.

    The band is 5 % of the largest error of the run without control, or of this run if there is
    none.
    """
    reference = result.uncontrolled if result.uncontrolled is not None else result
    band = _BAND * float(np.max(reference.dataset["tip_error"].values))
    time = result.dataset["time"].values
    outside = np.flatnonzero(result.dataset["tip_error"].values > band)
    if outside.size == 0:
        return float(time[0])
    if outside[-1] == time.size - 1:
        return None
    return float(time[outside[-1] + 1])


def deflection(result: Result) -> float | None:
    """Return the mean distance of the tip from its target without control, when steady (m).

    From the run without control, or from this run if it has no controller; else None.
    """
    if result.uncontrolled is not None:
        return tip_error(result.uncontrolled).steady
    return tip_error(result).steady if result.scenario.control.kind == "none" else None


def _sum_up(
    error: Float[np.ndarray, " time"], wander: Float[np.ndarray, " time"], steady: np.ndarray
) -> TipError:
    return TipError(_rms(error), float(np.max(error)), float(np.mean(error[steady])), _rms(wander))


def _rms(values: Float[np.ndarray, " time"]) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _steady(result: Result) -> np.ndarray:
    time = result.dataset["time"].values
    return time >= time[-1] - _LAST * (time[-1] - time[0])


class Measure(NamedTuple):
    """A scalar measure of a run."""

    unit: str
    meaning: str
    of: Callable[[Result], float | None]
    """Returns None where a run has no such number."""

    @property
    def attributes(self) -> dict[str, str]:
        """Its attributes in netCDF."""
        return {"units": self.unit, "long_name": self.meaning}


class Measures(NamedTuple):
    """The measures of one run."""

    numbers: dict[str, float]
    """By name, such as ``rms_error``; NaN where a run has no such number."""
    speed: dict[str, float]
    """RMS speed of each input that can move."""
    unit: dict[str, str]
    """Units of the speeds."""


MEASURES = {
    "rms_error": Measure(
        "m", "RMS distance of the tip from where it should be", lambda run: tip_error(run).rms
    ),
    "rms_error_uncontrolled": Measure(
        "m",
        "RMS distance of the tip from where it should be, without control",
        lambda run: None if run.uncontrolled is None else tip_error(run.uncontrolled).rms,
    ),
    "max_error": Measure(
        "m",
        "largest distance of the tip from where it should be",
        lambda run: tip_error(run).maximum,
    ),
    "steady_error": Measure(
        "m",
        "mean distance of the tip from where it should be, over the last tenth of the run",
        lambda run: tip_error(run).steady,
    ),
    "fluctuation": Measure(
        "m",
        "RMS distance of the tip from its own mean position",
        lambda run: tip_error(run).fluctuation,
    ),
    "deflection": Measure(
        "m",
        "mean distance of the tip without control from where it should be, over the last tenth",
        deflection,
    ),
    "settling_time": Measure(
        "s", "when the tip error last came into 5 % of the largest one", settling_time
    ),
    "rms_angle_error": Measure(
        "rad",
        "RMS angle between where the tip points and where it should",
        lambda run: angle_error(run).rms,
    ),
    "max_angle_error": Measure(
        "rad",
        "largest angle between where the tip points and where it should",
        lambda run: angle_error(run).maximum,
    ),
    "work": Measure(
        "J", "work of base and actuators on the arm, returned work not counted", spent_work
    ),
}
"""The registry of measures, by their names in tables and files."""
EFFORT = "RMS speed of the inputs, of means between saved instants"
"""Meaning of the speeds of `measured`."""


def measured(result: Result) -> Measures:
    """Return the measures of a run that has reached its end."""
    data, speed = result.dataset, input_speed(result)
    unit = dict(zip(data["channel"].values, data["channel_unit"].values, strict=True))
    if "input" in data:
        unit |= dict(zip(data["input"].values, data["input_unit"].values, strict=True))
    found = {name: measure.of(result) for name, measure in MEASURES.items()}
    return Measures(
        {name: float("nan") if value is None else value for name, value in found.items()},
        speed,
        {name: "s-1" if unit[name] == "1" else f"{unit[name]} s-1" for name in speed},
    )


CASES = "cases.csv"
_LONGEST = 1 << 24
"""Characters of a header beyond which nobody reads it."""
CASE_MEASURES = (
    "deflection",
    "steady_error",
    "rms_error",
    "rms_error_uncontrolled",
    "settling_time",
)
COLUMNS = ("case", *CASE_MEASURES, "status", "directory")
"""Columns of every table; those of the varied keys follow the first."""


def header_of(path: Path) -> tuple[list[str], str]:
    """Return the names in the first line of a table, and the line; nothing without such a line."""
    try:
        with path.open(newline="", encoding="utf-8") as file:
            line = file.readline(_LONGEST)
        return next(csv.reader([line]), []), line
    except (OSError, UnicodeDecodeError, csv.Error):
        return [], ""


def is_table(path: Path) -> bool:
    """Return whether a file is the table of a study, by its header."""
    names, _ = header_of(path)
    return names[:1] == [COLUMNS[0]] and names[-1:] == [COLUMNS[-1]]


def read_rows(path: Path) -> tuple[list[str], list[dict[str, Any]]]:
    """Return the columns of a table and its rows."""
    with path.open(newline="", encoding="utf-8") as file:
        table = csv.DictReader(file)
        return list(table.fieldnames or []), list(table)


def write_rows(path: Path, rows: Iterable[dict[str, Any]]) -> None:
    """Write a table of at least one row, whole or not at all."""
    with atomic_write(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        following = iter(rows)
        first = next(following)
        writer = csv.DictWriter(file, list(first))
        writer.writeheader()
        writer.writerow(first)
        writer.writerows(following)
