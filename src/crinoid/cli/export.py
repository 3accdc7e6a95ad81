"""Export of a result or a policy: options of each format, and progress."""

from collections.abc import Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from crinoid.cli.command import at_least, folder_for, load_scenario
from crinoid.cli.interruption import Loading
from crinoid.scenario.errors import Mistake, ScenarioError, got, one_of, refusal
from crinoid.view.refusals import EXPORTS, require_path

_TABLES = ("csv", "xlsx")


def export_result(
    result: Path,
    kind: str,
    out: Path | None,
    *,
    variables: str | None,
    nodes: str | None,
    instants: int | None,
    force: bool,
) -> None:
    """Export a result or a policy, and report omissions."""
    if kind not in EXPORTS:
        kinds = (*EXPORTS, "fmu")
        near = get_close_matches(kind.lower(), kinds, n=1)
        raise ScenarioError([Mistake("--to", got(kind, f"be {one_of(kinds)}"), *near)])
    at_least(1, {"--instants": instants})
    if instants is not None and kind == "onnx":
        raise refusal("--instants", f"needs a result. Leave it out with --to {kind}.")
    for option, value in {"--variables": variables, "--nodes": nodes}.items():
        if value is not None and kind not in _TABLES:
            raise refusal(option, f"needs --to csv or xlsx. Leave it out with --to {kind}.")
    if out is not None and out.exists() and not out.is_dir():
        raise refusal("--out", f"{out} is a file; must be a folder")
    names = None if variables is None else [part.strip() for part in variables.split(",")]
    try:
        numbers = None if nodes is None else [int(part) for part in nodes.split(",")]
    except ValueError:
        must = "be whole numbers separated by commas, such as 0,10,-1"
        raise refusal("--nodes", got(nodes, must)) from None
    require_path(result)
    with Loading():
        from crinoid.cli.display import progress_bar, say_notes, say_written
        from crinoid.cli.folder import check_own, claimed
        from crinoid.view import export
        from crinoid.view.export.source import files_of, find_policy, find_result

    path = find_policy(result) if kind == "onnx" else find_result(result)
    folder = path.parent if out is None else out
    with claimed(folder):
        for file in [] if force else files_of(folder, path.stem, kind):
            check_own(file)
        with progress_bar() as bar:
            task = bar.task_ids[0]
            bar.update(task, description="reading")

            def report(done: int, count: int) -> None:
                reached = f"{done} of {count} instants"
                bar.update(
                    task, description="writing", total=count, completed=done, reached=reached
                )

            options: dict[str, Any] = {"instants": instants, "report": report}
            if kind in _TABLES:
                options |= {"variables": names, "nodes": numbers}
            write = getattr(export, f"write_{kind}")
            written = write(path, folder, **({} if kind == "onnx" else options))
    say_notes(written.notes)
    say_written(written.files)


def export_scenario(
    name: str,
    settings: list[str] | None,
    out: Path | None,
    unused: Mapping[str, object],
    *,
    force: bool,
) -> None:
    """Export a scenario as an FMU; options of results must be ``unused``."""
    for option, value in unused.items():
        if value is not None:
            raise refusal(option, "needs a result. Leave it out with --to fmu.")
    scenario, folder = load_scenario(name, settings), folder_for(out, name, settings=settings)
    stem = Path(name).stem
    with Loading():
        from crinoid.cli.display import say_written
        from crinoid.cli.folder import check_own, claimed
        from crinoid.view.export.fmu import write_fmu

    with claimed(folder):
        if not force:
            check_own(folder / f"{stem}.fmu")
        written = write_fmu(scenario, folder, stem)
    say_written([written])
