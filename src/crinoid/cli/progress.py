"""The progress bar of a run."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

if TYPE_CHECKING:  # a film has a bar too, and no need of JAX
    from crinoid.simulation import Progress as Reached


@contextmanager
def progress_bar(console: Console) -> Iterator[Progress]:
    """Show a bar while something lasts."""
    with Progress(
        TextColumn("{task.description:>14}"),
        BarColumn(),
        TextColumn("{task.fields[reached]}"),
        TimeRemainingColumn(),
        console=console,
        transient=True,
    ) as bar:
        bar.add_task("compiling", total=None, reached="")
        yield bar


def reporter(bar: Progress, prefix: str) -> Callable[[Reached], None]:
    """Make the callback that moves the bar: simulated time, speed and time left."""
    task = bar.task_ids[0]
    label = ""

    def report(reached: Reached) -> None:
        nonlocal label
        if reached.label != label:
            label = reached.label
            bar.reset(task, total=reached.duration, description=f"{prefix}{label}")
        speed = reached.time / reached.elapsed
        text = f"{reached.time:.1f} of {reached.duration:g} s, {speed:.0f} x real time"
        bar.update(task, completed=reached.time, reached=text)

    return report
