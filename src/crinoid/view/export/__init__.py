"""Exports of results and policies for ParaView, spreadsheets, Blender, ROS 2 and vehicles."""

import json
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from crinoid.assembly.neural import read_policy
from crinoid.foundation.atomic_file import FilePath, atomic_write
from crinoid.results.report_error import ReportError
from crinoid.results.scene.bodies import rigid_bodies
from crinoid.scenario import ScenarioError
from crinoid.view.export.source import (
    attitudes_at,
    files_of,
    find_policy,
    find_result,
    open_shapes,
    open_table,
)
from crinoid.view.export.table import columns_of, variables_of, write_table
from crinoid.view.export.vtkhdf import write_arm, write_bodies

__all__ = [
    "Written",
    "write_csv",
    "write_gltf",
    "write_mcap",
    "write_onnx",
    "write_usd",
    "write_vtkhdf",
    "write_xlsx",
]

ROWS = 1_000_000
"""Most rows of a table, about the limit of spreadsheets."""
INSTANTS = 1501
"""Most instants of an animation: 30 s at 50 a second."""
_NODES = 201
"""Most nodes of an animation, each of which becomes a bone."""

Report = Callable[[int, int], None]
"""Receives the numbers of written and of all instants."""


@dataclass(frozen=True)
class Written:
    """Files of an export, and notes on it."""

    files: list[Path]
    """The written files."""
    notes: list[str]
    """Sentences on omissions."""


def write_csv(
    result: FilePath,
    folder: FilePath,
    *,
    variables: Sequence[str] | None = None,
    nodes: Sequence[int] | None = None,
    instants: int | None = None,
    report: Report = lambda done, count: None,
) -> Written:
    """Write a table with a column for each part of a variable and a row for each instant.

    Parameters
    ----------
    result
        A result's folder or file.
    folder
        Folder to write into; the file has the name of the result.
    variables
        Names of variables over time; all that are not along the arm by default.
    nodes
        Numbers of the nodes, or edges, to write of variables along the arm; all by default.
        Negative ones count from the tip.
    instants
        Largest number of instants, evenly chosen where there are more; 1000000 by default.
    report
        Called with the numbers of written and of all instants.
    """
    return _write_columns(write_table, result, folder, "csv", variables, nodes, instants, report)


def write_xlsx(
    result: FilePath,
    folder: FilePath,
    *,
    variables: Sequence[str] | None = None,
    nodes: Sequence[int] | None = None,
    instants: int | None = None,
    report: Report = lambda done, count: None,
) -> Written:
    """Write a workbook of three sheets: measures, the table of `write_csv`, and its variables.

    Parameters
    ----------
    result, folder, variables, nodes, instants, report
        Those of `write_csv`.
    """
    try:
        from crinoid.view.export.workbook import write_workbook
    except ModuleNotFoundError as error:
        if error.name != "xlsxwriter":
            raise
        text = 'XLSX is written by xlsxwriter: pip install "crinoid[export]"'
        raise ReportError(text) from error
    return _write_columns(
        write_workbook, result, folder, "xlsx", variables, nodes, instants, report
    )


def _write_columns(
    write: Callable[..., list[str]],
    result: FilePath,
    folder: FilePath,
    kind: str,
    variables: Sequence[str] | None,
    nodes: Sequence[int] | None,
    instants: int | None,
    report: Report,
) -> Written:
    source = open_table(find_result(Path(result)), instants or ROWS)
    columns = columns_of(source.data, variables_of(source.data, variables), nodes)
    (file,) = files_of(Path(folder), source.path.stem, kind)
    with atomic_write(file) as temporary:
        notes = write(source, columns, temporary, report)
    return Written([file], [*source.notes, *notes])


def write_vtkhdf(
    result: FilePath,
    folder: FilePath,
    *,
    instants: int | None = None,
    report: Report = lambda done, count: None,
) -> Written:
    """Write the arm as a line with its variables, and rigid bodies around it as surfaces.

    Parameters
    ----------
    result
        A result's folder or file.
    folder
        Folder to write into; both files have the name of the result.
    instants
        Largest number of instants, evenly chosen where there are more; 1501 by default.
    report
        Called with the numbers of written and of all instants.
    """
    source, scene = open_shapes(find_result(Path(result)), instants or INSTANTS)
    files = files_of(Path(folder), source.path.stem, "vtkhdf")
    with ExitStack() as stack:
        arm, surroundings = (stack.enter_context(atomic_write(file)) for file in files)
        notes = write_arm(source, arm, report)
        write_bodies(source, rigid_bodies(scene, scene.members[0]), surroundings)
    return Written(files, [*source.notes, *notes])


def write_gltf(
    result: FilePath,
    folder: FilePath,
    *,
    instants: int | None = None,
    report: Report = lambda done, count: None,
) -> Written:
    """Write an animation: the arm as a skin on its nodes, and rigid bodies around it.

    Parameters
    ----------
    result
        A result's folder or file.
    folder
        Folder to write into; the file has the name of the result.
    instants
        Largest number of instants, evenly chosen where there are more; 1501 by default.
    report
        Called with the numbers of written and of all instants.
    """
    try:
        from crinoid.view.export.gltf import GltfDocument, skin_of
    except ModuleNotFoundError as error:
        if error.name != "pygltflib":
            raise
        text = 'glTF is written by pygltflib: pip install "crinoid[export]"'
        raise ReportError(text) from error
    source, scene = open_shapes(find_result(Path(result)), instants or INSTANTS, _NODES)
    (file,), (run,) = files_of(Path(folder), source.path.stem, "gltf"), scene.members
    document = GltfDocument(run.time, source.attributes)
    document.add_arm(skin_of(source.data, run), run.position, attitudes_at(source.data, run))
    for body in rigid_bodies(scene, run):
        document.add_body(body)
    report(run.at.size, run.at.size)
    with atomic_write(file) as temporary:
        document.write(temporary)
    return Written([file], list(source.notes))


def write_mcap(
    result: FilePath,
    folder: FilePath,
    *,
    instants: int | None = None,
    report: Report = lambda done, count: None,
) -> Written:
    """Write a log of ROS 2 in the format MCAP, and a layout of Foxglove for it.

    Parameters
    ----------
    result
        A result's folder or file.
    folder
        Folder to write into; both files have the name of the result.
    instants
        Largest number of instants, evenly chosen where there are more; 1501 by default.
    report
        Called with the numbers of written and of all instants.
    """
    try:
        from crinoid.view.export.foxglove import layout_of
        from crinoid.view.export.ros import write_log
    except ModuleNotFoundError as error:
        if error.name not in ("mcap_ros2", "mcap_ros2.writer", "rosbags", "rosbags.typesys"):
            raise
        text = 'MCAP is written by mcap-ros2-support and rosbags: pip install "crinoid[ros]"'
        raise ReportError(text) from error
    source, scene = open_shapes(find_result(Path(result)), instants or INSTANTS, _NODES)
    files = files_of(Path(folder), source.path.stem, "mcap")
    with ExitStack() as stack:
        log, layout = (stack.enter_context(atomic_write(file)) for file in files)
        write_log(source, scene, log, report)
        layout.write_text(json.dumps(layout_of(source, scene), indent=1), "utf-8")
    return Written(files, list(source.notes))


def write_usd(
    result: FilePath,
    folder: FilePath,
    *,
    instants: int | None = None,
    report: Report = lambda done, count: None,
) -> Written:
    """Write a stage of USD: the arm as a curve with widths, and rigid bodies around it.

    Parameters
    ----------
    result
        A result's folder or file.
    folder
        Folder to write into; the file has the name of the result.
    instants
        Largest number of instants, evenly chosen where there are more; 1501 by default.
    report
        Called with the numbers of written and of all instants.
    """
    try:
        from crinoid.view.export.usd import stage_of
    except ModuleNotFoundError as error:
        if error.name != "pxr":
            raise
        raise ReportError('USD is written by usd-core: pip install "crinoid[usd]"') from error
    source, scene = open_shapes(find_result(Path(result)), instants or INSTANTS, _NODES)
    (file,), (run,) = files_of(Path(folder), source.path.stem, "usd"), scene.members
    text = stage_of(scene, attitudes_at(source.data, run), source.attributes)
    report(run.at.size, run.at.size)
    with atomic_write(file) as temporary:
        temporary.write_text(text, "utf-8")
    return Written([file], list(source.notes))


def write_onnx(policy: FilePath, folder: FilePath) -> Written:
    """Write a policy as a graph of ONNX, which is called once in each control period.

    Its numbers have 64 bits. Inputs are ``observed`` (entry), ``averages`` (average, entry), and
    ``command``, ``lower`` and ``upper`` (driven): the last commands and their limits. Outputs
    are ``next_command`` and ``next_averages``, for the next call. In the first call all averages
    equal the observation. The file's metadata name entries, commands and their units.

    Parameters
    ----------
    policy
        A policy that ``crinoid train`` wrote, or its folder.
    folder
        Folder to write into; the file has the name of the policy.
    """
    try:
        from crinoid.view.export.network import model_of
    except ModuleNotFoundError as error:
        if error.name != "onnx":
            raise
        text = 'ONNX is written by onnx: pip install "crinoid[export]"'
        raise ReportError(text) from error
    path = find_policy(Path(policy))
    try:
        model = model_of(*read_policy(path))
    except ScenarioError as error:
        raise ReportError(error.mistakes[0].text) from error
    (file,) = files_of(Path(folder), path.stem, "onnx")
    with atomic_write(file) as temporary:
        temporary.write_bytes(model.SerializeToString())
    return Written([file], [])
