"""Reading of text tables: CSV with a header, of instruments, data services and spreadsheets."""

import csv
import os
import re
import warnings
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from crinoid.recording import cells
from crinoid.recording.numbers import check_count
from crinoid.recording.texts import MINUS, listed, short
from crinoid.scenario.errors import refusal, shown

SUFFIXES = (".csv", ".tsv", ".txt", ".dat", ".out", ".csvp", ".csv0", ".tsvp", ".tsv0")
_MAX_BYTES = 500_000_000
_NAMES_FIRST = "The names must be the first line: mark others above them by #."
_MISSING = ["", "-", "--", "n/a", "N/A", "NA", "NaN", "nan", "NAN", "null", "NULL", "None", "MM"]
_OPTIONS: dict[str, Any] = {
    "comment": "#",
    "encoding_errors": "replace",
    "header": None,
    "index_col": False,
    "keep_default_na": False,
    "low_memory": False,
    "na_values": _MISSING,
    "skipinitialspace": True,
}
"""Options of pandas for all tables."""
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eEdD][+-]?\d+)?|[+-]?(inf|nan)", re.I)
_ISO = re.compile(r"\d{4}([-/])\d\d\1\d\d")
_DAY_FIRST = re.compile(r"\d{1,2}\.\d{1,2}\.\d{4}\b")
_DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?")
_WHOLE = re.compile(r"[+-]?\d+")
_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2},\d{3}")
_WITH_UNIT = re.compile(r'(.*?)\s*[\[(](?:unit="?)?([^\[\]()"]*)"?[\])]')
_COMMENT = re.compile(r"(?:^|(?<=[\s;,]))#")  # Speed#1 is a name
_BUOY = re.compile(r"#?\s*YYY?Y?\s+MM\s+DD\s+hh")
_PREAMBLES = {r"sep=.\s*\n": [0], r'"?TOA5\b': [0, 3], r'"?Plot Title': [0]}
"""Lines besides names and units, of a spreadsheet, of Campbell and of HOBO."""
_OPENFAST = re.compile(r"\s*\(s\)\s+\(")  # line of units, below a text and the names
_HEAD = 1 << 16  # bytes from which the header and the layout are determined
_FIELDS = re.compile(r"Expected (\d+) fields in line (\d+), saw (\d+)")


def reads(file: str, head: bytes) -> bool:
    """Return whether a file is a table, by its suffix or as that of a buoy of NDBC."""
    return Path(file).suffix.lower() in SUFFIXES or bool(_BUOY.match(head[:100].decode("latin")))


def read(file: str) -> xr.Dataset:
    """Read a table: a header with units in brackets or below it, and rows.

    Numbers may be separated by commas, semicolons, tabs or blanks, with a decimal comma unless
    commas separate; lines after # are comments; an empty cell is missing. Dates are ISO, or
    31.12.2024 with the day first.
    """
    name, size = short(file), os.path.getsize(file)
    if size > _MAX_BYTES:
        must = f"have at most {_MAX_BYTES / 1e6:.0f} MB as CSV"
        hint = "Cut out a shorter part, or convert it to netCDF."
        raise refusal("file", f"{name} has {size / 1e6:.0f} MB", must, hint)
    with Path(file).open("rb") as stream:
        options, attributes = _layout(name, stream.read(_HEAD))
    _check_comments(file, options, len(attributes))
    frame = _frame(file, options, list(attributes))
    columns = {
        column: ("row", *_numbers(frame[column], about, options["decimal"]))
        for column, about in attributes.items()
    }
    return cells.as_arrays(cells.with_dates(xr.Dataset(columns)))


def _layout(name: str, head: bytes) -> tuple[dict[str, Any], dict[str, dict[str, str]]]:
    """Return how pandas reads a table that begins so, and the attributes of each column."""
    encoding = _encoding(head)
    text = head.decode(encoding, errors="replace")
    if "\0" in text:
        raise refusal("file", f"{name} is no text", "be a CSV or netCDF file")
    lines = text.splitlines()[: -1 if len(head) == _HEAD else None]  # the last is cut in two
    declared = re.match(r"sep=(.)", text)
    for pattern, places in _PREAMBLES.items():
        if re.match(pattern, text):
            lines = ["" if index in places else line for index, line in enumerate(lines)]
    if _BUOY.match(text):
        lines[:2] = [line.lstrip("#") for line in lines[:2]]
    for index, line in enumerate(lines[1:]):
        if _OPENFAST.match(line) and re.match(r"\s*Time\s", lines[index]):
            lines[:index] = [""] * index
            break
    full = [index for index, line in enumerate(lines) if _COMMENT.split(line)[0].strip()]
    if not full:
        raise refusal("file", f"{name} has no rows", "have a header and rows of numbers")
    first = _COMMENT.split(lines[full[0]])[0]
    separator = declared[1] if declared else next((mark for mark in "\t;," if mark in first), "")
    rows = [_fields(_COMMENT.split(lines[index])[0], separator) for index in full]
    fields, start = rows[0], 1
    if all(map(_is_value, fields)):
        # as NumPy writes it, the header is a comment
        above = [line.lstrip("# \t") for line in lines[: full[0]] if line.strip().startswith("#")]
        names = _fields(above[-1], separator) if above else []
        if len(names) != len(fields):
            must = "have a first line of names such as time, u, w"
            hint = "Of ERDDAP load .csvp, which has names, in place of .csv0."
            raise refusal("file", f"{name} begins with numbers", must, hint)
        fields, start = names, 0
    fields[0] = fields[0].removeprefix("%")  # as rostopic writes it
    named = [_WITH_UNIT.fullmatch(field) for field in fields]
    units = [found[2].strip() if found else "" for found in named]
    fields = [found[1] if found else each for found, each in zip(named, fields, strict=True)]
    below, after = [*rows[1:3], [], []][:2]
    words = len(below) == len(fields) and any(below) and not _has_value(below)
    if start and words and _has_value(after):
        units, start = [each.strip("[]()") for each in below], 2
    rows, skipped = rows[start:], [*full, len(lines)][start]
    trailing = any(len(row) == len(fields) + 1 and not row[-1] for row in rows)
    if len(fields) > 1 and not fields[-1]:
        trailing, fields, units = True, fields[:-1], units[:-1]
    names = [field or f"column {index + 1}" for index, field in enumerate(fields)]
    if twice := [field for field, count in Counter(names).items() if count > 1]:
        raise refusal("file", f"{name} has several columns {listed(twice)}", "have each name once")
    comma = any(_DECIMAL_COMMA.fullmatch(cell) for row in rows for cell in row)
    decimal = "," if separator != "," and comma else "."
    columns = [{"units": unit} if unit else {} for unit in units]
    for index, attributes in enumerate(columns if decimal == "," else []):
        attributes |= _thousands([row[index] for row in rows if index < len(row)])
    return {
        "encoding": encoding,
        "skiprows": skipped,
        "names": [*names, *[""] * trailing],  # a separator may end each line
        "sep": separator or r"\s+",
        "decimal": decimal,
    }, dict(zip(names, columns, strict=True))


def _thousands(cells: list[str]) -> dict[str, str]:
    """Return the remark on commas in a column if all may separate thousands."""
    odd = [cell for cell in cells if _THOUSANDS.fullmatch(cell)]
    others = {*cells} - {*odd, ""}
    if not odd or not all(map(_WHOLE.fullmatch, others)):
        return {}
    return {"odd": f"{odd[0]} among whole numbers"} if others else {"comma": odd[0]}


def _has_value(row: list[str]) -> bool:
    return any(_is_value(cell) and cell != "1" for cell in row)


def _is_value(cell: str) -> bool:
    """Return whether a cell has a number or a date."""
    dated = _ISO.match(cell) or _DAY_FIRST.match(cell)
    return bool(dated or _NUMBER.fullmatch(cell) or _DECIMAL_COMMA.fullmatch(cell))


def _encoding(head: bytes) -> str:
    if head.startswith((b"\xff\xfe", b"\xfe\xff")):
        return "utf-16"
    try:
        head[:-4].decode("utf-8")  # less what may be cut in two
    except UnicodeDecodeError as error:
        return "utf-8-sig" if error.start >= len(head) - 8 else "cp1252"
    return "utf-8-sig"


def _fields(line: str, separator: str) -> list[str]:
    line = line.replace(MINUS, "-")
    if not separator:  # a unit in brackets may stand apart
        return re.findall(r"\S+(?:[ \t]*[\[(][^\])]*[\])])?", line)
    row = next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])
    return [field.strip() for field in row]


def _check_comments(file: str, options: dict[str, Any], count: int) -> None:
    """Refuse a row with a # before its last value, as in ``Buoy #3`` or ``#N/A`` of a spreadsheet.

    A comment begins there, and the values after it would be lost.
    """
    separator = options["sep"] if len(options["sep"]) == 1 else ""
    with open(file, encoding=options["encoding"], errors="replace") as stream:
        for number, line in enumerate(stream, start=1):
            before, mark, _ = line.partition("#")
            if not mark or number <= options["skiprows"] or not before.strip():
                continue
            if len(_fields(before, separator)) < count:
                text = f"{short(file)} has a # before the last value in line {number}"
                hint = "Leave a cell without a value empty."
                raise refusal("file", text, "have comments at the end of a row", hint)


def _frame(file: str, options: dict[str, Any], names: list[str]) -> pd.DataFrame:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", pd.errors.ParserWarning)
            frame = pd.read_csv(file, **_OPTIONS, **options)
    except pd.errors.EmptyDataError:
        frame = pd.DataFrame({column: [] for column in options["names"]})
    except (pd.errors.ParserWarning, pd.errors.ParserError) as error:
        text, must = f"{short(file)} has longer rows", f"have {len(names)} values in each row"
        if found := _FIELDS.search(str(error)):
            text = f"{short(file)} has {found[3]} values in line {found[2]}"
            must = f"have {found[1]}"
        raise refusal("file", text, f"{must}, as in its header", _NAMES_FIRST) from error
    check_count(frame.size, file, "all columns")
    return frame[names].dropna(how="all")


def _numbers(
    column: pd.Series, attributes: dict[str, str], decimal: str
) -> tuple[np.ndarray, dict[str, str]]:
    """Return the numbers of a column, its instants, or its texts, with its attributes."""
    if column.dtype.kind in "iuf":
        return column.to_numpy(), attributes
    texts = column.astype(str).where(column.notna()).str.replace(MINUS, "-")
    dates = _dates(texts)
    numbers = pd.to_numeric(texts.str.replace(decimal, ".", regex=False), errors="coerce")
    # a point among decimal commas separates thousands, or is a slip
    points = texts.str.contains(".", regex=False, na=False) & (decimal == ",")
    dated = bool(dates.notna().any())
    wrong = dates.isna() if dated else (numbers.isna() | points) & column.notna()
    if dated and not wrong.any():
        count = dates.dt.tz_localize(None).to_numpy().astype("datetime64[us]").astype(np.int64)
        return count, {"units": "microseconds since 1970-01-01"}
    if not wrong.any():
        return numbers.to_numpy(float), attributes
    first = texts[wrong].iloc[0]
    said = "an empty cell" if pd.isna(first) else shown(first)
    slip = ", a point among decimal commas" if points[wrong].iloc[0] and not dated else ""
    attributes["odd"] = f"{said} in row {int(texts[wrong].index[0]) + 1}{slip}"
    return texts.fillna("").to_numpy(object), attributes


def _dates(texts: pd.Series) -> pd.Series:
    """Return the instants of a column that begins with a date; none without one."""
    first, form = str(texts.iloc[0]) if len(texts) else "", "ISO8601"
    dotted = texts.str.replace(r"(:\d\d),(\d)", r"\1.\2", regex=True)
    if _ISO.match(first):
        dotted = dotted.str.replace("/", "-")
    elif _DAY_FIRST.match(first):
        form = "%d.%m.%Y" + ["", " %H:%M", " %H:%M:%S"][min(first.count(":"), 2)]
        form += ".%f" if re.search(r":\d\d[.,]\d", first) else ""
    else:
        return pd.Series(pd.NaT, texts.index)
    return pd.to_datetime(dotted, format=form, errors="coerce", utc=True)
