"""Source of an export: a policy or a result, the chosen instants, and notes on the others."""

from collections.abc import Callable, Sequence
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
from crinoid.view.export.formats import Format
from crinoid.view.refusals import require_path

Files = Sequence[Path]
Report = Callable[[int, int], None]  # receives the numbers of written and of all instants


@dataclass(frozen=True)
class PolicySource:
    """The file of a policy."""

    path: Path
    notes: tuple[str, ...] = ()  # sentences on omissions


@dataclass(frozen=True)
class Source:
    """A result whose large variables are still in its file, and the chosen instants."""

    path: Path
    notes: tuple[str, ...]  # sentences on omissions
    data: xr.Dataset
    records: Int[np.ndarray, " chosen"]

    @property
    def result(self) -> Result:
        """The run, with the one without control next to it."""
        other = self.path.with_name(UNCONTROLLED)
        if self.path.name != RESULT or not other.is_file():
            return Result(self.data)
        return Result(self.data, uncontrolled=Result(read_result(other, (), lazily=True)))

    @property
    def attributes(self) -> dict[str, str]:
        """Title, status, version, and the name of the file."""
        found = self.data.attrs
        named = {name: str(found.get(name, "")) for name in ("title", "status", "crinoid_version")}
        return named | {"source": self.path.name}


@dataclass(frozen=True)
class Table(Source):
    """A result for a table."""

    variables: Sequence[str] | None  # names; none: all that are not along the arm
    nodes: Sequence[int] | None  # of variables along the arm; none: all


@dataclass(frozen=True)
class Shapes(Source):
    """A result for shapes in space."""

    scene: Scene

    @property
    def run(self) -> Keyframes:
        """The keyframes of the run."""
        return self.scene.members[0]

    @property
    def attitudes(self) -> Rotations:
        """The attitude of the arm over time at the chosen nodes."""
        data, run, director = self.data, self.run, None
        if "director" in data:
            pieces = chosen_pieces(data, ["director"], run.at)
            director = np.concatenate([piece["director"].values for piece in pieces])
        chosen = even_indices(data.sizes["node"], run.diameter.size)
        return arm_attitudes(run.position, None if director is None else director[:, chosen[:-1]])


def find_source(path: Path, form: Format) -> Path:
    """Return the file of a result, or of a policy, from its folder or its own path."""
    if form.accepts == "policy":
        path = path / POLICY if path.is_dir() else path
        if not path.is_file():
            raise ReportError(f"{path}: no such file; must be a policy that crinoid train wrote")
        return path
    if is_policy(path / POLICY if path.is_dir() and not (path / RESULT).exists() else path):
        raise ReportError(f"{path}: is a policy. Export it with --to onnx.")
    if path.is_dir():
        if not (path / RESULT).is_file():
            hint = "Of a study, name the folder of a case."
            raise ReportError(f"{path}: contains no {RESULT}. {hint}")
        return path / RESULT
    require_path(path)
    return path


def open_source(
    path: Path,
    form: Format,
    instants: int | None,
    variables: Sequence[str] | None,
    nodes: Sequence[int] | None,
) -> PolicySource | Table | Shapes:
    """Open what a format accepts, at no more than some instants and its most nodes."""
    path, most = find_source(path, form), instants or form.instants
    if form.accepts == "policy":
        return PolicySource(path)
    if form.accepts == "shapes":
        return _open_shapes(path, most, form.nodes)
    data = read_result(path, (), lazily=True)
    records = even_indices(data.sizes["time"], most)
    notes = _notes(data, data.sizes["time"], records.size)
    return Table(path, tuple(notes), data, records, variables, nodes)


def _open_shapes(path: Path, most: int, nodes: int | None) -> Shapes:
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
    return Shapes(path, tuple(notes), data, run.at, scene)


def _notes(data: xr.Dataset, saved: int, chosen: int) -> list[str]:
    status = str(data.attrs.get("status", Status.OK.value))
    notes = [] if Status.of(status) is Status.OK else [f"the run was not completed ({status})"]
    if chosen != saved:
        text = f"{chosen} of {saved} saved instants are written, evenly chosen"
        notes.append(f"{text}; --instants {saved} writes all")
    return notes
