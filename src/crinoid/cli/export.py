"""Export of a result or a policy: options of each format, and progress."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from crinoid.cli.command import folder_for, load_text
from crinoid.cli.interruption import Loading
from crinoid.scenario.errors import got, refusal
from crinoid.view.export import write_export
from crinoid.view.export.formats import format_for, place_of, writer_of
from crinoid.view.refusals import require_path


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
    form = format_for(kind, {"--variables": variables, "--nodes": nodes, "--instants": instants})
    if out is not None and place_of(out, form, "")[0].is_file():
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
        from crinoid.view.export.source import find_source

    path = find_source(result, form)
    place = path.parent if out is None else out
    folder, stem = place_of(place, form, path.stem)
    with claimed(folder):
        for ending in () if force else form.endings:
            check_own(folder / f"{stem}{ending}")
        with progress_bar() as bar:
            task = bar.task_ids[0]
            bar.update(task, description="reading")

            def report(done: int, count: int) -> None:
                reached = f"{done} of {count} instants"
                bar.update(
                    task, description="writing", total=count, completed=done, reached=reached
                )

            options: dict[str, Any] = {"variables": names, "nodes": numbers, "instants": instants}
            written = write_export(path, place, kind, report=report, **options)
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
    form = format_for("fmu", unused)
    scenario, stem = load_text(name, settings).scenario, Path(name).stem
    if out is not None:
        out, stem = place_of(out, form, stem)
    folder = folder_for(out, name, settings=settings)
    with Loading():
        from crinoid.cli.display import say_written
        from crinoid.cli.folder import check_own, claimed

    with claimed(folder):
        if not force:
            check_own(folder / f"{stem}{form.endings[0]}")
        written = writer_of(form)(scenario, folder, stem)
    say_written([written])
