"""A command declared as rows: its options with their help, and the name of its body."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from inspect import Parameter, Signature
from pathlib import Path
from typing import Annotated, Any

import typer

from crinoid.cli.command import (
    complete_key,
    end,
    folder_for,
    load_text,
    one_line_errors,
    stop,
)
from crinoid.cli.interruption import Loading

Check = Callable[[Any], str]
"""Function that returns why a value is refused; empty if it is not."""


@dataclass(frozen=True)
class Row:
    """An argument or an option."""

    shown: str
    """Name in messages, such as ``--count``."""
    parameter: Parameter
    """Name of its value in the body, its type and default."""
    check: Check = lambda _: ""
    read_as: str = ""
    """What the body receives in place of the name of a scenario: `"scenario"` or `"text"`."""


def option(
    flag: str,
    given: Any,
    text: str,
    shown: str | bool = True,
    *,
    name: str = "",
    required: bool = False,
    check: Check = lambda _: "",
    **more: Any,
) -> Row:
    """Return an option: its flag and value as in ``--count N``, its default, and its help.

    ``given`` is the default, or without one the type. ``shown`` is the default in words, ``name``
    that of the value in the body, if it is not the flag's; ``more`` is for `typer.Option`.
    """
    flag, _, value = flag.partition(" ")
    if value.startswith("KEY="):
        more["autocompletion"] = complete_key
    look = typer.Option(flag, metavar=value or None, help=text, show_default=shown, **more)
    name = name or flag.split("/")[0].strip("-").replace("-", "_")
    return Row(flag, _parameter(name, given, required, look), check)


def argument(
    metavar: str,
    given: Any,
    text: str,
    shown: str | bool = True,
    *,
    name: str = "",
    required: bool = True,
    check: Check = lambda _: "",
    **more: Any,
) -> Row:
    """Return an argument, as `option` returns an option; ``more`` is for `typer.Argument`."""
    look = typer.Argument(metavar=metavar, help=text, show_default=shown, **more)
    return Row(metavar, _parameter(name or metavar.lower(), given, required, look), check)


def _parameter(name: str, given: Any, required: bool, look: Any) -> Parameter:
    kind, default = given, None
    if isinstance(given, bool | int | float | str):
        kind, default = type(given), given
    elif required:
        default = Parameter.empty
    hint = Annotated[kind | None if default is None else kind, look]
    return Parameter(name, Parameter.KEYWORD_ONLY, default=default, annotation=hint)


def must(words: str, fulfilled: Callable[[Any], bool]) -> Check:
    """Return the check of a condition; ``words`` begin with `"be"`."""

    def check(value: Any) -> str:
        from crinoid.scenario.errors import got

        return "" if fulfilled(value) else got(value, words)

    return check


def out(folder: str) -> Row:
    """Return the option that names the folder to write to; ``folder`` is shown as its default."""

    def named(name: str) -> Path:
        return Path(name) if name else stop("--out: got an empty name; must be a folder")

    return option("--out DIR", Path, "Where to write.", folder, parser=named)


def resume(what: str) -> Row:
    """Return the option that continues an interrupted run, sweep or training."""
    return option("--resume", False, f"Go on from where an interrupted {what} stopped.")


class Command:
    """A command, or a program by itself.

    Its ``body`` is ``module:function``, imported at the call: a function of the values by the
    names of their rows. It returns what went wrong, if anything, and the exit code where that is
    not the one of a failure.

    The name of a scenario, ``--set`` and ``--out`` are read before: the body receives the scenario,
    or its text, and the ``folder`` to write to.
    """

    def __init__(
        self,
        name: str,
        body: str,
        text: str,
        *rows: Row,
        interrupted: str = "interrupted before there was anything to save",
    ) -> None:
        self.name, self.body, self.text, self.rows = name, body, text, rows
        self.interrupted = interrupted

    def load(self) -> Callable[..., str | tuple[str, int] | None]:
        """Import the body."""
        module, _, function = self.body.partition(":")
        with Loading():
            found: Callable[..., str | tuple[str, int] | None]
            found = getattr(import_module(module), function)
        return found

    def add_to(self, app: typer.Typer) -> None:
        """Add it to a program."""

        def call(**values: Any) -> None:
            with one_line_errors(self.interrupted):
                ended = self.call(values)
                end(*ended) if isinstance(ended, tuple) else end(ended or "")

        parameters = [row.parameter for row in self.rows]
        call.__signature__ = Signature(parameters)  # type: ignore[attr-defined]
        call.__annotations__ = {each.name: each.annotation for each in parameters}
        app.command(self.name, help=self.text)(call)

    def call(self, values: dict[str, Any]) -> str | tuple[str, int] | None:
        """Check the values, read the scenario, and call the body."""
        from crinoid.scenario.errors import refusal

        for row in self.rows:
            value = values[row.parameter.name]
            if value is not None and (why := row.check(value)):
                raise refusal(row.shown, why)
        if read_as := self.rows[0].read_as if self.rows else "":
            name, settings, out = (values.pop(each) for each in ("scenario", "settings", "out"))
            text = load_text(name, settings)
            values[read_as] = text if read_as == "text" else text.scenario
            values["folder"] = folder_for(out, name, f"-{self.name}", settings)
        return self.load()(**values)
