"""Declaration of a command: its options with their help, and the name of its body."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import KW_ONLY, dataclass
from importlib import import_module
from inspect import Parameter, Signature
from pathlib import Path
from typing import Annotated, Any

import typer

from crinoid.cli.command import complete_key, end, folder_for, load_text, one_line_errors, stop
from crinoid.cli.interruption import Loading
from crinoid.cli.program import Call

FILES = "Folder of the result"  # group of options


@dataclass(frozen=True)
class Option:
    """An option such as ``--count N``, or an argument, which is a word without hyphens."""

    shown: str  # flag and value, as help shows them
    given: Any  # default, or a type where the default is none
    text: str  # help
    default: str | bool = True  # default in words, if it needs any
    _: KW_ONLY
    name: str = ""  # name of the value in the body, if it is not that of the option
    required: bool | None = None  # whether it must be given, as an argument must unless false
    check: Callable[[Any], str] = lambda _: ""
    """Function that returns why a value is refused; empty if it is not."""
    complete: Callable[[str], list[str]] | None = None
    """Completion of a value in the shell; those that begin with a key have one."""
    parser: Callable[[str], Any] | None = None
    read_as: str = ""
    """What the body receives in place of the name of a scenario: `"scenario"` or `"text"`."""
    group: str | None = None  # group in the help

    @property
    def flag(self) -> str:
        """Name in messages."""
        return self.shown.split()[0]

    @property
    def parameter(self) -> Parameter:
        """The parameter of a function, as typer reads it."""
        first, _, value = self.shown.partition(" ")
        named = first.startswith("-")
        kind: Any = self.given
        default: Any = None
        if isinstance(kind, bool | int | float | str):
            kind, default = type(kind), self.given
        elif self.required or (self.required is None and not named):
            default = Parameter.empty
        complete = complete_key if value.startswith("KEY=") else self.complete
        look: dict[str, Any] = {"help": self.text, "show_default": self.default}
        look["autocompletion"] = complete
        declared: Any = (
            typer.Option(
                first, metavar=value or None, parser=self.parser, rich_help_panel=self.group, **look
            )
            if named
            else typer.Argument(metavar=self.shown, **look)
        )
        name = self.name or first.split("/")[0].strip("-").replace("-", "_").lower()
        kind = kind | None if default is None else kind
        hint: Any = Annotated[kind, declared]
        return Parameter(name, Parameter.KEYWORD_ONLY, default=default, annotation=hint)


def must(words: str, fulfilled: Callable[[Any], bool]) -> Callable[[Any], str]:
    """Return the check of a condition; ``words`` begin with `"be"`."""

    def check(value: Any) -> str:
        from crinoid.scenario.errors import got

        return "" if fulfilled(value) else got(value, words)

    return check


def out(folder: str) -> Option:
    """Return the option that names the folder to write to; ``folder`` is shown as its default."""

    def named(name: str) -> Path:
        return Path(name) if name else stop("--out: got an empty name; must be a folder")

    return Option("--out DIR", Path, "Where to write.", folder, parser=named, group=FILES)


def resume(what: str) -> Option:
    """Return the option that continues an interrupted run, sweep or training."""
    text = f"Go on from where an interrupted {what} stopped."
    return Option("--resume", False, text, group=FILES)


class Command:
    """A command, or a program by itself.

    Its ``body`` is ``module:function``, imported at the call: a function of the values by the
    names of their options. It returns what went wrong, if anything, and the exit code where that is
    not the one of a failure.

    The name of a scenario, ``--set`` and ``--out`` are read before: the body receives the scenario,
    or its text, and the ``folder`` to write to.
    """

    def __init__(
        self,
        name: str,
        body: str,
        text: str,
        *options: Option,
        interrupted: str = "interrupted before there was anything to save",
    ) -> None:
        self.name, self.body, self.text, self.options = name, body, text, options
        self.interrupted = interrupted

    def load(self) -> Callable[..., str | tuple[str, int] | None]:
        """Import the body."""
        module, _, function = self.body.partition(":")
        with Loading():
            found: Callable[..., str | tuple[str, int] | None]
            found = getattr(import_module(module), function)
        return found

    def add_to(self, app: typer.Typer, group: str | None = None) -> None:
        """Add it to a program, whose help lists it in a group."""

        def call(**values: Any) -> None:
            with one_line_errors(self.interrupted):
                ended = self.call(values)
                end(*ended) if isinstance(ended, tuple) else end(ended or "")

        parameters = [each.parameter for each in self.options]
        call.__signature__ = Signature(parameters)  # type: ignore[attr-defined]
        call.__annotations__ = {each.name: each.annotation for each in parameters}
        app.command(self.name, cls=Call, help=self.text, rich_help_panel=group)(call)

    def call(self, values: dict[str, Any]) -> str | tuple[str, int] | None:
        """Check the values, read the scenario, and call the body."""
        from crinoid.scenario.errors import refusal

        for each in self.options:
            value = values[each.parameter.name]
            if value is not None and (why := each.check(value)):
                raise refusal(each.flag, why)
        for read_as in filter(None, (each.read_as for each in self.options)):
            name, settings, out = (values.pop(each) for each in ("scenario", "settings", "out"))
            text = load_text(name, settings)
            values[read_as] = text if read_as == "text" else text.scenario
            values["folder"] = folder_for(out, name, f"-{self.name}", settings)
        return self.load()(**values)
