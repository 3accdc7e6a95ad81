"""Reading a CSV file, as people and instruments write them, into what a netCDF file would hold."""

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

from crinoid.recording.refusal import listed, refusal
from crinoid.recording.units import is_unit
from crinoid.scenario.errors import shown
from crinoid.scenario.measured import Component

SUFFIXES = (".csv", ".tsv", ".txt", ".dat")
_MAX_BYTES = 500_000_000
_MAX_CELLS = 20_000_000
_HEAD = 1 << 16
"""Bytes in which the header and enough rows to tell the layout are to be found."""
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
        text = f"{name} has {size / 1e6:.0f} MB, takes up to {_MAX_BYTES / 1e6:.0f} MB of CSV"
        raise refusal("file", f"{text}; cut out the part that is needed, or make it netCDF")
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
        raise refusal("file", f"{name} is no text, takes a CSV or netCDF file")
    lines = text.splitlines()
    if len(head) == _HEAD:
        lines = lines[:-1]  # cut in two
    full = [index for index, line in enumerate(lines) if line.split("#")[0].strip()]
    told = re.fullmatch(r"sep=(.)", lines[full[0]].strip()) if full else None  # as Excel has it
    full = full[1:] if told else full
    if not full:
        raise refusal("file", f"{name} holds no rows, takes a header and rows of numbers")
    first = full[0]
    header, rows = lines[first].split("#")[0], [lines[index] for index in full[1:]]
    separator = told[1] if told else next((mark for mark in "\t;," if mark in header), "")
    fields, skipped = _fields(header, separator), first + 1
    if all(_NUMBER.fullmatch(field) or _DECIMAL_COMMA.fullmatch(field) for field in fields):
        # as NumPy writes it, the header is a comment
        said = [line.lstrip("# \t") for line in lines[:first] if line.strip().startswith("#")]
        names = _fields(said[-1], separator) if said else []
        if len(names) != len(fields):
            text = f"{name} begins with numbers, takes a first line of names such as time, u, w"
            raise refusal("file", text)
        rows, fields, skipped = [header, *rows], names, first
    units = [""] * len(fields)
    for index, field in enumerate(fields):
        if found := _WITH_UNIT.fullmatch(field):
            fields[index], units[index] = found[1], found[2].strip()
    if rows and skipped > first:
        below = _fields(rows[0].split("#")[0], separator)
        if len(below) == len(fields) and any(below) and all(not u or is_unit(u) for u in below):
            units, skipped = [u.strip("[]()") for u in below], full[1] + 1
    widths = [_fields(row.split("#")[0], separator) for row in rows[:100]]
    trailing = any(len(row) == len(fields) + 1 and not row[-1] for row in widths)
    if len(fields) > 1 and not fields[-1]:
        trailing, fields, units = True, fields[:-1], units[:-1]
    names = [field or f"column {index + 1}" for index, field in enumerate(fields)]
    twice = [field for field, count in Counter(names).items() if count > 1]
    if twice:
        raise refusal("file", f"{name} has several columns {listed(twice)}, takes each name once")
    decimal = _decimal(rows, separator)
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


def _decimal(rows: list[str], separator: str) -> str:
    if separator == ",":
        return "."
    fields = [field for row in rows[:100] for field in _fields(row.split("#")[0], separator)]
    comma = any(_DECIMAL_COMMA.fullmatch(field) for field in fields)
    return "," if comma and not any("." in f for f in fields if _NUMBER.fullmatch(f)) else "."


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
        text = f"{name} has rows of more values than the {len(layout.names)} of its header"
        raise refusal("file", text) from error
    except pd.errors.ParserError as error:
        if found := _FIELDS.search(str(error)):
            taken, line, got = found.groups()
            text = f"{name} has {got} values in line {line}, takes {taken} as in its header"
            raise refusal("file", text) from error
        raise _broken(name, error) from error
    except Exception as error:  # whatever a library makes of a damaged file
        raise _broken(name, error) from error
    if frame.size > _MAX_CELLS:
        text = f"{name} holds {frame.size} values, takes up to {_MAX_CELLS}"
        raise refusal("file", f"{text}; cut out the part that is needed, or make it netCDF")
    return frame[layout.names].dropna(how="all")


def _broken(name: str, error: Exception) -> Exception:
    reason = " ".join(str(error).split())[:200]
    return refusal("file", f"{name} is broken or no CSV file ({reason})")


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
    """Lay rows of a time and a level each out over both."""
    places = []
    for key, name in (("time", time), ("vertical", level)):
        values, attributes = columns[name]
        if values.dtype.kind not in "iuf" or not np.isfinite(values).all():
            odd = f" ({attributes['odd']})" if "odd" in attributes else ""
            raise refusal(key, f"{name} holds what is no number{odd}, takes one in each row")
        places.append(np.unique(values, return_inverse=True))
    (times, row), (levels, layer) = places
    if times.size * levels.size > _MAX_CELLS:
        text = f"{times.size} times at {levels.size} levels make {times.size * levels.size} values"
        raise refusal("file", f"{text}, takes up to {_MAX_CELLS}")
    cell = row * levels.size + layer
    order = np.argsort(cell, kind="stable")
    again = np.flatnonzero(np.diff(cell[order]) == 0)
    if again.size:
        index = order[again[0] + 1]
        text = f"{time} {times[row[index]]:.12g} and {level} {levels[layer[index]]:.6g} stand in "
        raise refusal("time", text + "two rows, takes one row for each time and level")
    laid_out: dict[str, tuple[tuple[str, ...], np.ndarray, dict[str, str]]] = {
        time: ((time,), times, columns[time][1]),
        level: ((level,), levels, columns[level][1]),
    }
    for name, (values, attributes) in columns.items():
        if name in (time, level) or values.dtype.kind not in "iuf":
            continue
        grid = np.full((times.size, levels.size), np.nan)
        grid[row, layer] = values
        laid_out[name] = ((time, level), grid, attributes)
    return xr.Dataset(laid_out)
