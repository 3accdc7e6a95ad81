"""The table of a study, read with the care that a file of anybody needs."""

import csv
import math
from dataclasses import dataclass
from pathlib import Path

from crinoid.cases import COLUMNS, MEASURES, read_rows
from crinoid.report.run import RESULT, ReportError
from crinoid.status import Status


@dataclass(frozen=True)
class Case:
    """One row of the study: its name, what was varied, what came of it, and where it lies."""

    name: str
    varied: dict[str, str]
    measures: dict[str, float]  # SI; NaN where the table says nothing
    status: str
    directory: str
    result: Path | None


def read_cases(path: Path) -> list[Case]:
    """Read the table of a study."""
    try:
        columns, rows = read_rows(path)
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise ReportError(f"{path}: not a readable table ({error})") from error
    missing = [name for name in COLUMNS if name not in columns]
    if missing:
        text = f"not the table of a study of crinoid's, it lacks the column {missing[0]!r}"
        raise ReportError(f"{path}: {text}")
    if not rows:
        raise ReportError(f"{path}: the table holds no case")
    return [_read_case(path, row) for row in rows]


def _read_case(path: Path, row: dict[str, str | None]) -> Case:
    texts = {name: (value or "").strip() for name, value in row.items() if name is not None}
    measures = {}
    for name in MEASURES:
        try:
            measures[name] = float(texts[name]) if texts[name] else math.nan
        except ValueError as error:
            raise ReportError(
                f"{path}: {name} of {texts['case']} is {texts[name]!r}, not a number"
            ) from error
    # The figures of a case are written into its folder, which a table must not choose freely.
    folder = Path(texts["directory"] or texts["case"])
    if folder.is_absolute() or ".." in folder.parts:
        raise ReportError(f"{path}: {str(folder)!r} is not a folder inside the study")
    result = path.parent / folder / RESULT
    return Case(
        name=texts["case"],
        varied={name: text for name, text in texts.items() if name not in COLUMNS},
        measures=measures,
        status=texts["status"] or Status.OK.value,
        directory=str(folder),
        result=result if result.is_file() else None,
    )


def short_keys(keys: list[str]) -> dict[str, str]:
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
