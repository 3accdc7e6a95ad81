"""Summary of a run in numbers, for its end and its page."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from crinoid.foundation.axes import ANGLES, CHANNELS
from crinoid.results.effort import InputUse, input_use
from crinoid.results.errors import TipError, error_word
from crinoid.results.loads import FAR_CONTACTS
from crinoid.results.measure_labels import label_of, unit_of
from crinoid.results.metrics import MEASURES, RunStatistics, known, measures_of
from crinoid.results.result import Result
from crinoid.results.saturation import limit_shares
from crinoid.results.scene.data import base_word
from crinoid.results.units import DEGREES, Unit, largest, length_unit, si_unit

_NOTHING = 1e-6
"""Part of the arm's length, angle (rad) or load (N, N m) below which there is nothing to compare:
a ratio would be one of round-off. At rest part of the largest load: smaller ones are 0."""
_ALMOST_NO_LOAD = 1e-4
"""Load at which round-off is measured where there is none (N)."""
_ROUND_OFF = 1e-3
"""Part of that below which a number is round-off, and is written as 0."""
_STILL = 1e-9
"""Motion of an input (m, rad or its unit) that is round-off."""
_ERRORS = {
    "RMS": "rms",
    "maximum": "maximum",
    "P95": "p95",
    "last tenth": "steady",
}
_LOADS = {
    "max": "largest {} on {}",
    "rms": "{} on {}, RMS",
    "p95": "{} on {}, P95",
}
SHARE = Unit(100.0, "%")
_SELDOM = 1e-3  # share of the time at a limit that is not worth a row


class RunSummary(NamedTuple):
    """A table of texts."""

    heads: list[str]
    rows: list[list[str]]


def summary(result: Result) -> RunSummary:
    """Summarise a run, and the one without control where it exists."""
    others = [] if result.uncontrolled is None else [result.uncontrolled]
    table = _Table(result, [RunStatistics(run) for run in (result, *others)], [])
    with np.errstate(all="ignore"):  # a run that diverged may hold huge numbers
        table.add_errors()
        table.add_inputs()
        table.add_loads()
        table.add_vehicle()
        table.add_contacts()
        table.add_far_contacts()
        table.add_own()
        table.add_solver()
    controlled = result.scenario.control.kind != "none"
    heads = ["", "controlled" if controlled else "value", "uncontrolled", "ratio"]
    return RunSummary(heads[: 2 if len(table.runs) == 1 else 4], table.rows)


class _Table(NamedTuple):
    """Rows of a summary, filled from the registry of measures."""

    result: Result
    runs: list[RunStatistics]
    rows: list[list[str]]

    def measure(self, name: str) -> list[float | None]:
        """Return a measure of each run."""
        return [known(MEASURES[name].read(run)) for run in self.runs]

    def add(
        self,
        name: str,
        values: Sequence[float | None],
        unit: Unit,
        *,
        nothing: float = math.inf,
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
        word = error_word(scenario)
        if begin > 0:
            self.rows.append([f"{word} counts from", f"{begin:g} s"])
        errors = [run.tip for run in self.runs]
        unit = length_unit(max(known(error.maximum) or 0.0 for error in errors))
        self._add_errors(word, errors, unit, _NOTHING * scenario.arm.length)
        if (tolerance := scenario.target.tolerance) is not None:
            within = f"{word} within {length_unit(tolerance).text(tolerance)}"
            self.add(within, self.measure("within_tolerance"), SHARE)
        turns = {"angle", "direction"} & set(scenario.control.controlled)
        if scenario.control.kind != "none" and turns:
            angles = [run.angle for run in self.runs if run.angle is not None]
            self._add_errors("angle error", angles, DEGREES, _NOTHING)

    def _add_errors(
        self, name: str, errors: Sequence[TipError], unit: Unit, nothing: float
    ) -> None:
        for words, field in _ERRORS.items():
            values = [known(getattr(error, field)) for error in errors]
            self.add(f"{name}, {words}", values, unit, nothing=nothing)
        scenario, part = self.result.scenario, name.partition(" ")[0]
        if scenario.target.moves or (scenario.target.frame == "base" and scenario.base.motion):
            return  # the tip is to go away from its mean
        wander = [known(error.fluctuation) for error in errors]
        self.add(f"{part} fluctuation, RMS", wander, unit, nothing=nothing)
        if len(errors) == 2:
            against = [known(errors[0].rms), wander[1]]
            self.add(f"{name} over fluctuation", against, unit, nothing=nothing)

    def add_inputs(self) -> None:
        """Add the use of inputs, and the time at their limits."""
        met = limit_shares(self.result)
        for name, found in input_use(self.result).items():
            use = InputUse(*(value if abs(value) > _STILL else 0.0 for value in found))
            unit = _unit_of(name, self.result, max(-use.low, use.high))
            self.rows.append([f"{name}, RMS", unit.text(use.rms)])
            self.rows.append([f"{name}, range", f"{unit.number(use.low)} to {unit.text(use.high)}"])
            if name in met and max(met[name]) >= _SELDOM:
                at = met[name]._asdict().items()
                shares = [f"{kind} {share:.1%}" for kind, share in at if share]
                self.rows.append([f"{name}, time at limits", ", ".join(shares)])

    def add_loads(self) -> None:
        """Add loads on the base, curvature and strain, which count from the start."""
        base = base_word(self.result.scenario)
        for load, si in (("force", "N"), ("moment", "N m")):
            most = si_unit(max(m or 0.0 for m in self.measure(f"max_base_{load}")), si)
            for kind, label in _LOADS.items():
                values = self.measure(f"{kind}_base_{load}")
                self.add(
                    label.format(load, base),
                    values,
                    most,
                    nothing=_NOTHING,
                )
        arm = self.result.scenario.arm
        along = length_unit(arm.length)
        for name, words, unit, nothing in (
            ("max_curvature", "largest curvature", Unit(1.0, "1/m"), _NOTHING / arm.length),
            ("max_strain", "largest surface strain", SHARE, _NOTHING),
        ):
            values = self.measure(name)
            if values[0] is not None and values[0] > nothing:
                self.add(words, values, unit, nothing=nothing)
                self.add(f"{words}, from root", self.measure(f"{name}_station"), along)
        if (self.measure("curvature_cycles")[0] or 0.0) > 0.0:
            self.add("cycles of curvature", self.measure("curvature_cycles"), Unit(1.0, ""))
            ranges = self.measure("equivalent_curvature_range")
            self.add("equivalent curvature range", ranges, Unit(1.0, "1/m"), nothing=0.0)

    def add_vehicle(self) -> None:
        """Add the motion of a floating submarine, and the use of its thrusters."""
        away = self.measure("vehicle_excursion")
        unit = length_unit(max(value or 0.0 for value in away))
        self.add("submarine's excursion", away, unit, nothing=_NOTHING)
        self.add("submarine's turn", self.measure("vehicle_turn"), DEGREES, nothing=_NOTHING)
        vehicle = self.result.scenario.vehicle
        if vehicle is None or vehicle.hold == "free":
            return
        for name, words in (("max_thrust", "largest thrust"), ("rms_thrust", "thrust, RMS")):
            values = self.measure(name)
            self.add(words, values, si_unit(values[0] or 0.0, "N"), nothing=_NOTHING)
        self.add("thrusters, time at limits", self.measure("thrust_limit_share"), SHARE)

    def add_contacts(self) -> None:
        """Add contacts with obstacles, and of which one each is."""
        found = [run.contact for run in self.runs if run.contact is not None]
        if not found:
            return
        several = self.result.dataset["contact_time"].shape[-1] > 1
        words = ("longest time in contact", "largest contact force", "smallest gap")
        for row, name in enumerate(words):
            cells = []
            for each in found:
                value = (each.time, each.force, each.gap)[row]
                unit = (Unit(1.0, "s"), Unit(1.0, "N"), length_unit(abs(each.gap)))[row]
                text = unit.text(value)
                cells.append(f"obstacle {each.obstacles[row]}: {text}" if several else text)
            self.rows.append([name, *cells])

    def add_far_contacts(self) -> None:
        """Add contact of the arm with itself and with the hull."""
        for part, words in FAR_CONTACTS.items():
            for name, row in (
                (f"{part}_contact_time", f"time in contact with {words}"),
                (f"max_{part}_force", f"largest force on {words}"),
                (f"min_{part}_gap", f"smallest gap from {words}"),
            ):
                values = self.measure(name)
                most = max(abs(value or 0.0) for value in values)
                self.add(row, values, unit_of(MEASURES[name].attributes, most))

    def add_own(self) -> None:
        """Add the measures that a scenario names of packages."""
        for name, measure in measures_of(self.result.scenario).items():
            if name not in MEASURES:
                values = [known(measure.read(run)) for run in self.runs]
                most = max(abs(value or 0.0) for value in values)
                self.add(label_of(name), values, unit_of(measure.attributes, most))

    def add_solver(self) -> None:
        """Add time steps, iterations and speed."""
        data = [run.result.dataset for run in self.runs]
        steps = [int(each["steps"].sum()) for each in data]
        iterations = [int(each["newton_iterations"].sum()) for each in data]
        times = [(float(each["time"][-1]), float(each.attrs["wall_time"])) for each in data]
        spent = [f"{count / max(1, n):.2f}" for count, n in zip(iterations, steps, strict=True)]
        self.rows.append(["simulated", *(f"{end:g} s" for end, _ in times)])
        self.rows.append(["time steps", *map(str, steps)])
        self.rows.append(["Newton iterations a step", *spent])
        fast = [f"{end / max(1e-9, wall):.0f} x" for end, wall in times]
        self.rows.append(["faster than real time", *fast])


def equilibrium_summary(result: Result) -> RunSummary:
    """Sum up an equilibrium."""
    dataset = result.dataset
    rows: list[list[str]] = []

    def add(*row: str) -> None:
        rows.append([*row])

    axes = [str(axis) for axis in dataset["axis"].values]

    length = float(dataset["arc_length"].values[-1])

    def number(value: float, scale: float, digits: int = 4) -> str:
        return f"{0.0 if abs(value) < _NOTHING * scale else value:.{digits}g}"

    def parts(vector: np.ndarray, unit: str, scale: float, digits: int = 4) -> str:
        named = zip(axes, vector, strict=True)
        return ", ".join(f"{axis} {number(part, scale, digits)}{unit}" for axis, part in named)

    add("tip", parts(dataset["tip_position"].values[0], " m", length, 6))
    if "tip_direction" in dataset:
        add("tip direction", parts(dataset["tip_direction"].values[0], "", 1.0))
    else:
        angle = np.rad2deg(float(dataset["tip_angle"][0]))
        add("tip direction", f"{number(angle, 1.0)} degrees")
    force, moment = (dataset[f"base_{name}"].values[0] for name in ("force", "moment"))
    tension = float(dataset["tension"].max())
    base = base_word(result.scenario)
    pull = max(largest(force), abs(tension), _ALMOST_NO_LOAD)
    add(f"force on {base}", parts(force, " N", pull))
    turning = max(largest(np.asarray(moment)), pull * length)
    text = parts(moment, " N m", turning) if moment.ndim else f"{number(moment, turning)} N m"
    add(f"moment on {base}", text)
    add("greatest tension", f"{number(tension, pull)} N")
    bending = dataset["curvature"].values
    curvature = np.linalg.norm(bending, axis=-1) if bending.ndim == 3 else np.abs(bending)
    add("greatest curvature", f"{number(float(curvature.max()), 1 / length)} 1/m")
    if "twist" in dataset:
        twist = float(np.abs(dataset["twist"]).max())
        add("greatest twist", f"{number(twist, 1 / length)} rad/m")
    if "contact_force" in dataset:
        for index, push in enumerate(dataset["contact_force"].values[0]):
            if np.any(push):
                add(f"force of obstacle {index}", parts(push, " N", largest(push)))
    if "natural_frequency" in dataset:
        first = ", ".join(f"{value:.3g}" for value in dataset["natural_frequency"].values[:4])
        add("lowest natural frequencies, without damping", f"{first} Hz")
    return RunSummary(["", "at rest"], rows)


def _unit_of(name: str, result: Result, most: float) -> Unit:
    """Return the unit of an input: of a channel of the base, or as its actuator has it."""
    if name in ANGLES:
        return DEGREES
    if name in CHANNELS[3]:
        return length_unit(most)
    unit = str(result.dataset["input_unit"].sel(input=name).item())
    return SHARE if unit == "1" else si_unit(most, unit)
