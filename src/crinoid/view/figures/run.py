"""Checked result files: a run, and the same run without control where it exists."""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import cached_property
from pathlib import Path

import numpy as np
import xarray as xr
from jaxtyping import Bool

from crinoid.foundation.axes import AXES
from crinoid.foundation.status import Status
from crinoid.results.chunks import pieces
from crinoid.results.errors import error_word, judged_at
from crinoid.results.report_error import ReportError
from crinoid.results.result import Result
from crinoid.results.scene.data import LARGEST, check_obstacles, shaped
from crinoid.results.stream import open_lazily
from crinoid.scenario import Scenario, ScenarioError
from crinoid.scenario.errors import counted

RESULT = "result.nc"
UNCONTROLLED = "uncontrolled.nc"

# required of a result; without any other variable a figure omits its panel
_REQUIRED = {
    "position": ("time", "node", "axis"),
    "tip_position": ("time", "axis"),
    "tip_target": ("time", "axis"),
    "tip_error": ("time",),
}


@dataclass(frozen=True)
class Run:
    """One result and, where there is one, the same scenario without control."""

    result: xr.Dataset
    uncontrolled: xr.Dataset | None = None
    shapeless: int = 0  # saved instants of both that are left out, as the arm has no shape to draw

    @cached_property
    def scenario(self) -> Scenario:
        """The scenario that was run; one of defaults where this version cannot read it."""
        with suppress(KeyError, ScenarioError):
            return Result(self.result).scenario
        return Scenario()

    @property
    def aside(self) -> float | None:
        """Time before which errors do not count (s); None if all do."""
        return self.scenario.judged_from or None

    def counted(self, data: xr.Dataset) -> Bool[np.ndarray, " time"]:
        """Return the instants of its data that count; all if it ended before."""
        counted = judged_at(data["time"].values, self.scenario)
        return counted if counted.any() else ~counted

    @property
    def error_word(self) -> str:
        """Noun for the distance of the tip from its target, or from its start without one."""
        return error_word(self.scenario)

    @property
    def title(self) -> str:
        """The scenario's title, or the program's name where it has none."""
        return str(self.result.attrs.get("title", "")).strip() or "crinoid"

    @property
    def status(self) -> str:
        """`"ok"`, or what went wrong and when."""
        return str(self.result.attrs.get("status", "")).strip() or Status.OK.value

    @property
    def members(self) -> list[tuple[str, xr.Dataset]]:
        """The runs to draw, each with its name."""
        if self.uncontrolled is None:
            return [("", self.result)]
        return [("with control", self.result), ("without control", self.uncontrolled)]

    @property
    def left_out(self) -> list[str]:
        """Sentences on saved instants that are left out."""
        if not self.shapeless:
            return []
        verb, many = ("are", "these") if self.shapeless > 1 else ("is", "it")
        count = counted(self.shapeless, "saved instant")
        return [f"{count} {verb} left out: at {many} the arm has no shape to draw."]


def open_run(path: Path, *, lazily: bool = False) -> Run:
    """Read a result file and the one without control in the same folder.

    With ``lazily`` large variables stay in the file until they are used.
    """
    other = path.with_name(UNCONTROLLED)
    compared = other.is_file() and path.name != UNCONTROLLED
    found = {
        str(each): checked_result(each, lazily=lazily) for each in [path, other][: 1 + compared]
    }
    if path.name == UNCONTROLLED:
        title = found[str(path)].attrs.get("title", "") or "A run"
        found[str(path)].attrs["title"] = f"{title}, without control"
    return run_of(found)


def run_of(results: Mapping[str, xr.Dataset]) -> Run:
    """Return a run from a result, and the one without control where it exists, by their names."""
    found = [with_shapes(data, name) for name, data in results.items()]
    saved = sum(data.sizes["time"] for data in results.values())
    gone = saved - sum(data.sizes["time"] for data in found)
    return Run(found[0], found[1] if len(found) > 1 else None, gone)


def load(path: Path, *, lazily: bool = False) -> xr.Dataset:
    """Read a netCDF file, times as seconds; with ``lazily`` large variables stay on disk."""
    try:
        if lazily:
            return open_lazily(path)
        with xr.open_dataset(path, engine="netcdf4", decode_times=False) as stored:
            return stored.load()
    except (OSError, RuntimeError, ValueError, KeyError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise ReportError(f"{path}: not a readable netCDF file ({reason})") from error


def load_as(path: Path, kind: str, required: Mapping[str, tuple[str, ...]]) -> xr.Dataset:
    """Read a file of a kind into memory, with some variables over some dimensions; ``*``: any."""
    dataset = load(path)
    for name, dims in required.items():
        known = " ".join(map(str, dataset[name].dims)) if name in dataset else ""
        if name not in dataset or not fnmatchcase(known, " ".join(dims)):
            over = f" over {', '.join(dims)}" if dims else ""
            text = f"not a file of crinoid with {kind}, it has no {name}{over}"
            raise ReportError(f"{path}: {text}")
    return dataset


def read_result(
    path: Path, required: Mapping[str, tuple[str, ...]] = _REQUIRED, *, lazily: bool = False
) -> xr.Dataset:
    """Read one result file, with some variables over some dimensions."""
    if not path.is_file():
        raise ReportError(f"{path}: no such file")
    if path.stat().st_size == 0:
        raise ReportError(f"{path}: the file is empty")
    dataset = load(path, lazily=lazily)
    if fault := _fault(dataset, required):
        raise ReportError(f"{path}: {fault}")
    return dataset


def _fault(data: xr.Dataset, required: Mapping[str, tuple[str, ...]]) -> str:
    """Reason for which a dataset is not a result that can be drawn; empty if it is."""
    foreign = "not a crinoid result,"
    for name, dims in required.items():
        if name not in data and "crinoid_version" in data.attrs and name == "position":
            return "output.variables left out position, which all figures need"
        if name not in data:
            return f"{foreign} it has no variable {name!r}"
        if data[name].dims != dims:
            return f"{foreign} {name!r} has dimensions {data[name].dims}, not {dims}"
    for name in ("time", "axis"):
        if name not in data.coords:
            return f"{foreign} it has no coordinate {name!r}"
    if tuple(map(str, data["axis"].values)) not in AXES.values():
        return f"{foreign} its axes are not labelled x and z, or x, y, z"
    if data.sizes["time"] == 0:
        return "the result has no records"
    time = data["time"].values.astype(float)
    if not (np.isfinite(time).all() and (np.diff(time) > 0.0).all()):
        return f"{foreign} its times do not rise"
    return f"{foreign} the arm has fewer than two nodes" if data.sizes.get("node", 0) < 2 else ""


def open_result(path: Path, *, lazily: bool = False) -> xr.Dataset:
    """Read one result file; records without a shape to draw are left out."""
    return with_shapes(checked_result(path, lazily=lazily), str(path))


def checked_result(path: Path, *, lazily: bool = False) -> xr.Dataset:
    """Read one result file whose obstacles can be drawn."""
    dataset = read_result(path, lazily=lazily)
    check_obstacles(dataset, path)
    return dataset


def with_shapes(dataset: xr.Dataset, name: str) -> xr.Dataset:
    """Return the records of a result with a shape to draw."""
    if "position" not in dataset:
        return dataset
    # a run that diverged may end in records that no axis can show
    finite = np.concatenate(
        [shaped(piece["position"].values) for piece in pieces(dataset, ["position"])]
    )
    if not finite.any():
        shape = f"finite, within {LARGEST:g} m, and no edge of length 0"
        raise ReportError(f"{name}: the result has no record with a shape to draw: {shape}")
    return dataset if finite.all() else dataset.isel(time=np.flatnonzero(finite))
