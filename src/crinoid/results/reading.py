"""Reading of files to draw: of results, and of findings of other commands."""

from collections.abc import Mapping, Sequence
from fnmatch import fnmatchcase
from pathlib import Path

import numpy as np
import xarray as xr

from crinoid.results.chunks import pieces
from crinoid.results.report_error import ReportError
from crinoid.results.result import UNCONTROLLED, Result
from crinoid.results.result_checks import fault_of
from crinoid.results.scene.data import LARGEST, find_obstacles, shaped
from crinoid.results.stream import open_lazily

_DRAWN = ("position", "tip_position", "tip_target", "tip_error")
"""Variables that drawing needs; without any other a figure omits its panel."""


def open_drawable(path: Path, *, lazily: bool = False) -> Result:
    """Read the file of a result, and the one without control next to it, to draw them.

    Instants without a shape to draw are left out. With ``lazily`` large variables stay in the file
    until they are used.
    """
    result, names = checked_result(path, lazily=lazily), [str(path)]
    other = path.with_name(UNCONTROLLED)
    if path.name == UNCONTROLLED:
        title = result.dataset.attrs.get("title", "") or "A run"
        result.dataset.attrs["title"] = f"{title}, without control"
    elif other.is_file():
        result.uncontrolled = checked_result(other, lazily=lazily)
        names.append(str(other))
    return with_shapes(result, *names)


def load(path: Path, *, lazily: bool = False) -> xr.Dataset:
    """Read a netCDF file, times as seconds; with ``lazily`` large variables stay on disk."""
    try:
        if lazily:
            return open_lazily(path)
        with xr.open_dataset(path, engine="netcdf4", decode_times=False) as stored:
            return stored.load()
    except (OSError, RuntimeError, ValueError, KeyError) as error:
        reason = next((each for each in error.args if isinstance(each, str)), repr(error))
        raise ReportError(f"{path}: not a readable netCDF file ({reason})") from error


def load_as(path: Path, kind: str, required: Mapping[str, str]) -> xr.Dataset:
    """Read a file of a kind into memory, which has some variables by their dimensions; ``*``: any.

    Dimensions, and names of variables, are separated by blanks.
    """
    dataset = load(path)
    for dims, names in required.items():
        for name in names.split():
            known = " ".join(map(str, dataset[name].dims)) if name in dataset else ""
            if name not in dataset or not fnmatchcase(known, dims):
                over = f" over {dims.replace(' ', ', ')}" if dims else ""
                text = f"not a file of crinoid with {kind}, it has no {name}{over}"
                raise ReportError(f"{path}: {text}")
    return dataset


def read_result(
    path: Path, required: Sequence[str] = _DRAWN, *, lazily: bool = False
) -> xr.Dataset:
    """Read one result file, with some variables."""
    if not path.is_file():
        raise ReportError(f"{path}: no such file")
    if path.stat().st_size == 0:
        raise ReportError(f"{path}: the file is empty")
    dataset = load(path, lazily=lazily)
    own = "crinoid_version" in dataset.attrs
    if own and "position" in required and "position" not in dataset:
        text = "output.variables left out position, which all figures need"
        raise ReportError(f"{path}: {text}")
    obstacles = ["obstacle_position"] if required and "contact_force" in dataset else []
    if fault := fault_of(dataset, [*required, *obstacles]):
        raise ReportError(f"{path}: not a result of crinoid, {fault}")
    return dataset


def checked_result(path: Path, *, lazily: bool = False) -> Result:
    """Read the file of a result whose obstacles can be drawn."""
    result = Result(read_result(path, lazily=lazily))
    try:
        find_obstacles(result)
    except (LookupError, ValueError) as error:
        reason = result.readable[1] or str(error).partition("\n")[0]
        text = f"its scenario does not describe its obstacles ({reason})"
        raise ReportError(f"{path}: not a result of crinoid, {text}") from error
    return result


def with_shapes(result: Result, *names: str) -> Result:
    """Return both runs of a result, of files with some names, where they have a shape to draw."""
    members = [each for _, each in result.members]
    shown = [_shaped(each.dataset, name) for each, name in zip(members, names, strict=True)]
    found, *other = (Result(data) for data in shown)
    found.uncontrolled = other[0] if other else None
    saved = sum(each.dataset.sizes["time"] for each in members)
    found.shapeless = saved - sum(data.sizes["time"] for data in shown)
    return found


def _shaped(dataset: xr.Dataset, name: str) -> xr.Dataset:
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
