"""Exporting a result or a policy: which options go with which format, and progress."""

from collections.abc import Callable
from difflib import get_close_matches
from functools import partial
from pathlib import Path
from typing import NamedTuple

from rich.console import Console

from crinoid.cli.folder import check_own, claimed
from crinoid.cli.lines import say_notes, say_written
from crinoid.cli.progress import progress_bar
from crinoid.export import Written, write_csv, write_gltf, write_onnx, write_vtkhdf
from crinoid.export.files import KINDS, files_of, is_own
from crinoid.export.source import find_policy, find_result
from crinoid.scenario import Mistake, ScenarioError, one_of, shown


class Table(NamedTuple):
    """Options of a table as they are given."""

    variables: str | None
    nodes: str | None


def export_result(
    result: Path,
    kind: str,
    out: Path | None,
    table: Table,
    *,
    instants: int | None,
    force: bool,
    console: Console,
) -> None:
    """Export a result or a policy, and report omissions."""
    if kind not in KINDS:
        near = get_close_matches(kind.lower(), KINDS, n=1)
        raise _mistake("--to", f"got {shown(kind)}, takes {one_of(KINDS)}", *near)
    if instants is not None and instants < 1:
        raise _mistake("--instants", f"got {instants}, takes a number of 1 or more")
    if instants is not None and kind == "onnx":
        raise _mistake("--instants", f"goes with results, not with --to {kind}")
    for option, value in {"--variables": table.variables, "--nodes": table.nodes}.items():
        if value is not None and kind != "csv":
            raise _mistake(option, f"goes with --to csv, not with --to {kind}")
    if out is not None and out.exists() and not out.is_dir():
        raise _mistake("--out", f"{out} is a file, takes a folder")
    path = find_policy(result) if kind == "onnx" else find_result(result)
    folder = path.parent if out is None else out
    writers: dict[str, Callable[..., Written]] = {
        "csv": partial(write_csv, variables=_names(table.variables), nodes=_numbers(table.nodes)),
        "vtkhdf": write_vtkhdf,
        "gltf": write_gltf,
        "onnx": lambda path, folder, **_: write_onnx(path, folder),
    }
    with claimed(folder):
        for file in [] if force else files_of(folder, path.stem, kind):
            check_own(file, is_own)
        with progress_bar(console) as bar:
            task = bar.task_ids[0]
            bar.update(task, description="reading")

            def report(done: int, count: int) -> None:
                reached = f"{done} of {count} instants"
                bar.update(
                    task, description="writing", total=count, completed=done, reached=reached
                )

            written = writers[kind](path, folder, instants=instants, report=report)
    say_notes(console, written.notes)
    say_written(console, written.files)


def _names(text: str | None) -> list[str] | None:
    return None if text is None else [part.strip() for part in text.split(",")]


def _numbers(text: str | None) -> list[int] | None:
    if text is None:
        return None
    try:
        return [int(part) for part in text.split(",")]
    except ValueError:
        takes = "takes whole numbers with commas between them, such as 0,10,-1"
        raise _mistake("--nodes", f"got {shown(text)}, {takes}") from None


def _mistake(option: str, text: str, near: str = "") -> ScenarioError:
    return ScenarioError([Mistake(option, text, near)])
