"""Filming a result: progress while it is drawn, and one line that says where the film is."""

from pathlib import Path

from rich.console import Console

from crinoid.cli.interruption import Interrupted, Interruption
from crinoid.cli.lines import say_notes, say_written
from crinoid.cli.progress import progress_bar
from crinoid.report.film.file import NO_ENCODER, has_encoder
from crinoid.report.film.shot import Shot
from crinoid.report.film.write import film_run


def film_result(
    result: Path, to: Path | None, shot: Shot, *, force: bool, console: Console
) -> None:
    """Film a result."""
    if to is None and not has_encoder():
        say_notes(console, [f"writes a GIF: {NO_ENCODER}"])
    with Interruption() as interruption, progress_bar(console) as bar:
        task = bar.task_ids[0]
        bar.reset(task, total=None, description="reading", reached="")

        def report(done: int, count: int) -> None:
            if interruption.asked:  # something on the way, such as a destructor, has lost it
                raise Interrupted
            text = f"{done} of {count} frames"
            bar.update(task, completed=done, total=count, description="drawing", reached=text)

        path, notes = film_run(result, to, shot, report, force=force)
    say_notes(console, notes)
    say_written(console, [path])
