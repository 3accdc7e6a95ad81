"""The tables that close a command."""

from __future__ import annotations

from typing import Any

import numpy as np
from rich import box
from rich.markup import escape
from rich.table import Table

from crinoid.metrics import tip_error
from crinoid.result import Result
from crinoid.scenario import Scenario


def run_table(result: Result) -> Table:
    """Sum up a run, beside the one without control if there is one."""
    runs = [result] if result.uncontrolled is None else [result, result.uncontrolled]
    table = Table(title=escape(result.dataset.attrs["title"]), title_justify="left")
    table.add_column("")
    controlled = result.scenario.control.kind != "none"
    for name in ["controlled" if controlled else "value", "uncontrolled"][: len(runs)]:
        table.add_column(name, justify="right")
    if len(runs) == 2:
        table.add_column("ratio", justify="right")

    errors = [tip_error(run) for run in runs]

    def lengths(name: str, values: list[float], *, ratio: bool = False) -> None:
        cells = [f"{1e3 * value:.2f} mm" for value in values]
        if ratio and len(values) == 2 and values[1] > 0:
            cells.append(f"{values[0] / values[1]:.1%}")
        table.add_row(name, *cells)

    lengths("tip error, RMS", [error.rms for error in errors], ratio=True)
    lengths("tip error, maximum", [error.maximum for error in errors], ratio=True)
    lengths("tip error, last tenth", [error.steady for error in errors], ratio=True)
    lengths("tip about its mean, RMS", [error.fluctuation for error in errors])
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
    table = Table(title=escape(dataset.attrs["title"]), title_justify="left", show_header=False)
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
    """Compare the cases of a study, lengths in mm and times in s."""
    table = Table(
        title=escape(scenario.title), title_justify="left", box=box.SIMPLE, pad_edge=False
    )
    table.add_column("case", no_wrap=True)
    last = [key.rpartition(".")[2] for key in scenario.vary]
    for key, short in zip(scenario.vary, last, strict=True):
        heading = short if last.count(short) == 1 else key
        table.add_column(heading, justify="right", overflow="fold")
    lengths = {
        "deflection": "without control (mm)",
        "steady_error": "steady error (mm)",
        "rms_error": "RMS (mm)",
        "rms_error_uncontrolled": "RMS without (mm)",
    }
    for heading in (*lengths.values(), "settled (s)"):
        table.add_column(heading, justify="right")
    for row in rows:
        table.add_row(
            row["case"].removeprefix("case-"),
            *(escape(_value(row[key])) for key in scenario.vary),
            *("" if row[name] == "" else f"{1e3 * row[name]:.2f}" for name in lengths),
            "not" if row["settling_time"] == "" else f"{row['settling_time']:.2f}",
        )
    return table


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
            "smallest gap": cell(f"{1e3 * gap[nearest]:.2f} mm", nearest),
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
