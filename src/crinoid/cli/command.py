"""What all commands share: the console, messages, exit codes, scenario and folder."""

from __future__ import annotations

import errno
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import typer
from rich.console import Console
from rich.text import Text

from crinoid.cli.interruption import INTERRUPTED, Interrupted, Loading
from crinoid.foundation.status import Status

if TYPE_CHECKING:
    from crinoid.scenario import ScenarioText

MISSED, BAD_INPUT, FAILED = 1, 2, 3  # exit codes
_FOUND = ("optimised", "tuned", "identified")  # names of the scenario files that crinoid writes
_ESCAPED = {code: f"\\x{code:02x}" for code in (*range(0x20), *range(0x7F, 0xA0)) if code != 0x0A}
"""Control characters but the new line, and their printed replacements."""


class Terminal(Console):
    """A console that prints text literally: markup, emoji and control characters do nothing."""

    def __init__(self, **options: Any) -> None:
        super().__init__(highlight=False, markup=False, emoji=False, **options)

    def render_str(self, text: str, **options: Any) -> Text:
        """Render text."""
        return super().render_str(text.translate(_ESCAPED), **options)


console = Terminal()
errors = Terminal(stderr=True, soft_wrap=True)


def stop(*lines: str) -> NoReturn:
    """Print the mistakes of the input, and end."""
    for line in lines:
        errors.print(f"crinoid: {' '.join(line.splitlines())}")
    raise typer.Exit(BAD_INPUT)


def end(trouble: str, code: int = FAILED) -> None:
    """End with what went wrong, if anything did; ``code`` is the exit code of a failure."""
    if trouble:
        errors.print(f"crinoid: {trouble}")
        raise typer.Exit(INTERRUPTED if Status.of(trouble) is Status.INTERRUPTED else code)


@contextmanager
def one_line_errors(interrupted: str) -> Iterator[None]:
    """Print errors that a user can mend as one line each, without a traceback."""
    with Loading():
        from crinoid.results.report_error import ReportError
        from crinoid.scenario.errors import ScenarioError

    try:
        yield
    except ScenarioError as error:
        stop(*error.lines)
    except OSError as error:
        if error.errno == errno.EPIPE:  # the reader of the output, such as `head`, has gone
            raise
        stop(f"{error.filename or 'file'}: {error.strerror or error}")
    except UnicodeEncodeError as error:
        near = error.object[max(0, error.start - 40) : error.end + 20]
        must = f"must be text in {error.encoding}, as netCDF needs it"
        stop(f"{near}: {must}. Choose another name, or set PYTHONUTF8=1.")
    except ReportError as error:
        stop(str(error))
    except (Interrupted, KeyboardInterrupt):
        errors.print(f"crinoid: {interrupted}")
        raise typer.Exit(INTERRUPTED) from None


def complete_name(start: str) -> list[str]:
    """Complete the name of a built-in scenario."""
    from crinoid.scenario import builtin_names

    return [name for name in builtin_names() if name.startswith(start)]


def complete_key(start: str) -> list[str]:
    """Complete a key of a scenario, up to its equals sign."""
    from crinoid.scenario.kinds import all_keys
    from crinoid.scenario.scenario import scenario_schema

    found = all_keys(scenario_schema())
    return [f"{key}=" for key, table in found.items() if key.startswith(start) and not table]


def load_text(name: str, settings: list[str] | None) -> ScenarioText:
    """Load a scenario by its file or name, with some keys changed, and its text."""
    with Loading():
        from crinoid.scenario import ScenarioText, builtin_names

    if name not in builtin_names() and Path(name, "result.nc").is_file():
        stop(f"{name}: is the folder of a result; must be a scenario. Name a folder by --out.")
    return ScenarioText(name, settings or ())


def folder_for(
    out: Path | None, name: str, ending: str = "", settings: Sequence[str] | None = None
) -> Path:
    """Return the folder to write to, by default named after the scenario and its changed keys."""
    stem = Path(name).stem
    if stem in _FOUND:  # as other studies call theirs too
        stem = f"{Path(name).resolve().parent.name}-{stem}"
    folder = out if out is not None else Path("results", f"{stem}{ending}")
    if out is None and settings:
        from crinoid.scenario.document import name_of_changes

        folder = folder.with_name(f"{folder.name},{name_of_changes(settings)}")
    if folder.exists() and not folder.is_dir():
        stop(f"--out: {folder} is a file; must be a folder")
    str(folder.resolve()).encode(sys.getfilesystemencoding())  # as netCDF does after the run
    return folder
