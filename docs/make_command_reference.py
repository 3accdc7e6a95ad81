"""Write the tables of `docs/reference/commands.md` from the commands themselves.

    python docs/make_command_reference.py

Run it after a change to a command or an option: `tests/project/test_docs.py` compares.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import typer

from crinoid.cli.app import app

PAGE = Path(__file__).with_name("reference") / "commands.md"
BEGIN, END = "<!-- commands: begin -->", "<!-- commands: end -->"


def commands() -> dict[str, Any]:
    """Return the commands by name, in the order of `crinoid --help`."""
    found = typer.main.get_command(app).commands
    return {name: each for name, each in found.items() if not each.hidden}


def reference() -> str:
    """Return a section for each command."""
    return "\n\n".join(_section(name, each) for name, each in commands().items())


def updated(text: str) -> str:
    """Return a page with its sections renewed."""
    before, rest = text.split(BEGIN)
    _, after = rest.split(END)
    return f"{before}{BEGIN}\n\n{reference()}\n\n{END}{after}"


def _section(name: str, command: Any) -> str:
    words = " ".join((command.help or "").split())
    arguments = [_metavar(each) for each in command.params if not _is_option(each)]
    usage = " ".join([f"crinoid {name}", *arguments])
    rows = [_row(each) for each in command.params if each.name != "help"]
    table = "\n".join(["| | Default | Meaning |", "|---|---|---|", *rows])
    section = f"## `crinoid {name}`\n\n{words}\n\n```\n{usage}\n```"
    return f"{section}\n\n{table}" if rows else section


def _row(parameter: Any) -> str:
    shown = _metavar(parameter)
    if _is_option(parameter):
        names = "/".join([*parameter.opts, *parameter.secondary_opts])
        shown = names if parameter.is_flag else f"{names} {shown}"
    cells = (f"`{shown}`", _default(parameter), " ".join((parameter.help or "").split()))
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
