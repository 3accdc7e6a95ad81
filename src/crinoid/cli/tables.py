"""The tables that close a command."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from rich import box
from rich.table import Table

from crinoid.loop_health import limits_met
from crinoid.metrics import TipError, angle_error, input_use, peak_load, tip_error
from crinoid.report.units import DEGREES, Unit, largest, length_unit, si_unit
from crinoid.result import Result
from crinoid.scenario import Scenario
from crinoid.space import ANGLES, CHANNELS

_NOTHING = 1e-6
"""Part of the arm's length, angle (rad) or load (N, N m) below which there is nothing to compare:
a ratio would be one of round-off."""
_SELDOM = 1e-3
"""Share of the time at a limit that is not worth a row."""
_VARIED_WIDTH = 23
"""Characters that a study's table has for what was varied, beside its measures in 80 columns."""


def run_table(result: Result) -> Table:
    """Sum up a run, beside the one without control if there is one."""
    runs = [result] if result.uncontrolled is None else [result, result.uncontrolled]
    table = Table(title=result.dataset.attrs["title"], title_justify="left")
    table.add_column("")
    scenario = result.scenario
    controlled = scenario.control.kind != "none"
    for name in ["controlled" if controlled else "value", "uncontrolled"][: len(runs)]:
        table.add_column(name, justify="right")
    if len(runs) == 2:
        table.add_column("ratio", justify="right")

    def add(name: str, values: Sequence[float], unit: Unit, nothing: float) -> None:
        cells = [unit.text(value) for value in values]
        if len(values) == 2 and min(values) >= 0 and values[1] > nothing:
            cells.append(f"{values[0] / values[1]:.1%}")
        table.add_row(name, *cells)

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
    met = limits_met(result)
    for name, use in input_use(result).items():
        unit = _unit_of(name, result, max(-use.low, use.high))
        table.add_row(f"{name}, RMS", unit.text(use.rms))
        table.add_row(f"{name}, range", f"{unit.number(use.low)} to {unit.text(use.high)}")
        if name in met and max(met[name]) >= _SELDOM:
            shares = [f"{kind} {share:.1%}" for kind, share in met[name]._asdict().items() if share]
            table.add_row(f"{name}, time at limits", ", ".join(shares))
    loads = [peak_load(run) for run in runs]
    forces, moments = zip(*loads, strict=True)
    add("largest force on submarine", forces, si_unit(max(forces), "N"), _NOTHING)
    add("largest moment on submarine", moments, si_unit(max(moments), "N m"), _NOTHING)
    if "contact_time" in result.dataset:
        for name, contact in _contacts(runs).items():
            table.add_row(name, *contact)
    steps = [int(run.dataset["steps"].sum()) for run in runs]
    iterations = [int(run.dataset["newton_iterations"].sum()) for run in runs]
    table.add_row("simulated", *(f"{float(run.dataset.time[-1]):g} s" for run in runs))
    table.add_row("time steps", *map(str, steps))
    table.add_row(
        "Newton iterations a step",
        *(f"{count / max(1, n):.2f}" for count, n in zip(iterations, steps, strict=True)),
    )
    table.add_row("faster than real time", *(f"{_speed(run):.0f} x" for run in runs))
    return table


def equilibrium_table(result: Result) -> Table:
    """Sum up an equilibrium."""
    dataset = result.dataset
    table = Table(title=dataset.attrs["title"], title_justify="left", show_header=False)
    axes = [str(axis) for axis in dataset["axis"].values]

    def parts(vector: np.ndarray, unit: str, digits: int = 4) -> str:
        named = zip(axes, vector, strict=True)
        return ", ".join(f"{axis} {part:.{digits}g}{unit}" for axis, part in named)

    table.add_row("tip", parts(dataset["tip_position"].values[0], " m", 6))
    if "tip_direction" in dataset:
        table.add_row("tip direction", parts(dataset["tip_direction"].values[0], ""))
    else:
        angle = np.rad2deg(float(dataset["tip_angle"][0]))
        table.add_row("tip direction", f"{angle:.4g} degrees")
    moment = dataset["base_moment"].values[0]
    table.add_row("force on the submarine", parts(dataset["base_force"].values[0], " N"))
    table.add_row(
        "moment on the submarine", parts(moment, " N m") if moment.ndim else f"{moment:.4g} N m"
    )
    table.add_row("greatest tension", f"{float(dataset['tension'].max()):.4g} N")
    bending = dataset["curvature"].values
    curvature = np.linalg.norm(bending, axis=-1) if bending.ndim == 3 else np.abs(bending)
    table.add_row("greatest curvature", f"{float(curvature.max()):.4g} 1/m")
    if "twist" in dataset:
        table.add_row("greatest twist", f"{float(np.abs(dataset['twist']).max()):.4g} rad/m")
    if "contact_force" in dataset:
        for index, push in enumerate(dataset["contact_force"].values[0]):
            if np.any(push):
                table.add_row(f"force of obstacle {index}", parts(push, " N"))
    if "natural_frequency" in dataset:
        first = ", ".join(f"{value:.3g}" for value in dataset["natural_frequency"].values[:4])
        table.add_row("lowest natural frequencies", f"{first} Hz")
    return table


def cases_table(scenario: Scenario, rows: list[dict[str, Any]]) -> Table:
    """Compare the cases of a study; what no case knows has no column."""
    table = Table(title=scenario.title, title_justify="left", box=box.SIMPLE, pad_edge=False)
    table.add_column("case", no_wrap=True)
    names = _short_keys(list(scenario.vary))
    values = [[_value(row[key]) for key in names] for row in rows]
    wide = [
        max(len(text) for text in (*_folded(short).split("\n"), *column))
        for short, column in zip(names.values(), zip(*values, strict=True), strict=True)
    ]
    beside = sum(wide) + 3 * (len(wide) - 1) <= _VARIED_WIDTH
    if beside:
        for short in names.values():
            table.add_column(_folded(short), justify="right", no_wrap=True)
    else:  # one below the other in each case
        table.add_column("varied", max_width=_VARIED_WIDTH, overflow="fold")
    columns: list[Callable[[dict[str, Any]], str]] = []
    lengths = {"steady_error": "steady\nerror", "rms_error": "RMS\nerror"}
    if any(row["rms_error_uncontrolled"] != "" for row in rows):
        lengths |= {"deflection": "steady,\nfree", "rms_error_uncontrolled": "RMS,\nfree"}
    for name, heading in lengths.items():
        known = [row[name] for row in rows if row[name] != ""]
        unit = length_unit(largest(np.array(known, dtype=float)))
        table.add_column(f"{heading}\n({unit.name})", justify="right", no_wrap=True)
        columns.append(
            lambda row, name=name, unit=unit: "" if row[name] == "" else unit.number(row[name])
        )
    table.add_column("settled\n(s)", justify="right", no_wrap=True)
    for row, varied in zip(rows, values, strict=True):
        if not beside:
            below = zip(names.values(), varied, strict=True)
            varied = ["\n".join(_folded(short, _VARIED_WIDTH, text) for short, text in below)]
        table.add_row(
            row["case"].removeprefix("case-"),
            *varied,
            *(column(row) for column in columns),
            "not" if row["settling_time"] == "" else f"{row['settling_time']:.2f}",
        )
    return table


def _short_keys(keys: list[str]) -> dict[str, str]:
    """Return keys with as many of their last parts as tell them apart."""
    short = {}
    for key in keys:
        parts, others = key.split("."), [other.split(".") for other in keys if other != key]
        taken = 1
        while taken < len(parts) and (
            parts[-taken].isdigit() or any(o[-taken:] == parts[-taken:] for o in others)
        ):
            taken += 1
        short[key] = ".".join(parts[-taken:])
    return short


def _folded(key: str, width: int = 9, value: str = "") -> str:
    """Return a key, and a value behind it, on lines that end at the key's dots and underscores."""
    lines = [""]
    pieces = key.replace(".", ".\0").replace("_", "_\0").split("\0")
    for piece in [*pieces, *([f" {value}"] if value else [])]:
        if lines[-1] and len(lines[-1]) + len(piece) > width:
            lines.append("")
        lines[-1] += piece
    return "\n".join(lines)


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

    Forces are those at saved instants; times and gaps tell of all time steps.
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


def _value(value: Any) -> str:
    if isinstance(value, list):
        return f"[{', '.join(_value(item) for item in value)}]"
    return f"{value:.3g}" if isinstance(value, float) else str(value)


def _speed(result: Result) -> float:
    return float(result.dataset["time"][-1]) / max(1e-9, float(result.dataset.attrs["wall_time"]))
