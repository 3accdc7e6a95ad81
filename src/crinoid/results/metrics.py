"""Registry of the measures of a run: errors of the tip, effort, loads and strains."""

import csv
import math
from collections.abc import Callable, Iterable, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

from crinoid.foundation.atomic_file import atomic_write
from crinoid.foundation.status import Status
from crinoid.results import effort, errors, loads
from crinoid.results.pressure import largest_pressure
from crinoid.results.result import Result
from crinoid.scenario import Scenario
from crinoid.scenario.own_measure import OwnMeasure


class RunStatistics:
    """Statistics of a run, each computed once, when a measure needs it."""

    def __init__(self, result: Result) -> None:
        self.result = result

    @cached_property
    def tip(self) -> errors.TipError:
        """Errors of the tip's position."""
        return errors.tip_error(self.result)

    @cached_property
    def uncontrolled(self) -> errors.TipError | None:
        """Errors of the tip's position without control."""
        other = self.result.uncontrolled
        return None if other is None else errors.tip_error(other)

    @cached_property
    def angle(self) -> errors.TipError | None:
        """Errors of the tip's direction; None in a result without its target."""
        aims = {"tip_direction_target", "tip_angle_target"} & set(self.result.dataset)
        return errors.angle_error(self.result) if aims else None

    @cached_property
    def force(self) -> loads.BaseLoad:
        """Force of the arm on its base."""
        return loads.base_load(self.result, "base_force")

    @cached_property
    def moment(self) -> loads.BaseLoad:
        """Moment of the arm on its base."""
        return loads.base_load(self.result, "base_moment")

    @cached_property
    def curvature(self) -> loads.Peak | None:
        """Largest curvature."""
        return loads.largest_curvature(self.result)

    @cached_property
    def strain(self) -> loads.Peak | None:
        """Largest strain at the surface."""
        return loads.largest_strain(self.result)

    @cached_property
    def cycles(self) -> loads.BendingCycles | None:
        """Cycles of the curvature."""
        return loads.bending_cycles(self.result)

    @cached_property
    def contact(self) -> loads.ContactExtremes | None:
        """Contact with obstacles."""
        return loads.contact(self.result)

    @cached_property
    def self_contact(self) -> loads.ContactSeries | None:
        """Contact of the arm with itself."""
        return loads.far_contact(self.result.dataset, "self")

    @cached_property
    def hull_contact(self) -> loads.ContactSeries | None:
        """Contact of the arm with the hull."""
        return loads.far_contact(self.result.dataset, "hull")

    @cached_property
    def vehicle(self) -> effort.VehicleUse | None:
        """Use of a floating vehicle."""
        return effort.vehicle_use(self.result)


class Measure(NamedTuple):
    """A scalar measure of a run."""

    unit: str
    meaning: str
    read: Callable[[RunStatistics], float | None]
    """Returns None or NaN where a run has no such number."""

    def of(self, result: Result) -> float | None:
        """Return the measure of a run; None where it has no such number."""
        return known(self.read(RunStatistics(result)))

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


def known(value: float | None) -> float | None:
    """Return a number; None where it is not finite."""
    return value if value is not None and math.isfinite(value) else None


def _of(name: str, field: str) -> Callable[[RunStatistics], float | None]:
    """Return a function that reads a field of some statistics, or None without them."""

    def read(run: RunStatistics) -> float | None:
        found = getattr(run, name)
        return None if found is None else getattr(found, field)

    return read


_TIP = "distance of the tip from its target, or from its start without one"
_ANGLE = "angle of the tip from its target, or from its start without one"


# fmt: off
MEASURES = {
    "rms_error": Measure("m", f"RMS {_TIP}", _of("tip", "rms")),
    "rms_error_uncontrolled": Measure(
        "m", f"RMS {_TIP}, without control", _of("uncontrolled", "rms")),
    "max_error": Measure("m", f"largest {_TIP}", _of("tip", "maximum")),
    "p95_error": Measure("m", f"95th percentile of the {_TIP}", _of("tip", "p95")),
    "within_tolerance": Measure(
        "1", "share of the time with the tip within target.tolerance",
        lambda run: errors.within_tolerance(run.result)),
    "steady_error": Measure(
        "m", f"mean {_TIP}, over the last tenth of the run", _of("tip", "steady")),
    "fluctuation": Measure(
        "m", "RMS distance of the tip from its own mean position", _of("tip", "fluctuation")),
    "deflection": Measure(
        "m", "mean distance of the tip without control from where it should be, over the last "
        "tenth", lambda run: errors.deflection(run.result)),
    "settling_time": Measure(
        "s", "when the tip error last came into 5 % of the largest one",
        lambda run: errors.settling_time(run.result)),
    "rms_angle_error": Measure("rad", f"RMS {_ANGLE}", _of("angle", "rms")),
    "max_angle_error": Measure(
        "rad", f"largest {_ANGLE}", _of("angle", "maximum")),
    "work": Measure(
        "J", "work of base and actuators on the arm, returned work not counted",
        lambda run: effort.spent_work(run.result)),
    **{
        f"{kind}_base_{name}": Measure(
            unit, f"{words} {name} of the arm on its base",
            _of(name, "maximum" if kind == "max" else kind))
        for name, unit in (("force", "N"), ("moment", "N m"))
        for kind, words in (("max", "largest"), ("rms", "RMS"), ("p95", "95th percentile of the"))
    },
    "max_curvature": Measure("m-1", "largest curvature of the arm", _of("curvature", "value")),
    "max_curvature_station": Measure(
        "m", "distance from the root at which it is largest", _of("curvature", "station")),
    "max_strain": Measure(
        "1", "largest strain at the arm's surface, from stretch and bending",
        _of("strain", "value")),
    "max_strain_station": Measure(
        "m", "distance from the root at which it is largest", _of("strain", "station")),
    "curvature_cycles": Measure(
        "1", "number of cycles of the curvature where its range is largest",
        _of("cycles", "number")),
    "curvature_cycles_station": Measure(
        "m", "distance from the root of that place", _of("cycles", "station")),
    "equivalent_curvature_range": Measure(
        "m-1", "range of as many equal cycles of the same damage",
        _of("cycles", "equivalent_range")),
    "contact_time": Measure(
        "s", "longest time in contact with an obstacle", _of("contact", "time")),
    "max_contact_force": Measure("N", "largest force of an obstacle", _of("contact", "force")),
    "min_gap": Measure(
        "m", "smallest distance of an obstacle from the arm's surface", _of("contact", "gap")),
    **{
        name.format(part): Measure(unit, f"{text} {words}", _of(f"{part}_contact", field))
        for part, words in loads.FAR_CONTACTS.items()
        for name, unit, text, field in (
            ("{}_contact_time", "s", "time of the arm in contact with", "time"),
            ("max_{}_force", "N", "largest force of the arm on", "largest_force"),
            ("min_{}_gap", "m", "smallest distance of the arm from", "smallest_gap"))
    },
    "vehicle_excursion": Measure(
        "m", "largest distance of the vehicle from where it started", _of("vehicle", "excursion")),
    "vehicle_turn": Measure(
        "rad", "largest pan, tilt or roll of the vehicle from its start", _of("vehicle", "turn")),
    "max_thrust": Measure("N", "largest force of the thrusters", _of("vehicle", "max_thrust")),
    "rms_thrust": Measure("N", "RMS force of the thrusters", _of("vehicle", "rms_thrust")),
    "thrust_limit_share": Measure(
        "1", "share of the time with thrusters at a limit", _of("vehicle", "limit_share")),
    "max_pressure": Measure(
        "Pa", "largest pressure in a chamber", lambda run: largest_pressure(run.result)),
}
# fmt: on
"""The registry of measures, by their names in tables and files.

Errors and effort count from `crinoid.Scenario.judged_from` on, loads, strains and the vehicle from
the start.
"""
EFFORT = "RMS speed of the inputs, of means between saved instants"
"""Meaning of the speeds of `measured`."""


def _own(measure: OwnMeasure) -> Callable[[RunStatistics], float | None]:
    def read(run: RunStatistics) -> float | None:
        complete = run.result.ended is Status.OK  # else its function may fail for lack of data
        return measure.of(run.result.dataset) if complete else None

    return read


def measures_of(scenario: Scenario) -> dict[str, Measure]:
    """Return the measures of the runs of a scenario: the registry, and those that it names.

    A `ScenarioError` names a measure that is in no installed package.
    """
    own = scenario.output.own_measures(MEASURES)
    return MEASURES | {
        name: Measure(each.unit, each.meaning, _own(each)) for name, each in own.items()
    }


def measured(result: Result) -> Measures:
    """Return the measures of a run that has reached its end."""
    speed, run = effort.input_speed(result), RunStatistics(result)
    unit = effort.input_units(result.dataset)
    found = {name: measure.read(run) for name, measure in measures_of(result.scenario).items()}
    return Measures(
        {name: float("nan") if value is None else value for name, value in found.items()},
        speed,
        {name: effort.speed_unit(unit[name]) for name in speed},
    )


CASES = "cases.csv"
_LONGEST = 1 << 24
"""Characters of a header beyond which nobody reads it."""
_CASE, _ENDS = "case", ("status", "directory")
"""The first column of each table, and the last ones."""


def measure_columns(columns: Sequence[str]) -> list[str]:
    """Return which columns of a table are measures: from the first of the registry to the status.

    The varied keys come before them. Empty where it is not the table of a study.
    """
    first = next((at for at, name in enumerate(columns) if name in MEASURES), len(columns))
    ends = tuple(columns[-2:]) == _ENDS and columns[0] == _CASE
    return list(columns[first:-2]) if ends else []


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
    return names[:1] == [_CASE] and names[-1:] == [_ENDS[-1]]


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
