"""The table of a study: one row for each case."""

import csv
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from crinoid.replacement import replacing

__all__ = ["CASES", "COLUMNS", "MEASURES", "case_name", "is_table", "read_rows", "write_rows"]

CASES = "cases.csv"
MEASURES = ("deflection", "steady_error", "rms_error", "rms_error_uncontrolled", "settling_time")
COLUMNS = ("case", *MEASURES, "status", "directory")
"""Columns that every table has; those of the keys that vary stand after the first."""


def case_name(number: int, cases: int) -> str:
    """Return the name of a study's case, from 1 on, which is that of its folder."""
    return f"case-{number:0{max(2, len(str(cases)))}d}"


def is_table(path: Path) -> bool:
    """Tell whether a file is the table of a study, by its header."""
    try:
        with path.open(newline="", encoding="utf-8") as file:
            header = next(csv.reader(file), [])
    except (OSError, UnicodeDecodeError, csv.Error):
        return False
    return header[:1] == [COLUMNS[0]] and header[-1:] == [COLUMNS[-1]]


def read_rows(path: Path) -> tuple[list[str], list[dict[str, Any]]]:
    """Return the columns of a table and its rows."""
    with path.open(newline="", encoding="utf-8") as file:
        table = csv.DictReader(file)
        return list(table.fieldnames or []), list(table)


def write_rows(path: Path, rows: Iterable[dict[str, Any]]) -> None:
    """Write a table of at least one row, whole or not at all."""
    with (
        replacing(path) as temporary,
        temporary.open("w", newline="", encoding="utf-8") as file,
    ):
        following = iter(rows)
        first = next(following)
        writer = csv.DictWriter(file, list(first))
        writer.writeheader()
        writer.writerow(first)
        writer.writerows(following)
