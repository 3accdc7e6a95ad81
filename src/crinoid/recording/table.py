"""Reading of CSV files into datasets like those of netCDF files."""

import csv
import math
import os
import re
import warnings
from collections import Counter
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
import xarray as xr

from crinoid.scenario.errors import refusal, shown
from crinoid.scenario.flow import Component

_NAMED = 12
MARKED = "Mark missing values by an empty cell, or in a netCDF file by a _FillValue."


def reason_of(error: Exception) -> str:
    """Return the reason of an error in one line."""
    return " ".join(str(getattr(error, "strerror", None) or error).split())[:200]


def listed(names: list[str]) -> str:
    """Return the first dozen names, with commas between them."""
    more = len(names) - _NAMED
    return ", ".join(names[:_NAMED]) + (f" and {more} more" if more > 0 else "")


_MARKS = (999, 999.9, 999.99, 9999, 9999.9, 9999.99, 99999, 99999.9, 999999, 32767, 32768)
"""Usual marks of missing values: nines, and the ends of a 16-bit counter."""
_CLOSE = 1e-6
"""Relative error of numbers in single precision."""


def check_marks(numbers: np.ndarray, key: str, name: str) -> None:
    """Refuse a variable with a mark of missing values among its numbers.

    A mark differs from the other numbers by more than they differ from each other: 999 between
    998 and 1000 is a number.
    """
    found = numbers[np.isfinite(numbers)].astype(float)
    marked = np.zeros(found.size, bool)
    large = np.flatnonzero(np.abs(found) > _MARKS[0] * (1 - _CLOSE))
    for mark in _MARKS:
        marked[large] |= np.isclose(np.abs(found[large]), mark, rtol=_CLOSE, atol=0)
    if not marked.any():
        return
    others, marks = found[~marked], found[marked]
    if others.size:
        low, high = others.min(), others.max()
        marks = marks[np.maximum(low - marks, marks - high) > high - low]
    if marks.size:
        text = f"{name} contains {marks[0]:g}, far from its other numbers"
        raise refusal(key, text, "contain measured values only", MARKED)


_LENGTHS = {
    **dict.fromkeys(("m", "meter", "meters", "metre", "metres"), 1.0),
    **dict.fromkeys(("cm", "centimeter", "centimeters", "centimetre", "centimetres"), 1e-2),
    **dict.fromkeys(("mm", "millimeter", "millimeters", "millimetre", "millimetres"), 1e-3),
}
_ANGLES = {
    **dict.fromkeys(("deg", "degree", "degrees", "\N{DEGREE SIGN}"), math.radians(1.0)),
    **dict.fromkeys(("rad", "radian", "radians"), 1.0),
}
_SECONDS = ("s", "sec", "secs", "second", "seconds")
_TIMES = {
    **dict.fromkeys(_SECONDS, 1.0),
    **dict.fromkeys(("ns", "nanosecond", "nanoseconds"), 1e-9),
    **dict.fromkeys(("us", "microsecond", "microseconds"), 1e-6),
    **dict.fromkeys(("ms", "msec", "millisecond", "milliseconds"), 1e-3),
    **dict.fromkeys(("min", "minute", "minutes"), 60.0),
    **dict.fromkeys(("h", "hr", "hour", "hours"), 3600.0),
    **dict.fromkeys(("d", "day", "days"), 86400.0),
}
# m/s, m s-1, m s^-1, m.s**-1, metres per second
_RATE = re.compile(r"([a-z]+)(?:\s*(?:/|\bper\b)\s*([a-z]+)|[\s.*·]\s*([a-z]+)\s*[\^*]*\(?-1\)?)")


def velocity_factor(units: str) -> float | None:
    """Return the factor from a unit of velocity to m/s, or None for an unknown unit."""
    found = _RATE.fullmatch(units.strip().lower())
    if found is None or (found[2] or found[3]) not in _SECONDS:
        return None
    return _LENGTHS.get(found[1])


def length_factor(units: str) -> float | None:
    """Return the factor from a unit of length to m, or None for an unknown unit."""
    return _LENGTHS.get(units.strip().lower())


def angle_factor(units: str) -> float | None:
    """Return the factor from a unit of angle to rad, or None for an unknown unit."""
    return _ANGLES.get(units.strip().lower())


def is_unit(text: str) -> bool:
    """Return whether a text is a known unit, with or without brackets."""
    known = (velocity_factor, length_factor, time_factor, angle_factor)
    return any(factor(text.strip().strip("[]()")) is not None for factor in known)


def time_factor(units: str) -> float | None:
    """Return the factor from a unit of time, also ``since`` a date, to s, or None if unknown."""
    unit, _, _ = units.strip().lower().partition(" since ")
    return _TIMES.get(unit.strip())


SUFFIXES = (".csv", ".tsv", ".txt", ".dat")
_MAX_BYTES = 500_000_000
_MAX_CELLS = 20_000_000
_SHORTEN = "Cut out a shorter part, or convert it to netCDF."
_HEAD = 1 << 16
"""Bytes from which the header and the layout are determined."""
_MISSING = ["", "-", "--", "n/a", "N/A", "NA", "NaN", "nan", "NAN", "null", "NULL", "None"]
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eEdD][+-]?\d+)?|[+-]?(inf|nan)", re.I)
_DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?")
_WITH_UNIT = re.compile(r"(.*?)\s*[\[(]([^\[\]()]*)[\])]")
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


def read_table(file: str, time: str, vertical: str | None) -> xr.Dataset:
    """Read a CSV file: a header with units in brackets, and rows.

    Numbers may be separated by commas, semicolons, tabs or blanks, with a decimal comma unless
    commas separate; lines after # are comments; times may be ISO dates; an empty cell is missing.
    With ``vertical`` each row is of one time and one level.
    """
    name, size = Path(file).name, os.path.getsize(file)
    if size > _MAX_BYTES:
        must = f"have at most {_MAX_BYTES / 1e6:.0f} MB as CSV"
        raise refusal("file", f"{name} has {size / 1e6:.0f} MB", must, _SHORTEN)
    layout = _layout(file)
    frame = _frame(file, layout)
    columns = {
        column: _numbers(frame[column], unit, is_time=column == time)
        for column, unit in zip(layout.names, layout.units, strict=True)
    }
    level = None
    if vertical is not None and (component := Component.of(vertical)) is not None:
        level = component.name
    if level in columns and time in columns and level != time:
        return _profile(columns, time, str(level))
    return xr.Dataset({column: ("row", *series) for column, series in columns.items()})


def _layout(file: str) -> _Layout:
    name = Path(file).name
    with Path(file).open("rb") as stream:
        head = stream.read(_HEAD)
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
    full = [index for index, line in enumerate(lines) if line.split("#")[0].strip()]
    declared = re.fullmatch(r"sep=(.)", lines[full[0]].strip()) if full else None  # as Excel has it
    full = full[1:] if declared else full
    if not full:
        raise refusal("file", f"{name} has no rows", "have a header and rows of numbers")
    first = full[0]
    header, rows = lines[first].split("#")[0], [lines[index] for index in full[1:]]
    separator = declared[1] if declared else next((mark for mark in "\t;," if mark in header), "")
    fields, skipped = _fields(header, separator), first + 1
    if all(_NUMBER.fullmatch(field) or _DECIMAL_COMMA.fullmatch(field) for field in fields):
        # as NumPy writes it, the header is a comment
        comments = [line.lstrip("# \t") for line in lines[:first] if line.strip().startswith("#")]
        names = _fields(comments[-1], separator) if comments else []
        if len(names) != len(fields):
            must = "have a first line of names such as time, u, w"
            raise refusal("file", f"{name} begins with numbers", must)
        rows, fields, skipped = [header, *rows], names, first
    units = [""] * len(fields)
    for index, field in enumerate(fields):
        if found := _WITH_UNIT.fullmatch(field):
            fields[index], units[index] = found[1], found[2].strip()
    if rows and skipped > first:
        below = _fields(rows[0].split("#")[0], separator)
        if len(below) == len(fields) and any(below) and all(not u or is_unit(u) for u in below):
            units, skipped = [u.strip("[]()") for u in below], full[1] + 1
    cells = [_fields(row.split("#")[0], separator) for row in rows[:100]]
    trailing = any(len(row) == len(fields) + 1 and not row[-1] for row in cells)
    if len(fields) > 1 and not fields[-1]:
        trailing, fields, units = True, fields[:-1], units[:-1]
    names = [field or f"column {index + 1}" for index, field in enumerate(fields)]
    twice = [field for field, count in Counter(names).items() if count > 1]
    if twice:
        text = f"{name} has several columns {listed(twice)}"
        raise refusal("file", text, "have each name once")
    comma = any(_DECIMAL_COMMA.fullmatch(cell) for row in cells for cell in row)
    point = any("." in cell for row in cells for cell in row if _NUMBER.fullmatch(cell))
    decimal = "," if separator != "," and comma and not point else "."
    return _Layout(encoding, skipped, names, units, separator, decimal, trailing)


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


_Series = tuple[np.ndarray, dict[str, str]]


def _numbers(column: pd.Series, unit: str, *, is_time: bool) -> _Series:
    """Return the numbers of a column, or its texts, with its attributes."""
    attributes = {"units": unit} if unit else {}
    if column.dtype.kind in "iuf":
        return column.to_numpy(), attributes
    numbers = pd.to_numeric(column, errors="coerce")
    odd = column[numbers.isna() & column.notna()]
    if odd.empty:
        return numbers.to_numpy(float), attributes
    if is_time:
        dates = pd.to_datetime(column.astype(str), format="ISO8601", errors="coerce", utc=True)
        if dates.notna().all():
            count = dates.dt.tz_localize(None).to_numpy().astype("datetime64[us]").astype(np.int64)
            return count, {"units": "us since 1970-01-01"}
        if dates.notna().any():
            odd = column[dates.isna()]
    row = int(odd.index[0]) + 1
    attributes["odd"] = f"{shown(str(odd.iloc[0]))} in row {row}"
    return column.astype(str).to_numpy(object), attributes


def _profile(columns: dict[str, _Series], time: str, level: str) -> xr.Dataset:
    """Return rows with a time and a level each as arrays over both."""
    places = []
    for key, name in (("time", time), ("vertical", level)):
        values, attributes = columns[name]
        if values.dtype.kind not in "iuf" or not np.isfinite(values).all():
            odd = attributes.get("odd", "a missing or infinite entry")
            raise refusal(key, f"{name} contains {odd}", "contain a number in each row")
        places.append(np.unique(values))
    (times, levels), shape = places, f"{places[0].size} times at {places[1].size} levels"
    if times.size * levels.size > _MAX_CELLS:
        text = f"{shape} give {times.size * levels.size} values"
        raise refusal("file", text, f"give at most {_MAX_CELLS}")
    numbers = {name: each for name, (each, _) in columns.items() if each.dtype.kind in "iuf"}
    frame = pd.DataFrame(numbers).set_index([time, level])
    twice = frame.index[frame.index.duplicated()]
    if twice.size:
        text = f"{time} {twice[0][0]:.12g} and {level} {twice[0][1]:.6g} are in two rows"
        raise refusal("time", text, "have one row for each time and level")
    dataset = xr.Dataset.from_dataframe(frame)
    for variable in dataset.variables:
        dataset[variable].attrs = columns[str(variable)][1]
    return dataset
