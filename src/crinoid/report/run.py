"""A run as the figures see it: the result file, checked, and the uncontrolled run beside it."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr
from jaxtyping import Bool, Float

from crinoid.pieces import pieces
from crinoid.report.charts.pose import base_directions
from crinoid.report.solids import find_bodies
from crinoid.scenario.errors import counted
from crinoid.space import AXES
from crinoid.status import Status
from crinoid.stream import open_lazily

RESULT = "result.nc"
UNCONTROLLED = "uncontrolled.nc"

# What makes a netCDF file a result; without any other variable a figure drops the panel it fed.
_REQUIRED = {
    "position": ("time", "node", "axis"),
    "tip_position": ("time", "axis"),
    "tip_target": ("time", "axis"),
    "tip_error": ("time",),
}


_LARGEST = 1e9
"""Largest size of a drawing, in SI units. Squares of far larger numbers overflow."""


class ReportError(ValueError):
    """A report cannot be drawn; the message is one line that says why."""


@dataclass(frozen=True)
class Run:
    """One result and, where there is one, the same scenario without control."""

    result: xr.Dataset
    uncontrolled: xr.Dataset | None = None
    shapeless: int = 0
    """Saved instants of both that are left out, as the arm has no shape to draw."""

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
        """The runs to draw, each with the name that tells it from the other."""
        if self.uncontrolled is None:
            return [("", self.result)]
        return [("with control", self.result), ("without control", self.uncontrolled)]

    @property
    def left_out(self) -> list[str]:
        """Sentences on saved instants that are left out."""
        if not self.shapeless:
            return []
        many = "these" if self.shapeless > 1 else "it"
        verb = "are" if self.shapeless > 1 else "is"
        count = counted(self.shapeless, "saved instant")
        return [f"{count} {verb} left out: at {many} the arm has no shape to draw."]


def open_run(path: Path, *, lazily: bool = False) -> Run:
    """Read a result file and the uncontrolled one beside it.

    What is large may stay in its file until it is asked for.
    """
    beside = path.with_name(UNCONTROLLED)
    compared = beside.is_file() and path.name != UNCONTROLLED
    return run_of({str(each): _checked(each, lazily) for each in [path, beside][: 1 + compared]})


def run_of(results: Mapping[str, xr.Dataset]) -> Run:
    """Return a result, and where there is one that without control, by their names."""
    found = [with_shapes(data, name) for name, data in results.items()]
    saved = sum(data.sizes["time"] for data in results.values())
    gone = saved - sum(data.sizes["time"] for data in found)
    return Run(found[0], found[1] if len(found) > 1 else None, gone)


def load(path: Path, *, lazily: bool = False) -> xr.Dataset:
    """Read a netCDF file, times as plain seconds: into memory, or but for what is large.

    Raises
    ------
    ReportError
        If the file is broken.
    """
    try:
        if lazily:
            return open_lazily(path)
        with xr.open_dataset(path, engine="netcdf4", decode_times=False) as stored:
            return stored.load()
    except (OSError, RuntimeError, ValueError, KeyError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise ReportError(f"{path}: not a readable netCDF file ({reason})") from error


def load_as(path: Path, kind: str, required: Mapping[str, tuple[str, ...]]) -> xr.Dataset:
    """Read a file that must hold some variables over some dimensions into memory."""
    dataset = load(path)
    for name, dims in required.items():
        if name not in dataset or dataset[name].dims != dims:
            over = f" over {', '.join(dims)}" if dims else ""
            text = f"not a file of crinoid with {kind}, it has no {name}{over}"
            raise ReportError(f"{path}: {text}")
    return dataset


def read_result(
    path: Path,
    required: Mapping[str, tuple[str, ...]] = _REQUIRED,
    *,
    lazily: bool = False,
) -> xr.Dataset:
    """Read one result file, which must hold some variables over some dimensions."""
    if not path.is_file():
        raise ReportError(f"{path}: no such file")
    if path.stat().st_size == 0:
        raise ReportError(f"{path}: the file is empty")
    dataset = load(path, lazily=lazily)
    for name, dims in required.items():
        if name not in dataset:
            if "crinoid_version" in dataset.attrs and name == "position":
                text = "output.variables left out position, which all figures need"
                raise ReportError(f"{path}: {text}")
            raise ReportError(f"{path}: not a crinoid result, it has no variable {name!r}")
        if dataset[name].dims != dims:
            raise ReportError(
                f"{path}: not a crinoid result, {name!r} has dimensions "
                f"{dataset[name].dims}, not {dims}"
            )
    for name in ("time", "axis"):
        if name not in dataset.coords:
            raise ReportError(f"{path}: not a crinoid result, it has no coordinate {name!r}")
    if tuple(map(str, dataset["axis"].values)) not in AXES.values():
        raise ReportError(
            f"{path}: not a crinoid result, its axes are not labelled x and z, or x, y, z"
        )
    if dataset.sizes["time"] == 0:
        raise ReportError(f"{path}: the result holds no records")
    time = dataset["time"].values.astype(float)
    if not (np.isfinite(time).all() and (np.diff(time) > 0.0).all()):
        raise ReportError(f"{path}: not a crinoid result, its times do not rise")
    if dataset.sizes.get("node", 0) < 2:
        raise ReportError(f"{path}: not a crinoid result, the arm has fewer than two nodes")
    return dataset


def open_result(path: Path, *, lazily: bool = False) -> xr.Dataset:
    """Read one result file; records without a shape to draw are left out."""
    return with_shapes(_checked(path, lazily), str(path))


def _checked(path: Path, lazily: bool) -> xr.Dataset:
    dataset = read_result(path, lazily=lazily)
    check_bodies(dataset, path)
    return dataset


def with_shapes(dataset: xr.Dataset, name: str) -> xr.Dataset:
    """Return the records with a shape to draw, of a result of some name that may have shapes."""
    if "position" not in dataset:
        return dataset
    # A run that diverged may end in records that no axis can hold.
    finite = np.concatenate(
        [shaped(piece["position"].values) for piece in pieces(dataset, ["position"])]
    )
    if not finite.any():
        shape = f"finite, within {_LARGEST:g} m, and no edge of length 0"
        raise ReportError(f"{name}: the result holds no record with a shape to draw: {shape}")
    return dataset if finite.all() else dataset.isel(time=np.flatnonzero(finite))


def bounded(values: Float[np.ndarray, "time ..."]) -> Bool[np.ndarray, " time"]:
    """Tell at which instants all numbers are finite and small enough to be drawn."""
    return np.asarray(np.all(np.abs(values.reshape(len(values), -1)) <= _LARGEST, axis=1))


def shaped(position: Float[np.ndarray, "time node axis"]) -> Bool[np.ndarray, " time"]:
    """Tell at which instants there is a shape to draw, all of whose edges point somewhere."""
    with np.errstate(invalid="ignore"):
        edges = np.abs(np.diff(position, axis=1)).max(axis=2)
    return bounded(position) & (edges > 0.0).all(axis=1)


def check_bodies(dataset: xr.Dataset, path: Path) -> None:
    """Refuse a result whose obstacles cannot be drawn."""
    try:
        find_bodies(dataset)
    except (
        tomllib.TOMLDecodeError,
        LookupError,
        TypeError,
        ValueError,
        ZeroDivisionError,
    ) as error:
        text = f"its scenario does not describe its obstacles ({type(error).__name__}: {error})"
        raise ReportError(f"{path}: not a crinoid result, {text}") from error


def base_direction(dataset: xr.Dataset, record: int) -> Float[np.ndarray, "axis=3"]:
    """Return the unit vector along which the base points at a record."""
    return np.asarray(base_directions(dataset, [record])[0])
