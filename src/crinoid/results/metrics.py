"""Registry of the measures of a run: errors of the tip, effort, loads and strains.

It has no arrays: what reads a measure is loaded with the first run that it is read from.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from pkgutil import resolve_name
from typing import TYPE_CHECKING, Any, NamedTuple

from crinoid.foundation.atomic_file import atomic_write
from crinoid.foundation.status import Status
from crinoid.scenario import Scenario
from crinoid.scenario.own_measure import OwnMeasure

if TYPE_CHECKING:
    from crinoid.results.result import Result


class RunStatistics:
    """Statistics of a run, each computed once, when a measure needs it."""

    def __init__(self, result: Result) -> None:
        self.result = result
        self._found: dict[str, Any] = {}

    def of(self, function: str) -> Any:
        """Return a statistic: the value of a function of this folder, ``module:function``."""
        if function not in self._found:
            self._found[function] = resolve_name(f"crinoid.results.{function}")(self.result)
        return self._found[function]


class Measure(NamedTuple):
    """A scalar measure of a run."""

    unit: str
    words: str
    """Its label in tables and figures."""
    meaning: str
    source: str | Callable[[Result], float | None]
    """Function of a `Result` in this folder, as ``module:function``, or ``module:function.field``.

    It returns None, and the field is None or NaN, where a run has no such number."""
    smooth: bool = False
    """Whether it has a derivative, in `crinoid.results.smooth`."""

    def read(self, run: RunStatistics) -> float | None:
        """Return the measure from the statistics of a run; None or NaN if it has no such number."""
        if not isinstance(self.source, str):
            return self.source(run.result)
        function, _, field = self.source.partition(".")
        found = run.of(function)
        if isinstance(found, dict):
            return found.get(field)
        return getattr(found, field) if field and found is not None else found

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
    speed: dict[str, float]  # RMS speed of each input that can move
    unit: dict[str, str]  # units of the speeds


def known(value: float | int | None) -> float | int | None:
    """Return a number; None where it is not finite."""
    return value if value is not None and math.isfinite(value) else None


FAR_CONTACTS = {"self": "itself", "hull": "the hull"}
"""Parts other than obstacles that the arm may touch, as in the names of variables, and in words."""
_TIP = "distance of the tip from its target, or from its start without one"
_ANGLE = "angle of the tip from its target, or from its start without one"


# fmt: off
MEASURES = {
    "rms_error": Measure(
        "m", "RMS tip error", f"RMS {_TIP}", "errors:tip_error.rms", smooth=True),
    "rms_error_uncontrolled": Measure(
        "m", "RMS tip error without control", f"RMS {_TIP}, without control",
        "errors:uncontrolled_error.rms"),
    "max_error": Measure(
        "m", "largest tip error", f"largest {_TIP}",
        "errors:tip_error.maximum", smooth=True),
    "p95_error": Measure(
        "m", "P95 tip error", f"95th percentile of the {_TIP}",
        "errors:tip_error.p95", smooth=True),
    "within_tolerance": Measure(
        "1", "within tolerance", "share of the time with the tip within target.tolerance",
        "errors:within_tolerance"),
    "steady_error": Measure(
        "m", "steady tip error", f"mean {_TIP}, over the last tenth of the run",
        "errors:tip_error.steady", smooth=True),
    "fluctuation": Measure(
        "m", "fluctuation", "RMS distance of the tip from its own mean position",
        "errors:tip_error.fluctuation", smooth=True),
    "deflection": Measure(
        "m", "steady tip error without control",
        "mean distance of the tip without control from where it should be, over the last tenth",
        "errors:deflection"),
    "rise_time": Measure(
        "s", "rise time", "time of the step response from 10 % to 90 % of its final value",
        "step_response:step_response.rise_time"),
    "overshoot": Measure(
        "1", "overshoot", "share of its final value by which the step response exceeds it",
        "step_response:step_response.overshoot"),
    "settling_time": Measure(
        "s", "settling time", "time from the step until the response stays within 2 %",
        "step_response:step_response.settling_time"),
    "rms_angle_error": Measure(
        "rad", "RMS angle error", f"RMS {_ANGLE}",
        "errors:angle_error.rms", smooth=True),
    "max_angle_error": Measure(
        "rad", "largest angle error", f"largest {_ANGLE}",
        "errors:angle_error.maximum", smooth=True),
    "control_cost": Measure(
        "m", "control cost",
        "root of the mean squared error of the controlled coordinates and of the input speeds",
        "effort:control_cost", smooth=True),
    "work": Measure(
        "J", "work of base and actuators",
        "work of base and actuators on the arm, returned work not counted", "effort:spent_work"),
    **{
        f"{kind}_base_{name}": Measure(
            unit, f"{short} base {name}", f"{words} {name} of the arm on its base",
            f"loads:base_{name}.{field}", smooth=kind == "rms")
        for name, unit in (("force", "N"), ("moment", "N m"))
        for kind, short, words, field in (
            ("max", "largest", "largest", "maximum"), ("rms", "RMS", "RMS", "rms"),
            ("p95", "P95", "95th percentile of the", "p95"))
    },
    **{
        f"base_{load}_{axis}_{end}{time}": Measure(
            "s" if time else unit, f"{word} base {load} {way} {axis}{', time' if time else ''}",
            f"{'time of the ' if time else ''}{word} {load} of the arm on its base {way} {axis}",
            f"loads:base_components.{load}_{axis}_{end}{time}")
        for load, unit, way in (("force", "N", "along"), ("moment", "N m", "about"))
        for axis in "xyz"
        for end, word in (("min", "least"), ("max", "greatest"))
        for time in ("", "_time")
    },
    **{
        f"max_{load}{end}": Measure(
            unit or own, f"{short}largest {words}", f"{text}largest {words} {where}",
            f"loads:largest_{load}.{field}")
        for load, own, where in (
            ("bending_moment", "N m", "of the arm"), ("shear_force", "N", "of the arm"),
            ("curvature", "m-1", "of the arm"),
            ("strain", "1", "at the arm's surface, from stretch and bending"))
        for words in (load.replace("_", " "),)
        for end, unit, short, text, field in (
            ("", "", "", "", "value"),
            ("_station", "m", "station of ", "distance from the root of the ", "station"),
            ("_time", "s", "time of ", "time of the ", "time"))
    },
    "curvature_cycles": Measure(
        "1", "curvature cycles", "number of cycles of the curvature where its range is largest",
        "loads:bending_cycles.number"),
    "curvature_cycles_station": Measure(
        "m", "station of curvature cycles", "distance from the root of that place",
        "loads:bending_cycles.station"),
    "equivalent_curvature_range": Measure(
        "m-1", "equivalent curvature range", "range of as many equal cycles of the same damage",
        "loads:bending_cycles.equivalent_range"),
    "life": Measure(
        "year", "fatigue life", "fatigue life of the arm in the conditions of the run",
        "fatigue:fatigue_life.life"),
    "life_station": Measure(
        "m", "station of fatigue", "distance from the root at which the fatigue life is shortest",
        "fatigue:fatigue_life.station"),
    "contact_time": Measure(
        "s", "contact time", "longest time in contact with an obstacle", "loads:contact.time"),
    "max_contact_force": Measure(
        "N", "largest contact force", "largest force of an obstacle at the saved instants",
        "loads:contact.force"),
    "min_gap": Measure(
        "m", "smallest gap", "smallest distance of an obstacle from the arm's surface",
        "loads:contact.gap"),
    **{
        name.format(part): Measure(
            unit, short.format(part), f"{text} {words}", f"loads:{part}_contact.{field}")
        for part, words in FAR_CONTACTS.items()
        for name, unit, short, text, field in (
            ("{}_contact_time", "s", "{} contact time", "time of the arm in contact with", "time"),
            ("max_{}_force", "N", "largest {} force", "largest force of the arm on",
             "largest_force"),
            ("min_{}_gap", "m", "smallest {} gap", "smallest distance of the arm from",
             "smallest_gap"))
    },
    "vehicle_excursion": Measure(
        "m", "vehicle excursion", "largest distance of the vehicle from where it started",
        "effort:vehicle_use.excursion"),
    "vehicle_turn": Measure(
        "rad", "vehicle turn", "largest pan, tilt or roll of the vehicle from its start",
        "effort:vehicle_use.turn"),
    "max_thrust": Measure(
        "N", "largest thrust", "largest force of the thrusters", "effort:vehicle_use.max_thrust"),
    "rms_thrust": Measure(
        "N", "RMS thrust", "RMS force of the thrusters", "effort:vehicle_use.rms_thrust"),
    "thrust_limit_share": Measure(
        "1", "thrust limit share", "share of the time with thrusters at a limit",
        "effort:vehicle_use.limit_share"),
    "max_pressure": Measure(
        "Pa", "largest pressure", "largest pressure in a chamber",
        "effort:largest_pressure", smooth=True),
}
# fmt: on
"""The registry of measures, by their names in tables and files.

Errors and effort count from `crinoid.Scenario.judged_from` on, the step response from the step,
loads, strains and the vehicle from the start.
"""
EFFORT = "RMS speed of the inputs, of means between saved instants"
"""Meaning of the speeds of `measured`."""


def own_words(name: str) -> str:
    """Return the label of a measure of a package, from its name."""
    return name.replace("_", " ")


def _own(name: str, measure: OwnMeasure) -> Measure:
    def of(result: Result) -> float | None:
        complete = result.ended is Status.OK  # else its function may fail for lack of data
        return measure.of(result.dataset) if complete else None

    return Measure(measure.unit, own_words(name), measure.meaning, of)


def measures_of(scenario: Scenario) -> dict[str, Measure]:
    """Return the measures of the runs of a scenario: the registry, and those that it names.

    A `ScenarioError` names a measure that is in no installed package.
    """
    own = scenario.output.own_measures(MEASURES)
    return MEASURES | {name: _own(name, each) for name, each in own.items()}


def measured(result: Result) -> Measures:
    """Return the measures of a run that has reached its end."""
    from crinoid.results import effort  # loads JAX

    speed, run = effort.input_speed(result), RunStatistics(result)
    unit = effort.input_units(result.dataset)
    found = {name: measure.read(run) for name, measure in measures_of(result.scenario).items()}
    return Measures(
        {name: float("nan") if value is None else value for name, value in found.items()},
        speed,
        {name: effort.speed_unit(unit[name]) for name in speed},
    )


CASES = "cases.csv"
_LONGEST = 1 << 24  # characters of a header beyond which nobody reads it
_CASE, _ENDS = "case", ("status", "directory")  # the first column of each table, and the last ones


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
