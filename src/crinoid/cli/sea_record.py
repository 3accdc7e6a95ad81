"""A look at a record of the sea, without a scenario: its variables, numbers, tide and figure."""

import json
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from jaxtyping import Float
from rich import box
from rich.table import Table

from crinoid.analysis.sea_record import (
    HISTOGRAM,
    RECORD,
    SCATTER,
    SEA_KEYS,
    TIDAL,
    interval_of,
    record_dataset,
    record_statistics,
    scatter,
    tide,
)
from crinoid.cli.command import console
from crinoid.cli.display import new_table, show, statistics_table
from crinoid.cli.finding import finding, write_contents
from crinoid.cli.folder import check_own, claimed
from crinoid.foundation.axes import AXES
from crinoid.recording import propose, read_dataset
from crinoid.recording.axes import find, seconds
from crinoid.recording.numbers import FLAG
from crinoid.recording.proposal import roles
from crinoid.recording.sea_states import read_sea_states
from crinoid.recording.selection import read_selection
from crinoid.recording.series import FilledRecord
from crinoid.results.dataset import describe
from crinoid.results.own_files import SHARE, table_head
from crinoid.scenario import Scenario, got, refusal
from crinoid.scenario.document import override
from crinoid.scenario.flow import Component, MeasuredFlow

_COMPASS = ("east", "north", "up")
_READING = (
    *("velocity", "speed", "direction", "direction_is"),
    *("time", "vertical", "origin", "heading_deg", "select"),
)
"""Keys of a measured flow that say how its file is read."""
_TIDES = 6 * 3600.0  # interval (s) from which on samples are too far apart for most tides
_CONSTITUENTS = 6  # constituents that are listed at most


def show_record(name: str, settings: Sequence[str], folder: Path, *, force: bool) -> None:
    """Look at a record: list its variables, sum it up, save and draw it."""
    notes: list[str] = []
    with read_dataset(name) as dataset:
        current = {"east", "speed"} & set(roles(dataset))
        sea = None if current else read_sea_states(dataset, name, notes)
        if sea is None:
            _show(dataset, name, settings, folder, force=force)
            return
    if settings:
        raise refusal("--set", got(settings[0], "be left out: the record has waves alone"))
    with claimed(folder):
        if not force:
            check_own(folder / SCATTER)
        table, text = _scatter(sea.values, notes)
        show(table, notes, write_contents(folder, {SCATTER: text}))


def _show(
    dataset: xr.Dataset, name: str, settings: Sequence[str], folder: Path, *, force: bool
) -> None:
    table = propose(dataset, name)
    document: dict[str, Any] = {"title": Path(name).name, "flow": [table]}
    document["base"] = {"position": [0.0, 0.0]}  # above the bed of any depth
    for setting in settings:
        key = setting.partition("=")[0].strip()
        if key != "water.depth" and key.split(".")[:3] not in [["flow", "0", k] for k in _READING]:
            must = f"be water.depth or, of flow.0, {', '.join(_READING)}: a record has no scenario"
            raise refusal("--set", got(setting, must))
        override(document, setting)
    scenario = Scenario.from_dict(document)
    (flow,) = scenario.flow
    assert isinstance(flow, MeasuredFlow)
    console.print(_variables(dataset, flow))
    lines = [f"{key} = {_toml(value)}" for key, value in table.items()]
    console.print("\n".join(["[[flow]]", *lines, ""]), soft_wrap=True)
    depth = scenario.water.depth
    record = read_selection(flow, None if depth is None else -depth)
    axes = _axes(flow)
    order = [0] if record.levels is None else np.argsort(record.levels)
    middle = int(order[len(order) // 2])
    path = folder / RECORD
    with finding(scenario, path, "a record", force=force, check=None, doubts=None) as found:
        for each in () if force else (HISTOGRAM, SCATTER):
            check_own(folder / each)
        data = record_dataset(record, middle, axes)
        data.attrs = describe(scenario) | data.attrs | {"notes": "\n".join(record.remarks)}
        speeds, shares = data["speed"].values, data["share"].values
        files = {HISTOGRAM: _cases(["flow.0.velocity.0"], speeds, shares)}
        places = list(dict.fromkeys((int(order[0]), middle, int(order[-1]))))
        start = _start(dataset[find(dataset, flow.time, "time", name)])
        lines = _extent(record, start, middle)
        lines += _tide(record, middle, start, _latitude(dataset, flow))
        notes: list[str] = []
        if (sea := read_sea_states(dataset, name, notes)) is not None:
            clock, states = dataset[find(dataset, flow.time, "time", name)].squeeze(), sea.values
            if clock.dims == sea.dims[:1]:
                speed = np.linalg.norm(record.velocity[:, middle], axis=1)
                speed[record.filled[:, middle]] = np.nan
                at = np.searchsorted(record.time, seconds(clock, []))
                states = np.column_stack([states, speed[at]])
            else:
                notes.append(f"the current has other times: {SCATTER} has the waves alone")
            of_waves, files[SCATTER] = _scatter(states, notes)
            console.print(of_waves)
        numbers = _numbers(record, places, axes)
        found.show(data, numbers, lines=lines, notes=notes, files=files)


def _scatter(states: Float[np.ndarray, "time quantity"], notes: list[str]) -> tuple[Table, str]:
    """Return statistics of sea states, perhaps with a speed, and the text of their file."""
    known = states[np.isfinite(states).all(axis=1)]
    if lacking := len(states) - len(known):
        notes.append(f"{lacking} of {len(states)} rows lack a value and are left out")
    if not known.size:
        raise refusal("file", "each row lacks a height, a period or a speed", "have one with all")
    centres, shares = scatter(known)
    found: dict[str, Any] = {}
    names = ("significant height (m)", "peak period (s)", "speed with waves (m/s)")
    for each, column in zip(names, known.T, strict=False):
        found |= {f"mean {each}": column.mean(), f"largest {each}": column.max()}
    most = ", ".join(f"{value:g}" for value in centres[np.argmax(shares)])
    found |= {f"share at {most}, the most (%)": 100 * shares.max(), "bins": float(shares.size)}
    return statistics_table(None, (), [found]), _cases(SEA_KEYS, centres, shares)


def _cases(keys: Sequence[str], *columns: Float[np.ndarray, "bin ..."]) -> str:
    """Return a table for `--weights`: a column for each key, as far as there are, and shares."""
    rows = np.column_stack(columns)
    lines = (",".join(f"{value:.6g}" for value in row) for row in rows)
    head = table_head([*keys[: rows.shape[1] - 1], SHARE])
    return head + "".join(f"{line}\n" for line in lines)


def _toml(value: Any) -> str:
    """Return a value in one line of TOML."""
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{json.dumps(k)} = {_toml(v)}" for k, v in value.items()) + " }"
    return json.dumps(value, ensure_ascii=False)


def _axes(flow: MeasuredFlow) -> tuple[str, ...]:
    return AXES[len(flow.velocity)] if flow.heading_deg is None else _COMPASS


def _variables(dataset: xr.Dataset, flow: MeasuredFlow) -> Table:
    """Return the variables of a file, those that are understood first."""
    places: list[tuple[str | None, str]] = [(flow.time, "time"), (flow.vertical, "level")]
    if flow.speed:
        places += [(flow.speed, "speed"), (flow.direction, "direction")]
    else:
        places += zip(flow.velocity, _axes(flow), strict=True)
    roles: dict[str, list[str]] = {}
    for text, role in places:
        if text is not None and (component := Component.of(text)) is not None:
            roles.setdefault(find(dataset, component.name, role, flow.file), []).append(role)
    rows = []
    for name, variable in dataset.variables.items():
        flag = "flag_meanings" in variable.attrs or FLAG.fullmatch(str(name)) is not None
        dims = ", ".join(f"{each} {size}" for each, size in variable.sizes.items())
        role = ", ".join(roles.get(str(name), [])) or ("flag" if flag else "other")
        rows.append((str(name), role, str(variable.attrs.get("units", "")), dims))
    rows.sort(key=lambda row: {"other": 0, "flag": 1}.get(row[1], -1))
    return new_table(None, ("variable", "role", "unit", "dimensions"), rows, box=box.SIMPLE)


def _numbers(record: FilledRecord, places: list[int], axes: tuple[str, ...]) -> Table:
    """Return the statistics of some levels."""
    columns, levels = [record_statistics(record, at, axes) for at in places], record.levels
    heads = () if levels is None else ("", *(f"z = {levels[at]:.4g} m" for at in places))
    return statistics_table(None, heads, columns)


def _extent(record: FilledRecord, start: np.datetime64 | None, middle: int) -> list[str]:
    """Return when, how often and where a record was measured, and if turbulence is in it."""
    interval, count = interval_of(record), record.time.size
    since = "" if start is None else f" from {np.datetime_as_string(start, 's')}"
    text = f"{record.time[-1]:.6g} s{since}, {count} samples each {interval:.6g} s"
    lines = [f"{text} ({1 / interval:.4g} Hz)"]
    if record.levels is not None:
        z = ", ".join(f"{height:.4g}" for height in np.sort(record.levels))
        lines.append(f"levels z (m): {z}")
        lines.append(f"histogram, spectrum and tide are those of z = {record.levels[middle]:.4g} m")
    if interval >= 1:
        lines.append("turbulence: none, it needs samples less than 1 s apart")
    else:
        lines.append("turbulence: median of windows of ten minutes, noise included")
    return lines


def _start(clock: xr.DataArray) -> np.datetime64 | None:
    """Return the date of the first sample; None without one."""
    if " since " not in str(clock.attrs.get("units", "")):
        return None
    attributes = {key: clock.attrs[key] for key in ("units", "calendar") if key in clock.attrs}
    first = xr.Dataset({"first": ("time", clock.values[:1], attributes)})
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", xr.SerializationWarning)  # of years as far as 3000
            date = xr.decode_cf(first)["first"].values[0]
    except ValueError:  # such as months, or seconds since midnight
        return None
    return date.astype("datetime64[us]") if isinstance(date, np.datetime64) else None


def _latitude(dataset: xr.Dataset, flow: MeasuredFlow) -> float | None:
    """Return the latitude of the record (degrees), if its file has it."""
    for name, variable in dataset.variables.items():
        named = str(variable.attrs.get("standard_name", name)).lower() in ("latitude", "lat")
        if named and variable.dtype.kind in "iuf":
            return float(flow.select.get(str(name), np.nanmean(variable.values)))
    return None


def _tide(
    record: FilledRecord, level: int, start: np.datetime64 | None, latitude: float | None
) -> list[str]:
    if record.time[-1] < TIDAL:
        return ["tide: none, it needs a record of 15 days"]
    try:
        found = tide(record, level, start, latitude)
    except ImportError:
        return ["tide: not analysed, it needs utide (pip install 'crinoid[tide]')"]
    if np.isnan(found.share):
        return ["tide: none, the current is steady"]
    short = f"no constituent with a period below {interval_of(record) / 1800:.4g} h, two intervals"
    if not found.names:
        return [f"tide: none, samples show {short}"]
    phase = "first sample" if start is None else "Greenwich"
    nodal = "" if start is not None and latitude is not None else ", without nodal corrections"
    lines = [
        f"tide: {len(found.names)} constituents explain {found.share:.1%} of the variance; "
        f"semi-major axes, phase lags of {phase}{nodal}"
    ]
    if interval_of(record) >= _TIDES:
        lines.append(f"samples show {short}: faster tides look like these, unless they are means")
    table = zip(found.names, found.amplitude, found.phase, strict=True)
    return lines + [f"  {n:5}{a:.3f} m/s {p:4.0f} deg" for n, a, p in list(table)[:_CONSTITUENTS]]
