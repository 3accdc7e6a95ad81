"""The source of an export: a policy, or instants of a result, and what is told of the others."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr
from jaxtyping import Int

from crinoid.assembly.description import POLICY, Description
from crinoid.report.charts.space import Space, evenly, lacking, space_of
from crinoid.report.run import RESULT, ReportError, check_bodies, read_result
from crinoid.scenario import ScenarioError
from crinoid.status import Status


@dataclass(frozen=True)
class Source:
    """A result, what is large still in its file, and the instants that are taken."""

    path: Path
    data: xr.Dataset
    records: Int[np.ndarray, " chosen"]
    told: tuple[str, ...]
    """Sentences on what is left out."""

    @property
    def attributes(self) -> dict[str, str]:
        """Where an export comes from: title, status, version, and the name of the file."""
        found = self.data.attrs
        named = {name: str(found.get(name, "")) for name in ("title", "status", "crinoid_version")}
        return named | {"source": self.path.name}


def find_result(path: Path) -> Path:
    """Return the file of a result that is named by its folder or by itself.

    Raises
    ------
    ReportError
        If there is none, or a policy instead.
    """
    if _is_policy(path / POLICY if path.is_dir() and not (path / RESULT).exists() else path):
        raise ReportError(f"{path}: a policy and no result, takes --to onnx")
    if path.is_dir():
        if not (path / RESULT).is_file():
            raise ReportError(f"{path}: no {RESULT} here; of a study, name the folder of a case")
        return path / RESULT
    if not path.exists():
        raise ReportError(f"{path}: no such file or directory")
    return path


def find_policy(path: Path) -> Path:
    """Return the file of a policy that is named by the folder of its training or by itself.

    Raises
    ------
    ReportError
        If there is none.
    """
    if path.is_dir():
        path = path / POLICY
    if not path.is_file():
        raise ReportError(f"{path}: no such file, takes a policy that crinoid train wrote")
    return path


def open_table(path: Path, most: int) -> Source:
    """Open a result of which a table is to be made, of no more than a number of instants.

    Raises
    ------
    ReportError
        If it is not a readable result.
    """
    data = read_result(path, {}, lazily=True)
    records = evenly(data.sizes["time"], most)
    told = [*_ended(data), *_thinned(data.sizes["time"], records.size)]
    return Source(path, data, records, tuple(told))


def open_shapes(path: Path, most: int, nodes: int | None = None) -> tuple[Source, Space]:
    """Open a result of which shapes are to be shown, of no more instants and nodes than told.

    Raises
    ------
    ReportError
        If it is not a readable result, or at no instant all that is shown is finite.
    """
    data = read_result(path, lazily=True)
    check_bodies(data, path)
    try:
        space = space_of([("", data)], most, nodes or data.sizes["node"])
    except ReportError as error:
        raise ReportError(f"{path}: {error}") from error
    (moving,) = space.members
    told = [*_ended(data), *_thinned(moving.records, moving.at.size + moving.lacking)]
    told += [line.removesuffix(".") for line in lacking(space)]
    shown = moving.diameter.size
    if shown < space.nodes:
        told.append(f"the arm is shown by {shown} of its {space.nodes} nodes")
    return Source(path, data, moving.at, tuple(told)), space


def _ended(data: xr.Dataset) -> list[str]:
    status = str(data.attrs.get("status", Status.OK.value))
    return [] if Status.of(status) is Status.OK else [f"the run was not completed ({status})"]


def _thinned(there: int, taken: int) -> list[str]:
    if taken == there:
        return []
    return [
        f"{taken} of {there} saved instants are written, evenly chosen; "
        f"--instants {there} writes all"
    ]


def _is_policy(path: Path) -> bool:
    try:
        Description.of(path)
    except ScenarioError:
        return False
    return True
