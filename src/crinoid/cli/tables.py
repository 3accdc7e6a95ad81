"""The tables that close a command."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from rich import box
from rich.table import Table

from crinoid.report.charts.summary import summary
from crinoid.report.units import largest, length_unit
from crinoid.result import Result
from crinoid.scenario import Scenario

_VARIED_WIDTH = 23
"""Characters that a study's table has for what was varied, beside its measures in 80 columns."""


def run_table(result: Result) -> Table:
    """Sum up a run, beside the one without control if there is one."""
    found = summary(result)
    table = Table(title=result.dataset.attrs["title"], title_justify="left")
    for index, name in enumerate(found.heads):
        table.add_column(name, justify="right" if index else "left")
    for row in found.rows:
        table.add_row(*row)
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


def _value(value: Any) -> str:
    if isinstance(value, list):
        return f"[{', '.join(_value(item) for item in value)}]"
    return f"{value:.3g}" if isinstance(value, float) else str(value)
