"""Exports of results and policies for ParaView, spreadsheets, Blender, ROS 2 and vehicles."""

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from crinoid.foundation.atomic_file import FilePath, atomic_write
from crinoid.results.report_error import ReportError
from crinoid.view.export.formats import format_for, place_of, writer_of

__all__ = ["Written", "write_export"]


@dataclass(frozen=True)
class Written:
    """Files of an export, and notes on it."""

    files: list[Path]
    """The written files."""
    notes: list[str]
    """Sentences on omissions."""


def write_export(
    path: FilePath,
    folder: FilePath,
    to: str,
    *,
    variables: Sequence[str] | None = None,
    nodes: Sequence[int] | None = None,
    instants: int | None = None,
    report: Callable[[int, int], None] = lambda done, count: None,
) -> Written:
    """Write a result in a format of other programs, or a policy as ONNX.

    Parameters
    ----------
    path
        A result's folder or file; with ``"onnx"`` a policy that ``crinoid train`` wrote, or its
        folder.
    folder
        Folder to write into; the files have the name of the result or the policy. A name with the
        ending of the format is that of the file.
    to
        ``"csv"`` and ``"xlsx"`` are tables: a column for each part of a variable, a row for each
        instant. ``"vtkhdf"`` has the arm as a line with its variables, and rigid bodies as
        surfaces; ``"gltf"`` and ``"usd"`` are animations, ``"mcap"`` is a log of ROS 2.
        ``"onnx"`` is a graph that is called once in each control period.
    variables
        Of a table: names of variables over time; all that are not along the arm by default.
    nodes
        Of a table: numbers of the nodes, or edges, to write of variables along the arm; all by
        default. Negative ones count from the tip.
    instants
        Largest number of instants, evenly chosen where there are more; by default 1501, in a table
        1000000.
    report
        Called with the numbers of written and of all instants.

    Raises
    ------
    ScenarioError
        If the format, a variable or a node is unknown, the format has no use for an option, or
        ``instants`` is below 1.
    ReportError
        If there is nothing to write, or the library of the format is not installed.
    """
    options = {"--variables": variables, "--nodes": nodes, "--instants": instants}
    form = format_for(to, options)
    if form.accepts == "scenario":
        raise ReportError(f"--to: {to} is of a scenario. Use crinoid.view.export.fmu.write_fmu.")
    write = writer_of(form)
    from crinoid.view.export.source import open_source

    source = open_source(Path(path), form, instants, variables, nodes)
    place, stem = place_of(Path(folder), form, source.path.stem)
    files = [place / f"{stem}{ending}" for ending in form.endings]
    place.mkdir(parents=True, exist_ok=True)
    with ExitStack() as stack:
        temporary = [stack.enter_context(atomic_write(file)) for file in files]
        notes = write(source, temporary, report)
        if not all(file.exists() and file.stat().st_size for file in temporary):
            raise RuntimeError(f"{form.writer} left a file empty: it must write to the given names")
    return Written(files, [*source.notes, *notes])
