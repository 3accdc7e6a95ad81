"""Reading of tables of instruments: a column for each cell of a profile, or dates in many."""

from __future__ import annotations

import re
from collections import defaultdict

import numpy as np
import pandas as pd
import xarray as xr

from crinoid.recording import table
from crinoid.recording.texts import short
from crinoid.scenario.errors import refusal

_NDBC = re.compile(rb"#?\s*YYY?Y?\s+MM\s+DD\s+hh")
_NDBC_CELL = re.compile(r"(DEP|DIR|SPD)(\d+)")
_NDBC_NAMES = {"DEP": "depth", "DIR": "direction", "SPD": "speed"}
_NO_VALUE = 999.0
"""Mark of a missing value in files of past years."""
_NORTEK_CELL = re.compile(rb"#1\s*\([\d.]+\s*m\)")
_CELL, _DISTANCE = re.compile(r"(.+?)\s*#\s*(\d+)"), re.compile(r"([\d.]+)\s*m")


def reads(file: str, head: bytes) -> bool:
    """Return whether a file is of a buoy of NDBC, or has the cells of a profiler of Nortek."""
    first = head.partition(b"\n")[0]
    return bool(_NDBC.match(first) or _NORTEK_CELL.search(first))


def read(file: str) -> xr.Dataset:
    """Read the table; the columns of cells become arrays over time and cell."""
    with open(file, "rb") as stream:
        first = stream.readline()
    return _of_buoy(file) if _NDBC.match(first) else _with_cells(table.read(file))


def _with_cells(rows: xr.Dataset) -> xr.Dataset:
    """Return columns such as ``Speed#1 (0.6 m)`` as arrays over the distance of their cells."""
    cells: dict[str, list[tuple[float, str]]] = defaultdict(list)
    for column in map(str, rows.variables):
        distance = _DISTANCE.fullmatch(str(rows[column].attrs.get("units", "")))
        if distance and (cell := _CELL.fullmatch(column)):
            cells[cell[1].strip()].append((float(distance[1]), column))
    found = rows.drop_vars([column for each in cells.values() for _, column in each])
    for name, each in cells.items():
        values = np.stack([rows[column].values for _, column in each], axis=1)
        found[name] = (("row", "range"), values)
        found["range"] = ("range", [distance for distance, _ in each], {"units": "m"})
    return found


def _of_buoy(file: str) -> xr.Dataset:
    """Read the text of a buoy: dates in five columns, units below the names, MM where missing."""
    with open(file, encoding="utf-8-sig") as stream:
        names = stream.readline().lstrip("#").split()
        below = stream.readline()
    units = below.lstrip("#").split() if below.startswith("#") else [""] * len(names)
    options = {"sep": r"\s+", "header": None, "names": names, "index_col": False}
    frame = pd.read_csv(file, comment="#", na_values=["MM"], **options)
    if not below.startswith("#"):  # as in older files, where no mark precedes the names
        frame = frame[frame[names[0]] != names[0]]
    dates = frame[names[: 5 if "mm" in names else 4]].astype(int)
    years = dates.iloc[:, 0].where(dates.iloc[:, 0] > 99, dates.iloc[:, 0] + 1900)
    calendar = {"year": years, "month": dates.iloc[:, 1], "day": dates.iloc[:, 2]}
    calendar["hour"] = dates.iloc[:, 3]
    if "mm" in names:
        calendar["minute"] = dates.iloc[:, 4]
    time = pd.to_datetime(pd.DataFrame(calendar)).to_numpy().astype("datetime64[s]")
    if not (np.diff(time.astype(np.int64)) > 0).all():  # the newest comes first
        order = np.argsort(time, kind="stable")
        time, frame = time[order], frame.iloc[order]
    found = xr.Dataset(
        {"time": ("row", time.astype(np.int64), {"units": "seconds since 1970-01-01"})}
    )
    cells: dict[str, list[np.ndarray]] = defaultdict(list)
    for name, unit in zip(names[dates.shape[1] :], units[dates.shape[1] :], strict=True):
        values = frame[name].to_numpy()
        if values.dtype.kind not in "iuf":
            raise refusal("file", f"{name} of {short(file)} contains texts", "contain numbers")
        if cell := _NDBC_CELL.fullmatch(name):
            cells[cell[1]].append(np.where(values == _NO_VALUE, np.nan, values))
            found.attrs[cell[1]] = unit
        else:
            found[name] = ("row", values.astype(float), {"units": unit})
    for kind, each in cells.items():
        attributes = {"units": found.attrs.pop(kind)}
        found[_NDBC_NAMES[kind]] = (("row", "cell"), np.stack(each, axis=1), attributes)
    return found
