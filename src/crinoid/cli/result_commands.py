"""The commands on a result: report, export and film."""

from pathlib import Path
from typing import Any

from crinoid.cli.command import stop
from crinoid.cli.export import export_result, export_scenario
from crinoid.cli.interruption import Interrupted, Interruption, Loading
from crinoid.view.film.settings import CameraSettings, ending_of, size_of
from crinoid.view.refusals import require_figures, require_path, width_of


def report(result: Path, file_format: str, width: str | None, out: Path | None) -> None:
    """Draw the figures of a result, and write its page."""
    require_figures(file_format)
    if width is not None:
        width_of(width)
    if out is not None and out.is_file():
        stop(f"--out: {out} is a file; must be a folder")
    require_path(result)
    with Loading():
        from crinoid.cli.display import say_written
        from crinoid.view.figures import write_report

    say_written(write_report(result, out, file_format=file_format, width=width))


def export(
    result: str, to: str, settings: list[str] | None, out: Path | None, *, force: bool, **table: Any
) -> None:
    """Export a result, a policy or a scenario; ``table`` is of results."""
    if to == "fmu":
        unused = {f"--{name}": value for name, value in table.items()}
        export_scenario(result, settings, out, unused, force=force)
        return
    if settings:
        stop(f"--set: needs --to fmu. Leave it out with --to {to}.")
    export_result(Path(result), to, out, **table, force=force)


def film(result: Path, to: Path | None, size: str | None, *, force: bool, **others: Any) -> None:
    """Film a result; ``others`` are settings of the camera."""
    camera = CameraSettings(size=None if size is None else size_of(size), **others)
    if to is not None:
        ending_of(to)
    require_path(result)
    with Loading():
        from crinoid.cli.display import progress_bar, say_notes, say_written
        from crinoid.view.film.encode import NO_ENCODER, has_encoder
        from crinoid.view.film.write import film_run

    if to is None and not has_encoder():
        say_notes([f"writes a GIF: {NO_ENCODER}"])
    with Interruption() as interruption, progress_bar() as bar:
        task = bar.task_ids[0]
        bar.reset(task, total=None, description="reading", reached="")

        def progress(done: int, count: int) -> None:
            if interruption.asked:  # a destructor or the like has lost the exception
                raise Interrupted
            text = f"{done} of {count} frames"
            bar.update(task, completed=done, total=count, description="drawing", reached=text)

        path, notes = film_run(result, to, camera, progress, force=force)
    say_notes(notes)
    say_written([path])
