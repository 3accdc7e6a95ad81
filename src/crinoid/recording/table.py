"""Reading of text tables: CSV with a header, of instruments, data services and spreadsheets."""

import csv
import os
import re
import warnings
from collections import Counter
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
import xarray as xr

from crinoid.recording.texts import listed, reason_of, short
from crinoid.scenario.errors import refusal, shown

_SUFFIXES = (".csv", ".tsv", ".txt", ".dat", ".csvp", ".csv0", ".tsvp", ".tsv0")
_MAX_BYTES = 500_000_000
_MAX_CELLS = 20_000_000
_SHORTEN = "Cut out a shorter part, or convert it to netCDF."
_MISSING = ["", "-", "--", "n/a", "N/A", "NA", "NaN", "nan", "NAN", "null", "NULL", "None"]
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eEdD][+-]?\d+)?|[+-]?(inf|nan)", re.I)
_ISO = re.compile(r"\d{4}([-/])\d\d\1\d\d")
_DAY_FIRST = re.compile(r"\d{1,2}\.\d{1,2}\.\d{4}\b")
_DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?")
_WITH_UNIT = re.compile(r"(.*?)\s*[\[(]([^\[\]()]*)[\])]")
_COMMENT = re.compile(r"(?:^|(?<=[\s;,]))#")  # Speed#1 is a name
_HEAD = 1 << 16
"""Bytes from which the header and the layout are determined."""
_FIELDS = re.compile(r"Expected (\d+) fields in line (\d+), saw (\d+)")


class _Layout(NamedTuple):
    encoding: str
    skipped: int
    """Lines before the first row of numbers."""
    names: list[str]
    units: list[str]
    separator: str
    """Empty for blanks."""
    decimal: str
    trailing: bool
    """Whether a separator ends each line."""


def reads(file: str, head: bytes) -> bool:
    """Return whether a file is a table, by its suffix."""
    return Path(file).suffix.lower() in _SUFFIXES


def read(file: str) -> xr.Dataset:
    """Read a table: a header with units in brackets or below it, and rows.

    Numbers may be separated by commas, semicolons, tabs or blanks, with a decimal comma unless
    commas separate; lines after # are comments; an empty cell is missing. Dates are ISO, or
    31.12.2024 with the day first.
    """
    name, size = short(file), os.path.getsize(file)
    if size > _MAX_BYTES:
        must = f"have at most {_MAX_BYTES / 1e6:.0f} MB as CSV"
        raise refusal("file", f"{name} has {size / 1e6:.0f} MB", must, _SHORTEN)
    with Path(file).open("rb") as stream:
        layout = _layout(name, stream.read(_HEAD))
    frame = _frame(file, layout)
    columns = {
        column: ("row", *_numbers(frame[column], unit, layout.decimal))
        for column, unit in zip(layout.names, layout.units, strict=True)
    }
    return xr.Dataset(columns)


def _layout(name: str, head: bytes) -> _Layout:
    encoding = _encoding(head)
    try:
        text = head.decode(encoding, errors="replace")
    except (UnicodeError, LookupError):
        text = "\0"
    if "\0" in text:
        raise refusal("file", f"{name} is no text", "be a CSV or netCDF file")
    lines = text.splitlines()
    if len(head) == _HEAD:
        lines = lines[:-1]  # cut in two
    full = [index for index, line in enumerate(lines) if _COMMENT.split(line)[0].strip()]
    declared = re.fullmatch(r"sep=(.)", lines[full[0]].strip()) if full else None  # as Excel has it
    full = full[1:] if declared else full
    if not full:
        raise refusal("file", f"{name} has no rows", "have a header and rows of numbers")
    first = full[0]
    header, rows = _COMMENT.split(lines[first])[0], [lines[index] for index in full[1:]]
    separator = declared[1] if declared else next((mark for mark in "\t;," if mark in header), "")
    fields, skipped = _fields(header, separator), first + 1
    if all(map(_is_value, fields)):
        # as NumPy writes it, the header is a comment
        comments = [line.lstrip("# \t") for line in lines[:first] if line.strip().startswith("#")]
        names = _fields(comments[-1], separator) if comments else []
        if len(names) != len(fields):
            must = "have a first line of names such as time, u, w"
            hint = "Of ERDDAP load .csvp, which has names, in place of .csv0."
            raise refusal("file", f"{name} begins with numbers", must, hint)
        rows, fields, skipped = [header, *rows], names, first
    units = [""] * len(fields)
    for index, field in enumerate(fields):
        if found := _WITH_UNIT.fullmatch(field):
            fields[index], units[index] = found[1], found[2].strip()
    if rows and skipped > first:
        below = _fields(_COMMENT.split(rows[0])[0], separator)
        words = any(below) and not any(_is_value(cell) and cell != "1" for cell in below)
        if len(below) == len(fields) and words and len(rows) > 1:
            next_ones = _fields(_COMMENT.split(rows[1])[0], separator)
            if any(_is_value(cell) and cell != "1" for cell in next_ones):
                units, skipped = [u.strip("[]()") for u in below], full[1] + 1
    cells = [_fields(_COMMENT.split(row)[0], separator) for row in rows[:100]]
    trailing = any(len(row) == len(fields) + 1 and not row[-1] for row in cells)
    if len(fields) > 1 and not fields[-1]:
        trailing, fields, units = True, fields[:-1], units[:-1]
    names = [field or f"column {index + 1}" for index, field in enumerate(fields)]
    twice = [field for field, count in Counter(names).items() if count > 1]
    if twice:
        text = f"{name} has several columns {listed(twice)}"
        raise refusal("file", text, "have each name once")
    comma = any(_DECIMAL_COMMA.fullmatch(cell) for row in cells for cell in row)
    decimal = "," if separator != "," and comma else "."
    return _Layout(encoding, skipped, names, units, separator, decimal, trailing)


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
    if not separator:  # a unit in brackets may stand apart
        return re.findall(r"\S+(?:[ \t]*[\[(][^\])]*[\])])?", line)
    return [field.strip() for field in next(csv.reader([line], delimiter=separator), [])]


def _frame(file: str, layout: _Layout) -> pd.DataFrame:
    name = Path(file).name
    names = [*layout.names, *[""] * layout.trailing]
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", pd.errors.ParserWarning)
            frame = pd.read_csv(
                file,
                sep=layout.separator or r"\s+",
                decimal=layout.decimal,
                encoding=layout.encoding,
                encoding_errors="replace",
                header=None,
                names=names,
                index_col=False,
                skiprows=layout.skipped,
                comment="#",
                skipinitialspace=True,
                na_values=_MISSING,
                keep_default_na=False,
                low_memory=False,
            )
    except pd.errors.EmptyDataError:
        frame = pd.DataFrame({column: [] for column in names})
    except pd.errors.ParserWarning as error:
        must = f"have {len(layout.names)} values in each row, as in its header"
        raise refusal("file", f"{name} has longer rows", must) from error
    except pd.errors.ParserError as error:
        if found := _FIELDS.search(str(error)):
            width, line, count = found.groups()
            text = f"{name} has {count} values in line {line}"
            raise refusal("file", text, f"have {width}, as in its header") from error
        raise refusal("file", f"{name} is no CSV file ({reason_of(error)})") from error
    except Exception as error:  # libraries raise anything on a damaged file
        raise refusal("file", f"{name} is broken or no CSV file ({reason_of(error)})") from error
    if frame.size > _MAX_CELLS:
        text = f"{name} contains {frame.size} values"
        raise refusal("file", text, f"contain at most {_MAX_CELLS}", _SHORTEN)
    return frame[layout.names].dropna(how="all")


def _numbers(column: pd.Series, unit: str, decimal: str) -> tuple[np.ndarray, dict[str, str]]:
    """Return the numbers of a column, or its texts, with its attributes."""
    attributes = {"units": unit} if unit else {}
    if column.dtype.kind in "iuf":
        return column.to_numpy(), attributes
    texts = column.astype(str).where(column.notna())
    dates = _dates(texts)
    if dates is not None and dates.notna().all():
        count = dates.dt.tz_localize(None).to_numpy().astype("datetime64[us]").astype(np.int64)
        return count, {"units": "microseconds since 1970-01-01"}
    plain = texts.str.replace(",", ".") if decimal == "," else texts
    numbers = pd.to_numeric(plain, errors="coerce")
    odd = column[numbers.isna() & column.notna()]
    if decimal == ",":  # a dot may separate thousands, or be a slip
        odd = column[(numbers.isna() | texts.str.contains(".", regex=False)) & column.notna()]
    if odd.empty:
        return numbers.to_numpy(float), attributes
    if dates is not None and dates.notna().any():
        odd = column[dates.isna()]
    slip = ", a point among decimal commas" if decimal == "," and "." in str(odd.iloc[0]) else ""
    attributes["odd"] = f"{shown(str(odd.iloc[0]))} in row {int(odd.index[0]) + 1}{slip}"
    return texts.fillna("").to_numpy(object), attributes


def _dates(texts: pd.Series) -> pd.Series | None:
    """Return the instants of a column that begins with a date; None without one."""
    first = str(texts.iloc[0]) if len(texts) else ""
    if _ISO.match(first):
        dotted = texts.str.replace(",", ".").str.replace(
            "/", "-"
        )  # ISO 8601 allows a comma before parts of a second
        return pd.to_datetime(dotted, format="ISO8601", errors="coerce", utc=True)
    if not _DAY_FIRST.match(first):
        return None
    dotted = texts.str.replace(r"(:\d\d),(\d)", r"\1.\2", regex=True)
    form = ("%d.%m.%Y", "%d.%m.%Y %H:%M", "%d.%m.%Y %H:%M:%S")[min(first.count(":"), 2)]
    form += ".%f" if re.search(r":\d\d[.,]\d", first) else ""
    return pd.to_datetime(dotted, format=form, errors="coerce", utc=True)
