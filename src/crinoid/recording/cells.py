"""Columns of a table that belong together: the cells of a profile, and the parts of a date."""

import re
from collections import defaultdict

import numpy as np
import pandas as pd
import xarray as xr

_CELL = re.compile(r"(DEP|DIR|SPD)(\d+)|(.+?)\s*#\s*(\d+)")
"""Columns of the cells of NDBC, and of Nortek with the distance of the cell as their unit."""
_DISTANCE = re.compile(r"([\d.,]+)\s*m")
_BUOY = {"DEP": "depth", "DIR": "direction", "SPD": "speed"}
_NO_VALUE = 999.0  # mark of a missing value in files of past years of NDBC
_PARTS = {
    "year": "YYY?Y?|year",
    "month": "MM|month",
    "day": "DD|day",
    "hour": "hh|hour",
    "minute": "mm|minute",
    "second": "ss|second",
}


def with_dates(rows: xr.Dataset) -> xr.Dataset:
    """Return rows with a time in place of columns of years, months, days, hours and minutes."""
    parts = {
        part: column
        for part, pattern in _PARTS.items()
        for column in map(str, rows.variables)
        if re.fullmatch(pattern, column)
    }
    if not {"year", "month", "day", "hour"} <= parts.keys() or "time" in rows:
        return rows
    calendar = pd.DataFrame({part: rows[column].values for part, column in parts.items()})
    calendar["year"] += np.where(calendar["year"] > 99, 0, 1900)
    time = pd.to_datetime(calendar).to_numpy().astype("datetime64[us]").astype(np.int64)
    found = rows.drop_vars(list(parts.values()))
    found["time"] = ("row", time, {"units": "microseconds since 1970-01-01"})
    newest_first = time.size > 1 and bool((np.diff(time) < 0).all())
    return found.isel(row=slice(None, None, -1)) if newest_first else found


def as_arrays(rows: xr.Dataset) -> xr.Dataset:
    """Return columns such as ``Speed#1 (0.6 m)`` as arrays over their cells."""
    groups: dict[str, list[str]] = defaultdict(list)
    buoy = _BUOY if all(f"{name}01" in rows or f"{name}1" in rows for name in _BUOY) else {}
    for column in map(str, rows.variables):
        cell = _CELL.fullmatch(column)
        distance = _DISTANCE.fullmatch(str(rows[column].attrs.get("units", "")))
        if cell and (cell[1] in buoy or distance):
            groups[cell[1] or cell[3].strip()].append(column)
    found = rows.drop_vars([column for group in groups.values() for column in group])
    for name, group in groups.items():
        values = np.stack([rows[each].values for each in group], axis=1)
        if name in buoy:
            values = np.where(values == _NO_VALUE, np.nan, values)
            found[buoy[name]] = (("row", "cell"), values, rows[group[0]].attrs)
        else:
            found[name] = (("row", "range"), values)
            texts = [rows[each].attrs["units"].rstrip(" m").replace(",", ".") for each in group]
            distances = [float(each) for each in texts]
            found["range"] = ("range", distances, {"units": "m"})
    return found
