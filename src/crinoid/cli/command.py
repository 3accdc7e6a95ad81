"""How commands begin and end: what they are told, what they tell, and exit codes."""

from __future__ import annotations

import errno
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from crinoid.cli.interruption import INTERRUPTED, Interrupted, Loading
from crinoid.cli.options import errors, stop
from crinoid.status import Status

if TYPE_CHECKING:
    from crinoid.scenario import Scenario

FAILED = 3


@contextmanager
def told(interrupted: str = "interrupted before there was anything to save") -> Iterator[None]:
    """Turn what a user can mend into one line each, and no traceback."""
    with Loading():
        from crinoid.scenario import ScenarioError

    try:
        yield
    except (ScenarioError, OSError) as error:
        if isinstance(error, ScenarioError):
            stop(*error.lines)
        if error.errno == errno.EPIPE:  # who read what is shown, such as `head`, has seen enough
            raise
        stop(f"{error.filename or 'file'}: {error.strerror or error}")
    except (Interrupted, KeyboardInterrupt):
        errors.print(f"crinoid: {interrupted}")
        raise typer.Exit(INTERRUPTED) from None


def load_scenario(name: str, settings: list[str] | None) -> Scenario:
    """Load a scenario by its file or name, with some keys changed."""
    with Loading():
        from crinoid.scenario import load

    return load(name, settings or ())


def folder_for(out: Path | None, name: str, ending: str = "") -> Path:
    """Return the folder to write to, after the scenario's name where none is given."""
    folder = out if out is not None else Path("results") / f"{Path(name).stem}{ending}"
    if folder.exists() and not folder.is_dir():
        stop(f"--out: {folder} is a file, takes a folder")
    return folder


def end(trouble: str) -> None:
    """End with what went wrong, if anything did."""
    if trouble:
        errors.print(f"crinoid: {trouble}")
        raise typer.Exit(INTERRUPTED if Status.of(trouble) is Status.INTERRUPTED else FAILED)
