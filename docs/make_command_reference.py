"""Write the tables of `docs/reference/commands.md` from the commands themselves.

    python docs/make_command_reference.py

Run it after a change to a command or an option: `tests/project/test_docs.py` compares.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import typer

from crinoid.cli.app import app

PAGE = Path(__file__).with_name("reference") / "commands.md"
BEGIN, END = "<!-- commands: begin -->", "<!-- commands: end -->"
MANY = 4
"""Number of commands that a common parameter has at least."""


def commands() -> dict[str, Any]:
    """Return the commands by name, in the order of `crinoid --help`."""
    found = typer.main.get_command(app).commands
    return {name: each for name, each in found.items() if not each.hidden}


def reference() -> str:
    """Return a table of common parameters, and a section for each command."""
    found = commands()
    count = Counter(_row(name, each) for name, command in found.items() for each in shown(command))
    common = [row for row, number in count.items() if number >= MANY]
    sections = (_section(name, each, common) for name, each in found.items())
    return "\n\n".join([f"## Common parameters\n\n{_table(common)}", *sections])


def updated(text: str) -> str:
    """Return a page with its sections renewed."""
    before, rest = text.split(BEGIN)
    _, after = rest.split(END)
    return f"{before}{BEGIN}\n\n{reference()}\n\n{END}{after}"


def shown(command: Any) -> list[Any]:
    """Return the parameters of a command except `--help`."""
    return [each for each in command.params if each.name != "help"]


def _section(name: str, command: Any, common: Sequence[str]) -> str:
    words = " ".join((command.help or "").split())
    arguments = [_metavar(each) for each in command.params if not _is_option(each)]
    usage = " ".join([f"crinoid {name}", *arguments])
    rows = [_row(name, each) for each in shown(command)]
    parts = [f"## `crinoid {name}`\n\n{words}\n\n```\n{usage}\n```"]
    if own := [row for row in rows if row not in common]:
        parts.append(_table(own))
    names = [row.split()[1].strip("`") for row in rows if row in common]
    if options := [f"`{each}`" for each in names if each not in arguments]:
        parts.append(f"[Common](#common-parameters): {', '.join(options)}")
    return "\n\n".join(parts)


def _table(rows: Iterable[str]) -> str:
    return "\n".join(["| | Default | Meaning |", "|---|---|---|", *rows])


def _row(name: str, parameter: Any) -> str:
    metavar = _metavar(parameter)
    if _is_option(parameter):
        names = "/".join([*parameter.opts, *parameter.secondary_opts])
        metavar = names if parameter.is_flag else f"{names} {metavar}"
    default = re.sub(rf"-{name}$", "-COMMAND", _default(parameter))
    cells = (f"`{metavar}`", default, " ".join((parameter.help or "").split()))
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def _default(parameter: Any) -> str:
    if parameter.required:
        return "must be given"
    if isinstance(parameter.show_default, str):
        return parameter.show_default
    given = parameter.default not in (None, False) and parameter.show_default
    return f"`{parameter.default}`" if given else ""


def _metavar(parameter: Any) -> str:
    return parameter.metavar or parameter.name.upper()


def _is_option(parameter: Any) -> bool:
    return parameter.opts[0].startswith("-")


if __name__ == "__main__":
    PAGE.write_text(updated(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
