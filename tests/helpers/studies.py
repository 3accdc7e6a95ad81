"""Files of results and of studies, made without runs."""

import csv
from pathlib import Path

from crinoid.view.figures.study import read_cases

COLUMNS = ("deflection", "steady_error", "rms_error", "rms_error_uncontrolled", "settling_time")
"""Measures of such a study."""


def save(dataset, path: Path):
    path.parent.mkdir(parents=True, exist_ok=True)
    dataset.to_netcdf(path, engine="netcdf4")
    return path


def write_study(folder: Path, rows):
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / "cases.csv").open("w", newline="", encoding="utf-8") as stream:
        table = csv.DictWriter(stream, fieldnames=list(rows[0]))
        table.writeheader()
        table.writerows(rows)


def study_of_rows(folder: Path, rows):
    """Write the table of a study, and read its cases."""
    write_study(folder, rows)
    return read_cases(folder / "cases.csv")


def study_row(number, **changes):
    row = {
        "deflection": 0.12 / number,
        "steady_error": 0.002 * number,
        "rms_error": 0.006 * number,
        "rms_error_uncontrolled": 0.03 + 0.01 * number,
        "settling_time": 2.0 + number,
        "status": "ok",
        "directory": f"case-{number:02d}",
    }
    keys = {"arm.youngs_modulus": 1e5 * number, "flow.0.velocity": "[0.2, 0.0]"}
    found = {"case": f"case-{number:02d}"} | keys | changes
    return (
        {key: each for key, each in found.items() if key not in row}
        | row
        | {key: each for key, each in changes.items() if key in row}
    )


def grid(folder, rows=(1e5, 2e5, 4e5), columns=("none", "pid")):
    """Write the table of a study over a grid of a number and a word."""
    made, cases = [], [(value, kind) for value in rows for kind in columns]
    for number, (value, kind) in enumerate(cases, start=1):
        row = study_row(number, **{"arm.youngs_modulus": value, "control.kind": kind})
        del row["flow.0.velocity"]
        made.append(row)
    return study_of_rows(folder, made)
