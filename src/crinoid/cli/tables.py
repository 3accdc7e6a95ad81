"""The tables that close a command."""

from collections.abc import Callable
from typing import Any

import numpy as np
from rich import box
from rich.table import Table

from crinoid.report.charts.summary import equilibrium_summary, summary
from crinoid.report.table import short_keys
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
    title = result.dataset.attrs["title"]
    table = Table(title=title, title_justify="left", show_header=False)
    for row in equilibrium_summary(result).rows:
        table.add_row(*row)
    return table


def cases_table(scenario: Scenario, rows: list[dict[str, Any]]) -> Table:
    """Compare the cases of a study; what no case knows has no column."""
    table = Table(title=scenario.title, title_justify="left", box=box.SIMPLE, pad_edge=False)
    table.add_column("case", no_wrap=True)
    names = short_keys(list(scenario.vary))
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
