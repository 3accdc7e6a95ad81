"""Writing in the formats of other programs, each file whole or not at all."""

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from crinoid.assembly.weights import read_policy
from crinoid.export.arm import arc_length_of, attitudes_at, skin_of
from crinoid.export.files import files_of
from crinoid.export.source import find_policy, find_result, open_shapes, open_table
from crinoid.export.table import columns_of, variables_of, write_table
from crinoid.export.things import things_of
from crinoid.export.vtkhdf import write_arm, write_things
from crinoid.replacement import FilePath, replacing
from crinoid.report.run import ReportError
from crinoid.scenario import ScenarioError

ROWS = 1_000_000
"""Most rows of a table: about what a spreadsheet holds."""
INSTANTS = 1501
"""Most instants of what is to be looked at: 30 s at 50 a second."""
_NODES = 201
"""Most nodes of an animation, each of which is a bone where it is opened."""

Report = Callable[[int, int], None]
"""Is told how many instants are written, and of how many."""


@dataclass(frozen=True)
class Written:
    """An export."""

    files: list[Path]
    """Files that were written."""
    notes: list[str]
    """Sentences on what is left out."""


def write_csv(
    result: FilePath,
    folder: FilePath,
    *,
    variables: Sequence[str] | None = None,
    nodes: Sequence[int] | None = None,
    instants: int | None = None,
    report: Report = lambda done, count: None,
) -> Written:
    """Write a table with a column for each part of some variables, and a row for each instant.

    Parameters
    ----------
    result
        A result's folder or file.
    folder
        Where to write, named after the result.
    variables
        Names of variables over time; all that are not along the arm by default.
    nodes
        Numbers of the nodes, or of the edges, to take of variables along the arm; all by default.
        Negative ones count from the tip.
    instants
        Largest number of instants, evenly chosen where there are more; 1000000 by default.
    report
        Called as it gets on.

    Raises
    ------
    ReportError
        If there is no readable result.
    ScenarioError
        If it has no such variable or node.
    OSError
        If the file cannot be written.
    """
    source = open_table(find_result(Path(result)), instants or ROWS)
    columns = columns_of(source.data, variables_of(source.data, variables), nodes)
    (file,) = files_of(Path(folder), source.path.stem, "csv")
    with replacing(file) as temporary:
        notes = write_table(source, columns, temporary, _of(report, source.records.size))
    return Written([file], [*source.told, *notes])


def write_vtkhdf(
    result: FilePath,
    folder: FilePath,
    *,
    instants: int | None = None,
    report: Report = lambda done, count: None,
) -> Written:
    """Write the arm as a line with all that is known along it, and what is about it as surfaces.

    Parameters
    ----------
    result
        A result's folder or file.
    folder
        Where to write two files, named after the result.
    instants
        Largest number of instants, evenly chosen where there are more; 1501 by default.
    report
        Called as it gets on.

    Raises
    ------
    ReportError
        If there is no readable result with positions.
    OSError
        If a file cannot be written.
    """
    source, space = open_shapes(find_result(Path(result)), instants or INSTANTS)
    files = files_of(Path(folder), source.path.stem, "vtkhdf")
    count, things = source.records.size, things_of(space)
    with ExitStack() as stack:
        arm, surroundings = (stack.enter_context(replacing(file)) for file in files)
        notes = write_arm(source, arm, _of(report, count))
        write_things(source, things, surroundings)
    return Written(files, [*source.told, *notes])


def write_gltf(
    result: FilePath,
    folder: FilePath,
    *,
    instants: int | None = None,
    report: Report = lambda done, count: None,
) -> Written:
    """Write an animation: the arm as a skin on its nodes, and what is about it.

    Parameters
    ----------
    result
        A result's folder or file.
    folder
        Where to write, named after the result.
    instants
        Largest number of instants, evenly chosen where there are more; 1501 by default.
    report
        Called as it gets on.

    Raises
    ------
    ReportError
        If there is no readable result with positions, or pygltflib is not installed.
    OSError
        If the file cannot be written.
    """
    try:
        from crinoid.export.gltf import Document
    except ModuleNotFoundError as error:
        if error.name != "pygltflib":
            raise
        text = 'glTF is written by pygltflib: pip install "crinoid[export]"'
        raise ReportError(text) from error
    source, space = open_shapes(find_result(Path(result)), instants or INSTANTS, _NODES)
    (file,), (moving,) = files_of(Path(folder), source.path.stem, "gltf"), space.members
    skin = skin_of(moving, arc_length_of(source.data, moving))
    things = things_of(space)
    document = Document(moving.time, source.attributes)
    document.add_arm(skin, moving.position, attitudes_at(source.data, moving))
    for thing in things:
        document.add_thing(thing)
    report(moving.at.size, moving.at.size)
    with replacing(file) as temporary:
        document.write(temporary)
    return Written([file], list(source.told))


def write_onnx(policy: FilePath, folder: FilePath) -> Written:
    """Write a policy as a graph of ONNX, of which each control period takes one call.

    Its numbers have 64 bits. Inputs are ``observed`` (entry), ``averages`` (average, entry), and
    ``command``, ``lower`` and ``upper`` (driven): the last commands and their limits. Outputs
    are ``next_command`` and ``next_averages``, for the next call. Before the first one all averages
    are what is observed. The file's metadata name entries, commands and their units.

    Parameters
    ----------
    policy
        A policy that ``crinoid train`` wrote, or its folder.
    folder
        Where to write, named after the policy.

    Raises
    ------
    ReportError
        If there is no readable policy, or onnx is not installed.
    OSError
        If the file cannot be written.
    """
    try:
        from crinoid.export.network import model_of
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
    with replacing(file) as temporary:
        temporary.write_bytes(model.SerializeToString())
    return Written([file], [])


def _of(report: Report, count: int) -> Callable[[int], None]:
    return lambda done: report(done, count)
