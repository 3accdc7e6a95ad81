"""A look at a record of the sea, without a scenario: its variables, numbers, tide and figure."""

import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w
import xarray as xr
from rich.table import Table

from crinoid.analysis.record import (
    HISTOGRAM,
    RECORD,
    TIDAL,
    RecordStatistics,
    interval_of,
    record_dataset,
    record_statistics,
    tide,
)
from crinoid.cli.command import console
from crinoid.cli.display import new_table, show, vector_text
from crinoid.cli.finding import finding
from crinoid.cli.folder import check_own
from crinoid.foundation.axes import AXES
from crinoid.recording import propose, read_dataset
from crinoid.recording.selection import read_selection
from crinoid.recording.series import FilledRecord
from crinoid.results.dataset import describe
from crinoid.results.own_files import table_head
from crinoid.scenario import Scenario, got, refusal
from crinoid.scenario.document import override
from crinoid.scenario.flow import Component, MeasuredFlow

_COMPASS = ("east", "north", "up")
_READING = ("velocity", "speed", "direction", "direction_is", "time", "vertical", "origin")
_READING += ("heading_deg", "select")
"""Keys of a measured flow that say how its file is read."""
_FLAG = re.compile(r".*(_qc|_qc_agg|_flag|_flags)", re.IGNORECASE)
_LEVELS, _CONSTITUENTS = 12, 6
"""Levels and constituents that are listed at most."""
_HEAD = table_head(["speed (m/s)", "share of time"])


def show_record(name: str, settings: Sequence[str], folder: Path, *, force: bool) -> None:
    """Look at a record: list its variables, sum it up, save and draw it."""
    dataset = read_dataset(name)
    document: dict[str, Any] = {"title": Path(name).name, "flow": [propose(dataset, name)]}
    for setting in settings:
        key = setting.partition("=")[0].strip()
        part = key.removeprefix("flow.0.").partition(".")[0]
        if key != "water.depth" and (part == key or part not in _READING):
            must = f"be water.depth, or flow.0. and one of {', '.join(_READING)}, for a record"
            raise refusal("--set", got(setting, must))
        override(document, setting)
    table = document["flow"][0]
    if "heading_deg" not in table and len(table.get("velocity", ())) == 3:
        document["arm"] = {"dimension": 3}
    console.print(_variables(dataset, table))
    console.print(tomli_w.dumps({"flow": [table]}), soft_wrap=True)
    scenario = Scenario.from_dict(document)
    (flow,) = scenario.flow
    assert isinstance(flow, MeasuredFlow)
    depth = scenario.water.depth
    record = read_selection(flow, None if depth is None else -depth)
    places, middle = _places(record)
    compass = flow.heading_deg is not None
    axes = _COMPASS if compass else AXES[record.velocity.shape[2]]
    path = folder / RECORD
    with finding(scenario, path, "a record", force=force, check=False, doubts=False) as found:
        if not force:
            check_own(folder / HISTOGRAM, lambda file: _HEAD.encode() in file.read_bytes())
        data = record_dataset(record, middle, axes)
        notes = record.remarks
        data.attrs = describe(scenario) | data.attrs | {"notes": "\n".join(notes)}
        statistics = {place: record_statistics(record, level) for place, level in places.items()}
        start = _start(dataset[flow.time])
        lines = _extent(record, start)
        shares = zip(data["speed"].values, data["share"].values, strict=True)
        text = "".join(f"{speed:.6g},{share:.6g}\n" for speed, share in shares)
        files = [*found.save(data), found.write(HISTOGRAM, _HEAD + text)]
        if record.time[-1] >= TIDAL:
            lines += _tide(record, middle, start, _latitude(dataset, flow))
        else:
            lines.append("tide: the record is shorter than 15 days")
        show(_numbers(str(scenario.title), statistics, axes, compass), notes, files, lines)


def _variables(dataset: xr.Dataset, flow: dict[str, Any]) -> Table:
    """Return the variables of a file, those that are understood first."""
    roles: dict[str, list[str]] = {}
    names = _COMPASS if "heading_deg" in flow else AXES.get(len(flow.get("velocity", ())), ())
    places = [(flow.get("time", "time"), "time"), (flow.get("vertical"), "level")]
    places += zip(flow.get("velocity", ()), names, strict=False)
    places += [(flow.get(role), role) for role in ("speed", "direction")]
    for text, role in places:
        component = None if text is None else Component.of(text)
        if component is not None:
            roles.setdefault(component.name, []).append(role)
    rows = []
    for name, variable in dataset.variables.items():
        known = roles.get(str(name)) or roles.get(str(variable.attrs.get("standard_name")), [])
        flag = "flag_meanings" in variable.attrs or _FLAG.fullmatch(str(name)) is not None
        dims = ", ".join(f"{each} {size}" for each, size in variable.sizes.items())
        role = ", ".join(known) or ("flag" if flag else "other")
        rows.append((str(name), role, str(variable.attrs.get("units", "")), dims))
    rows.sort(key=lambda row: (row[1] == "other", row[1] == "flag"))
    return new_table(None, ("variable", "role", "unit", "dimensions"), rows)


def _places(record: FilledRecord) -> tuple[dict[str, int], int]:
    """Return the lowest, the middle and the highest level by name, and the middle one."""
    if record.levels is None:
        return {"": 0}, 0
    order = np.argsort(record.levels)
    chosen = dict.fromkeys((order[0], order[order.size // 2], order[-1]))
    names = {f"z = {record.levels[level]:.4g} m": int(level) for level in chosen}
    return names, int(order[order.size // 2])


def _numbers(
    title: str, places: dict[str, RecordStatistics], axes: tuple[str, ...], compass: bool
) -> Table:
    named = ", ".join(axes)

    def towards(at: RecordStatistics) -> str:
        degrees = np.rad2deg(at.direction)
        return f"{(90 - degrees) % 360 if compass else degrees + 0.0:.0f} deg"

    texts: dict[str, Callable[[RecordStatistics], str]] = {
        f"mean velocity {named}": lambda at: vector_text(at.mean, "m/s"),
        f"standard deviation {named}": lambda at: vector_text(at.standard_deviation, "m/s"),
        "speed: mean": lambda at: f"{at.mean_speed:.3f} m/s",
        "speed: exceeded 50 % of time": lambda at: f"{at.median_speed:.3f} m/s",
        "speed: exceeded 5 % of time": lambda at: f"{at.high_speed:.3f} m/s",
        "speed: largest": lambda at: f"{at.greatest_speed:.3f} m/s",
    }
    if len(axes) == 3:
        base = "to, compass" if compass else "from x towards y"
        texts |= {
            f"principal direction ({base})": towards,
            "share of mean square along it": lambda at: f"{100 * at.along:.1f} %",
        }
    texts |= {
        "turbulence intensity": lambda at: vector_text(100 * np.array([at.intensity]), "%", 1),
        "gaps": lambda at: str(at.gaps),
        "longest gap": lambda at: f"{at.longest_gap:.6g} s",
        "missing": lambda at: f"{100 * at.missing:.2f} %",
    }
    rows = ((name, *map(text, places.values())) for name, text in texts.items())
    return new_table(title, ("", *places), rows)


def _extent(record: FilledRecord, start: np.datetime64 | None) -> list[str]:
    """Return when, how often and where a record was measured, and if turbulence is in it."""
    interval, count = interval_of(record), record.time.size
    since = "" if start is None else f" from {np.datetime_as_string(start, 's')}"
    text = f"{record.time[-1]:.6g} s{since}, {count} samples each {interval:.6g} s"
    lines = [f"{text} ({1 / interval:.4g} Hz)"]
    if record.levels is not None:
        z = np.sort(record.levels)
        shown = [f"{each:.4g}" for each in z]
        if z.size > _LEVELS:
            shown = [*shown[:2], "...", shown[-1]]
        lines.append(f"{z.size} levels at z = {', '.join(shown)} m")
        if z.size > 1:
            lines.append(f"histogram, spectrum and tide: of z = {z[z.size // 2]:.4g} m")
    if interval >= 1:
        lines.append("turbulence: none, it needs samples less than 1 s apart")
    elif record.time[-1] + interval < 600:
        lines.append("turbulence: of the whole record, which is shorter than ten minutes")
    else:
        lines.append("turbulence: the median of windows of ten minutes, noise included")
    return lines


def _start(clock: xr.DataArray) -> np.datetime64 | None:
    """Return the date of the first sample; None without one."""
    if " since " not in str(clock.attrs.get("units", "")):
        return None
    attributes = {key: clock.attrs[key] for key in ("units", "calendar") if key in clock.attrs}
    first = xr.Dataset({"first": ("time", clock.values[:1], attributes)})
    date = xr.decode_cf(first)["first"].values[0]
    return date.astype("datetime64[us]") if isinstance(date, np.datetime64) else None


def _latitude(dataset: xr.Dataset, flow: MeasuredFlow) -> float | None:
    """Return the latitude of the record (degrees), if its file has it."""
    for name, variable in dataset.variables.items():
        if str(variable.attrs.get("standard_name", name)).lower() in ("latitude", "lat"):
            return float(flow.select.get(str(name), np.nanmean(variable.values)))
    return None


def _tide(
    record: FilledRecord, level: int, start: np.datetime64 | None, latitude: float | None
) -> list[str]:
    try:
        found = tide(record, level, start, latitude)
    except ImportError:
        return ["tide: not analysed, it needs utide (pip install 'crinoid[tide]')"]
    phase = "first sample" if start is None else "Greenwich"
    nodal = "" if start is not None and latitude is not None else ", without nodal corrections"
    lines = [
        f"tide: {len(found.names)} constituents explain {found.share:.1%} of the variance; "
        f"semi-major axes, phase lags of {phase}{nodal}"
    ]
    table = zip(found.names, found.amplitude, found.phase, strict=True)
    return lines + [f"  {n:5}{a:.3f} m/s {p:4.0f} deg" for n, a, p in list(table)[:_CONSTITUENTS]]
