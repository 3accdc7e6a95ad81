"""Lines under what a command did: notes, and the files that it wrote."""

from collections.abc import Iterable
from pathlib import Path

from rich.console import Console


def say_notes(console: Console, notes: Iterable[str]) -> None:
    """Show notes, a paragraph each."""
    for note in notes:
        console.print(f"note: {note}", soft_wrap=True)


def say_written(console: Console, paths: list[Path]) -> None:
    """Name files that were written."""
    for path in paths:
        console.print(f"wrote {path}", soft_wrap=True)
