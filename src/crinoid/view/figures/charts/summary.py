"""Summary of a run in numbers, for its end and its page."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from crinoid.diagnostics.control_loop import limit_shares
from crinoid.foundation.axes import ANGLES, CHANNELS
from crinoid.results.metrics import TipError, angle_error, input_use, peak_load, tip_error
from crinoid.results.result import Result
from crinoid.view.figures.style import DEGREES, Unit, largest, length_unit, si_unit

_NOTHING = 1e-6
"""Part of the arm's length, angle (rad) or load (N, N m) below which there is nothing to compare:
a ratio would be one of round-off."""
_ROUND_OFF = 1e-8
"""Part of the arm's length, the largest load and so on below which a number at rest is 0."""
_ALMOST_NO_LOAD = 1e-4
"""Load at which round-off is measured where there is none (N)."""
_SELDOM = 1e-3  # share of the time at a limit that is not worth a row


class RunSummary(NamedTuple):
    """A table of texts."""

    heads: list[str]
    rows: list[list[str]]


def summary(result: Result) -> RunSummary:
    """Summarise a run, and the one without control where it exists."""
    runs = [result] if result.uncontrolled is None else [result, result.uncontrolled]
    scenario = result.scenario
    controlled = scenario.control.kind != "none"
    heads = ["", "controlled" if controlled else "value", "uncontrolled", "ratio"]
    rows: list[list[str]] = []

    def add(name: str, values: Sequence[float], unit: Unit, nothing: float) -> None:
        cells = [unit.text(value) for value in values]
        if len(values) == 2 and min(values) >= 0 and values[1] > nothing:
            cells.append(f"{values[0] / values[1]:.1%}")
        rows.append([name, *cells])

    def add_errors(name: str, errors: list[TipError], unit: Unit, nothing: float) -> None:
        add(f"{name} error, RMS", [error.rms for error in errors], unit, nothing)
        add(f"{name} error, maximum", [error.maximum for error in errors], unit, nothing)
        add(f"{name} error, last tenth", [error.steady for error in errors], unit, nothing)
        if scenario.target.moves or (scenario.target.frame == "base" and scenario.base.motion):
            return  # the tip is to go away from its mean
        fluctuations = [error.fluctuation for error in errors]
        add(f"{name} fluctuation, RMS", fluctuations, unit, nothing)
        if len(runs) == 2:
            against = [errors[0].rms, errors[1].fluctuation]
            add(f"{name} error over fluctuation", against, unit, nothing)

    errors = [tip_error(run) for run in runs]
    unit = length_unit(max(error.maximum for error in errors))
    add_errors("tip", errors, unit, _NOTHING * scenario.arm.length)
    if controlled and {"angle", "direction"} & set(scenario.control.controlled):
        add_errors("angle", [angle_error(run) for run in runs], DEGREES, _NOTHING)
    met = limit_shares(result)
    for name, use in input_use(result).items():
        unit = _unit_of(name, result, max(-use.low, use.high))
        rows.append([f"{name}, RMS", unit.text(use.rms)])
        rows.append([f"{name}, range", f"{unit.number(use.low)} to {unit.text(use.high)}"])
        if name in met and max(met[name]) >= _SELDOM:
            shares = [f"{kind} {share:.1%}" for kind, share in met[name]._asdict().items() if share]
            rows.append([f"{name}, time at limits", ", ".join(shares)])
    loads = [peak_load(run) for run in runs]
    forces, moments = zip(*loads, strict=True)
    add("largest force on submarine", forces, si_unit(max(forces), "N"), _NOTHING)
    add("largest moment on submarine", moments, si_unit(max(moments), "N m"), _NOTHING)
    if "contact_time" in result.dataset:
        rows += [[name, *contact] for name, contact in _contacts(runs).items()]
    steps = [int(run.dataset["steps"].sum()) for run in runs]
    iterations = [int(run.dataset["newton_iterations"].sum()) for run in runs]
    rows.append(["simulated", *(f"{float(run.dataset.time[-1]):g} s" for run in runs)])
    rows.append(["time steps", *map(str, steps)])
    spent = [f"{count / max(1, n):.2f}" for count, n in zip(iterations, steps, strict=True)]
    rows.append(["Newton iterations a step", *spent])
    times = [
        (float(run.dataset["time"][-1]), float(run.dataset.attrs["wall_time"])) for run in runs
    ]
    fast = [f"{simulated / max(1e-9, wall):.0f} x" for simulated, wall in times]
    rows.append(["faster than real time", *fast])
    return RunSummary(heads[: 2 if len(runs) == 1 else 4], rows)


def equilibrium_summary(result: Result) -> RunSummary:
    """Sum up an equilibrium."""
    dataset = result.dataset
    rows: list[list[str]] = []

    def add(*row: str) -> None:
        rows.append([*row])

    axes = [str(axis) for axis in dataset["axis"].values]

    length = float(dataset["arc_length"].values[-1])

    def number(value: float, scale: float, digits: int = 4) -> str:
        return f"{0.0 if abs(value) < _ROUND_OFF * scale else value:.{digits}g}"

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
    pull = max(largest(force), abs(tension), _ALMOST_NO_LOAD)
    add("force on the submarine", parts(force, " N", pull))
    turning = max(largest(moment), pull * length)
    text = parts(moment, " N m", turning) if moment.ndim else f"{number(moment, turning)} N m"
    add("moment on the submarine", text)
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
        add("lowest natural frequencies", f"{first} Hz")
    return RunSummary(["", "at rest"], rows)


def _unit_of(name: str, result: Result, most: float) -> Unit:
    """Return the unit of an input: of a channel of the base, or as its actuator has it."""
    if name in ANGLES:
        return DEGREES
    if name in CHANNELS[3]:
        return length_unit(most)
    unit = str(result.dataset["input_unit"].sel(input=name).item())
    return Unit(100.0, "%") if unit == "1" else si_unit(most, unit)


def _contacts(runs: list[Result]) -> dict[str, list[str]]:
    """Return the rows about obstacles: the utmost of all, and of which one it is.

    Forces are those at saved instants; times and gaps are over all time steps.
    """
    rows: dict[str, list[str]] = {}
    for data in (run.dataset for run in runs):
        time = data["contact_time"].values[-1]
        force = np.linalg.norm(data["contact_force"].values, axis=2).max(axis=0)
        gap = data["contact_closest"].values[-1]

        def cell(text: str, index: int, count: int = time.size) -> str:
            return text if count == 1 else f"obstacle {index}: {text}"

        longest, hardest, nearest = int(time.argmax()), int(force.argmax()), int(gap.argmin())
        cells = {
            "longest time in contact": cell(f"{time[longest]:.3g} s", longest),
            "largest contact force": cell(f"{force[hardest]:.3g} N", hardest),
            "smallest gap": cell(length_unit(abs(gap[nearest])).text(gap[nearest]), nearest),
        }
        for name, text in cells.items():
            rows.setdefault(name, []).append(text)
    return rows
