"""Source of an export: a policy or a result, the chosen instants, and notes on the others."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr
from jaxtyping import Int

from crinoid.assembly.description import POLICY, is_policy
from crinoid.foundation.status import Status
from crinoid.results.chunks import chosen_pieces
from crinoid.results.reading import checked_result, read_result
from crinoid.results.report_error import ReportError
from crinoid.results.result import RESULT, UNCONTROLLED, Result
from crinoid.results.scene.data import even_indices
from crinoid.results.scene.mesh import Rotations, arm_attitudes
from crinoid.results.scene.scene import Keyframes, Scene, build_scene, omission_notes
from crinoid.view.refusals import EXPORTS, require_path


def files_of(folder: Path, name: str, kind: str) -> list[Path]:
    """Return the files of an export of a result or policy with a name."""
    return [folder / f"{name}{ending}" for ending in EXPORTS[kind]]


def exports_of(file: str) -> list[str]:
    """Return the names that the exports of a result or policy have."""
    stem = Path(file).stem
    return [f"{stem}{ending}" for kind in EXPORTS.values() for ending in kind]


@dataclass(frozen=True)
class Source:
    """A result whose large variables are still in its file, and the chosen instants."""

    path: Path
    data: xr.Dataset
    records: Int[np.ndarray, " chosen"]
    notes: tuple[str, ...]  # sentences on omissions

    @property
    def result(self) -> Result:
        """The run, with the one without control next to it."""
        other = self.path.with_name(UNCONTROLLED)
        if self.path.name != RESULT or not other.is_file():
            return Result(self.data)
        return Result(self.data, uncontrolled=Result(read_result(other, {}, lazily=True)))

    @property
    def attributes(self) -> dict[str, str]:
        """Title, status, version, and the name of the file."""
        found = self.data.attrs
        named = {name: str(found.get(name, "")) for name in ("title", "status", "crinoid_version")}
        return named | {"source": self.path.name}


def find_result(path: Path) -> Path:
    """Return the file of a result from its folder or its own path."""
    if is_policy(path / POLICY if path.is_dir() and not (path / RESULT).exists() else path):
        raise ReportError(f"{path}: is a policy. Export it with --to onnx.")
    if path.is_dir():
        if not (path / RESULT).is_file():
            hint = "Of a study, name the folder of a case."
            raise ReportError(f"{path}: contains no {RESULT}. {hint}")
        return path / RESULT
    require_path(path)
    return path


def find_policy(path: Path) -> Path:
    """Return the file of a policy from the folder of its training or its own path."""
    if path.is_dir():
        path = path / POLICY
    if not path.is_file():
        raise ReportError(f"{path}: no such file; must be a policy that crinoid train wrote")
    return path


def open_table(path: Path, most: int) -> Source:
    """Open a result for a table of at most a number of instants."""
    data = read_result(path, {}, lazily=True)
    records = even_indices(data.sizes["time"], most)
    notes = _notes(data, data.sizes["time"], records.size)
    return Source(path, data, records, tuple(notes))


def open_shapes(path: Path, most: int, nodes: int | None = None) -> tuple[Source, Scene]:
    """Open a result for shapes at no more than some instants and nodes."""
    result = checked_result(path, lazily=True)
    data = result.dataset
    try:
        scene = build_scene(result, most, nodes)
    except ReportError as error:
        raise ReportError(f"{path}: {error}") from error
    (run,) = scene.members
    notes = _notes(data, run.records, run.at.size + run.omitted)
    notes += [line.removesuffix(".") for line in omission_notes(scene)]
    shown = run.diameter.size
    if shown < scene.nodes:
        notes.append(f"the arm is shown by {shown} of its {scene.nodes} nodes")
    return Source(path, data, run.at, tuple(notes)), scene


def attitudes_at(data: xr.Dataset, run: Keyframes) -> Rotations:
    """Return the attitude of the arm over time at the chosen nodes."""
    director = None
    if "director" in data:
        pieces = chosen_pieces(data, ["director"], run.at)
        director = np.concatenate([piece["director"].values for piece in pieces])
    chosen = even_indices(data.sizes["node"], run.diameter.size)
    return arm_attitudes(run.position, None if director is None else director[:, chosen[:-1]])


def _notes(data: xr.Dataset, saved: int, chosen: int) -> list[str]:
    status = str(data.attrs.get("status", Status.OK.value))
    notes = [] if Status.of(status) is Status.OK else [f"the run was not completed ({status})"]
    if chosen != saved:
        text = f"{chosen} of {saved} saved instants are written, evenly chosen"
        notes.append(f"{text}; --instants {saved} writes all")
    return notes
