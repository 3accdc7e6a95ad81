"""Summary of a run in numbers, for its end and its page."""

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from crinoid.foundation.axes import ANGLES, CHANNELS
from crinoid.results.effort import input_use, solver_use
from crinoid.results.errors import TipError, error_word
from crinoid.results.loads import ContactExtremes
from crinoid.results.measure_labels import unit_of
from crinoid.results.metrics import (
    FAR_CONTACTS,
    MEASURES,
    Measure,
    RunStatistics,
    known,
    measures_of,
)
from crinoid.results.result import Result
from crinoid.results.saturation import limit_shares
from crinoid.results.scene.data import base_word
from crinoid.results.summary import numbers_at_rest
from crinoid.results.units import DEGREES, Unit, length_unit, si_unit

_NOTHING = 1e-6
"""Part of the arm's length, angle (rad) or load (N, N m) below which there is nothing to compare:
a ratio would be one of round-off. At rest part of the largest load: smaller ones are 0."""
_ALMOST_NO_LOAD = 1e-4  # load at which round-off is measured where there is none (N)
_ROUND_OFF = 1e-3  # part of that below which a number is round-off, and is written as 0
_STILL = 1e-9  # motion of an input (m, rad or its unit) that is round-off
_LOADS = {"max": "largest {} on {}", "rms": "{} on {}, RMS", "p95": "{} on {}, P95"}
_FEW_INPUTS = 3  # most inputs that have a row each in the short table
SHARE = Unit(100.0, "%")
_SELDOM = 1e-3  # share of the time at a limit that is not worth a row


class RunSummary(NamedTuple):
    """A table of texts."""

    heads: list[str]
    rows: list[list[str]]


def summary(result: Result, *, full: bool = False) -> RunSummary:
    """Summarise a run, and the one without control where it exists.

    The short table has about ten rows: errors of the tip, inputs against their limits, the largest
    loads and strain, and the speed. The ``full`` one has what it leaves out too.
    """
    runs = [RunStatistics(run) for _, run in result.members]
    table = _Table(result, runs, measures_of(result.scenario), full, [])
    with np.errstate(all="ignore"):  # a run that diverged may hold huge numbers
        table.add_errors()
        table.add_measures("rise_time", "overshoot", "settling_time")
        table.add_inputs()
        table.add_loads()
        table.add_vehicle()
        table.add_contacts()
        table.add_far_contacts()
        table.add_measures(*(name for name in table.measures if name not in MEASURES))
        table.add_speed()
    value = "controlled" if result.scenario.control.acts else "value"
    heads = ["", value, "uncontrolled", "ratio"]
    return RunSummary(heads[: 2 if len(table.runs) == 1 else 4], table.rows)


class _Table(NamedTuple):
    """Rows of a summary, filled from the measures of a run and of the one without control."""

    result: Result
    runs: list[RunStatistics]
    measures: Mapping[str, Measure]
    full: bool
    rows: list[list[str]]

    def measure(self, name: str) -> list[float | None]:
        """Return a measure of each run."""
        return [known(self.measures[name].read(run)) for run in self.runs]

    def unit(self, name: str) -> Unit:
        """Return a readable unit of a measure of all runs."""
        size = max(abs(value or 0.0) for value in self.measure(name))
        return unit_of(self.measures[name].attributes, size)

    def add_measures(self, *names: str, nothing: float = math.inf) -> None:
        """Add measures with their labels."""
        for name in names:
            self.add_measure(name, nothing=nothing)

    def add_measure(
        self, name: str, words: str = "", unit: Unit | None = None, *, nothing: float = math.inf
    ) -> None:
        """Add a measure, by default with its label and in a unit for its size."""
        words, unit = words or self.measures[name].words, unit or self.unit(name)
        self.add(words, self.measure(name), unit, nothing=nothing)

    def add(
        self, name: str, values: Sequence[float | None], unit: Unit, *, nothing: float = math.inf
    ) -> None:
        """Add values, in SI, and their ratio where there is more than ``nothing`` to compare."""
        if values[0] is None:
            return
        round_off = _ROUND_OFF * nothing if nothing < math.inf else 0.0
        shown = [None if v is None else v if abs(v) > round_off else 0.0 for v in values]
        cells = ["" if value is None else unit.text(value) for value in shown]
        numbers = [value for value in shown if value is not None]
        if len(numbers) == 2 and min(numbers) >= 0 and numbers[1] > nothing:
            cells.append(f"{numbers[0] / numbers[1]:.1%}")
        self.rows.append([name, *cells])

    def add_errors(self) -> None:
        """Add errors of the tip's position and direction, which count from a time on."""
        scenario, begin = self.result.scenario, self.result.scenario.judged_from
        word, since = error_word(scenario), f" from {begin:g} s" if begin > 0 else ""
        errors, nothing = "errors:tip_error", _NOTHING * scenario.arm.length
        self._add_errors(word, since, errors, self.unit("max_error"), nothing)
        if (tolerance := scenario.target.tolerance) is not None:
            within = f"{word} within {length_unit(tolerance).text(tolerance)}"
            self.add_measure("within_tolerance", within)
        turns = {"angle", "direction"} & set(scenario.control.controlled)
        if scenario.control.acts and turns:
            self._add_errors("angle error", since, "errors:angle_error", DEGREES, _NOTHING)

    def found(self, function: str) -> list[Any]:
        """Return a statistic of each run that has it."""
        return [found for run in self.runs if (found := run.of(function)) is not None]

    def _add_errors(self, name: str, since: str, function: str, unit: Unit, nothing: float) -> None:
        errors: list[TipError] = self.found(function)

        def add(words: str, field: str) -> None:
            values = [known(getattr(error, field)) for error in errors]
            self.add(words, values, unit, nothing=nothing)

        add(f"{name}, RMS{since}", "rms")
        if self.full or name != "angle error":
            add(f"{name}, maximum", "maximum")
        scenario = self.result.scenario
        if self.full:
            add(f"{name}, P95", "p95")
            carried = scenario.target.frame == "base" and scenario.base.motion
            if not (scenario.target.moves or carried):  # else the tip is to go away from its mean
                add(f"{name.partition(' ')[0]} fluctuation, RMS", "fluctuation")

    def add_inputs(self) -> None:
        """Add the use of inputs against their limits, and the time that they spend there."""
        uses, shares = input_use(self.result), limit_shares(self.result)
        met = {name: each for name, each in shares.items() if max(each) >= _SELDOM}
        if self.full or len(uses) <= _FEW_INPUTS:
            for name, use in uses.items():
                low, high, rms = (
                    value if abs(value) > _STILL else 0.0 for value in (use.low, use.high, use.rms)
                )
                unit = _unit_of(name, self.result, max(-low, high))
                limits = self._range(name, use.lower, use.upper)
                row = [f"{name}, limits {limits}", f"{unit.number(low)} to {unit.text(high)}"]
                self.rows.append(row)
                if self.full:
                    self.rows.append([f"{name}, RMS", unit.text(rms)])
        else:
            most = max(uses, key=lambda name: uses[name].share)
            text = f"{most}, {uses[most].share:.0%} of its limit"
            self.rows.append([f"nearest limit ({len(uses)} inputs)", text])
            longest = sorted(met, key=lambda name: max(met[name]))[-1:]
            met = {name: met[name] for name in longest}
        for name, each in met.items():
            parts = [f"{kind} {share:.1%}" for kind, share in each._asdict().items() if share]
            self.rows.append([f"{name}, time at limits", ", ".join(parts)])

    def _range(self, name: str, lower: float, upper: float) -> str:
        """Write the limits of an input."""
        unit = _unit_of(name, self.result, max(-lower, upper))
        if lower == -upper:
            return f"\N{PLUS-MINUS SIGN}{unit.text(upper)}"
        return f"{unit.number(lower)} to {unit.text(upper)}"

    def add_loads(self) -> None:
        """Add loads on the base, curvature and strain, which count from the start."""
        base, length = base_word(self.result.scenario), self.result.scenario.arm.length
        for load in ("force", "moment"):
            unit = self.unit(f"max_base_{load}")
            for kind, label in _LOADS.items() if self.full else [("max", _LOADS["max"])]:
                words = label.format(load, base)
                self.add_measure(f"{kind}_base_{load}", words, unit, nothing=_NOTHING)
            if self.full:
                self._add_components(load, base, unit)
        for name, words, unit, nothing in (
            ("max_strain", "largest surface strain", SHARE, _NOTHING),
            ("max_curvature", "largest curvature", self.unit("max_curvature"), _NOTHING / length),
        )[: 2 if self.full else 1]:
            if (self.measure(name)[0] or 0.0) > nothing:
                self.add_measure(name, words, unit, nothing=nothing)
        self.add_measure("life")
        if self.full:
            self.add_measures("max_bending_moment", "max_shear_force", nothing=_NOTHING)
        if self.full and (self.measure("curvature_cycles")[0] or 0.0) > 0.0:
            self.add_measure("curvature_cycles", "cycles of curvature")
            self.add_measure("equivalent_curvature_range", nothing=0.0)

    def _add_components(self, load: str, base: str, unit: Unit) -> None:
        """Add the least and the greatest value of each component of a load, with their times."""
        way = "along" if load == "force" else "about"
        found: list[dict[str, float]] = self.found("loads:base_components")
        for axis in "xyz":
            for end, word in (("min", "least"), ("max", "greatest")):
                if (name := f"{load}_{axis}_{end}") in found[0]:
                    at = [(each[name], f" at {each[f'{name}_time']:.4g} s") for each in found]
                    small, none = _NOTHING * _ROUND_OFF, unit.text(0.0)
                    cells = [unit.text(v) + time if abs(v) > small else none for v, time in at]
                    self.rows.append([f"{load} on {base} {way} {axis}, {word}", *cells])

    def add_vehicle(self) -> None:
        """Add the motion of a floating submarine, and the use of its thrusters."""
        self.add_measure("vehicle_excursion", "submarine's excursion", nothing=_NOTHING)
        vehicle = self.result.scenario.vehicle
        held = vehicle is not None and vehicle.hold != "free"
        if held:
            self.add_measure("thrust_limit_share", "thrusters, time at limits")
        if self.full:
            self.add_measure("vehicle_turn", "submarine's turn", nothing=_NOTHING)
        if self.full and held:
            self.add_measure("max_thrust", nothing=_NOTHING)
            self.add_measure("rms_thrust", "thrust, RMS", nothing=_NOTHING)

    def add_contacts(self) -> None:
        """Add contacts with obstacles, and of which one each is; in short the force, or the gap."""
        found: list[ContactExtremes] = self.found("loads:contact")
        if not found:
            return
        several = self.result.dataset["contact_time"].shape[-1] > 1
        touched = any(each.time > 0 for each in found)
        rows = (
            ("longest time in contact", "time", self.full),
            ("largest contact force", "force", self.full or touched),
            ("smallest gap", "gap", self.full or not touched),
        )
        for place, (words, field, shown) in enumerate(rows):
            cells = []
            for each in found if shown else ():
                units = Unit(1.0, "s"), Unit(1.0, "N"), length_unit(abs(each.gap))
                text = units[place].text(getattr(each, field))
                cells.append(f"obstacle {each.obstacles[place]}: {text}" if several else text)
            if cells:
                self.rows.append([words, *cells])

    def add_far_contacts(self) -> None:
        """Add contact of the arm with itself and with the hull; in short the force of a touch."""
        for part, words in FAR_CONTACTS.items():
            time = f"{part}_contact_time"
            if self.full or any(self.measure(time)):
                self.add_measure(f"max_{part}_force", f"largest force on {words}")
            if self.full:
                self.add_measure(time, f"time in contact with {words}")
                self.add_measure(f"min_{part}_gap", f"smallest gap from {words}")

    def add_speed(self) -> None:
        """Add the speed of the simulation."""
        each = [solver_use(run.result) for run in self.runs]
        if self.full:
            self.rows.append(["simulated", *(f"{use.simulated:g} s" for use in each)])
        fast = (f"{use.simulated / max(1e-9, use.wall_time):.0f} x" for use in each)
        self.rows.append(["faster than real time", *fast])


def equilibrium_summary(result: Result) -> RunSummary:
    """Sum up an equilibrium."""
    values = {name: each.value or 0.0 for name, each in numbers_at_rest(result)}
    base, length = base_word(result.scenario), float(result.dataset["arc_length"].values[-1])

    def parts(name: str) -> dict[str, float]:
        """Return the components of a vector by axis, or a number alone."""
        found = {axis: values.get(f"{name}_{axis}") for axis in "xyz"} | {"": values.get(name)}
        return {axis: value for axis, value in found.items() if value is not None}

    def most(name: str) -> float:
        return max(map(abs, parts(name).values()), default=0.0)

    def text(name: str, unit: str, scale: float, digits: int = 4) -> str:
        return ", ".join(
            f"{axis} {0.0 if abs(value) < _NOTHING * scale else value:.{digits}g} {unit}".strip()
            for axis, value in parts(name).items()
        )

    pull = max(most("base_force"), most("max_tension"), _ALMOST_NO_LOAD)
    turning = max(most("base_moment"), pull * length)
    turn = np.rad2deg(values["tip_angle"])
    angle = f"{0.0 if abs(turn) < _NOTHING else turn:.4g} degrees"
    rows = [
        ["tip", text("tip", "m", length, 6)],
        ["tip direction", text("tip_direction", "", 1.0) or angle],
        [f"force on {base}", text("base_force", "N", pull)],
        [f"moment on {base}", text("base_moment", "N m", turning)],
        ["greatest tension", text("max_tension", "N", pull)],
        ["greatest curvature", text("max_curvature", "1/m", 1 / length)],
        ["greatest twist", text("max_twist", "rad/m", 1 / length)],
    ]
    for index in range(result.dataset.sizes.get("obstacle", 0)):
        if pushes := most(name := f"contact_force_{index}"):
            rows.append([f"force of obstacle {index}", text(name, "N", pushes)])
    first = [f"{each:.3g}" for name, each in values.items() if name.startswith("natural_frequency")]
    if first:
        rows.append(["lowest natural frequencies, without damping", f"{', '.join(first)} Hz"])
    return RunSummary(["", "at rest"], [row for row in rows if row[1]])


def _unit_of(name: str, result: Result, most: float) -> Unit:
    """Return the unit of an input: of a channel of the base, or as its actuator has it."""
    if name in ANGLES:
        return DEGREES
    if name in CHANNELS[3]:
        return length_unit(most)
    unit = str(result.dataset["input_unit"].sel(input=name).item())
    return SHARE if unit == "1" else si_unit(most, unit)
