"""The program: help without types of flags, and one line for a mistake in its words."""

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from typer.core import TyperCommand, TyperGroup
from typer.exceptions import TyperException

from crinoid.cli.command import stop


class _Plain:
    def get_params(self, ctx: Any) -> Any:
        """Return options and arguments; help shows a flag as its name only."""
        found = super().get_params(ctx)
        for each in found:
            if getattr(each, "is_flag", False):
                each.metavar = ""
        return found


class Call(_Plain, TyperCommand):
    """A command of the program."""


class Program(_Plain, TyperGroup):
    """A program of several commands."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Read the options of the program itself."""
        ctx.obj = list(args)
        if not args:
            return super().parse_args(ctx, args)
        with _in_one_line(ctx.obj):
            return super().parse_args(ctx, args)

    def invoke(self, ctx: Any) -> Any:
        """Read the words of a command, and call it."""
        with _in_one_line(ctx.obj):
            return super().invoke(ctx)


_VALUE = r"Invalid value for '(.*?)': "
_SAID = (
    (r"No such option: (\S+).*", r"\1: no such option"),
    (r"No such command '(.*?)'.*", r"\1: no such command"),
    (r"Got unexpected extra argument\(s\) \((.*)\)", r"\1: unexpected word"),
    (rf"{_VALUE}Input should be a valid integer.*", r"\1: got {given}; must be a whole number"),
    (rf"{_VALUE}Input should be a valid (\w+).*", r"\1: got {given}; must be a \2"),
    (rf"{_VALUE}(.*)", r"\1: \2"),
    (r"Missing (?:option|argument) '(.*)'", r"\1: missing"),
    (r"Option '(.*)' (.*)", r"\1: \2"),
)
"""Messages of typer, and those of crinoid."""
_NEAR = re.compile(r"(?:Did you mean|Possible options:) (.*?)[?)]*$")


@contextmanager
def _in_one_line(words: Sequence[str]) -> Iterator[None]:
    for flag, given, value in zip(words, words[1:], words[2:], strict=False):
        pair = flag in ("--set", "--vary", "--over", "--draw") and not value.startswith("-")
        if pair and not re.search("=|^-", given):
            stop(f'{flag}: got "{given}"; must be KEY=VALUE. Write {flag} {given}={value}.')
    try:
        yield
    except TyperException as error:
        message = text = " ".join(error.format_message().split()).removesuffix(".")
        for pattern, ours in _SAID:
            text = re.sub(f"^{pattern}$", ours, text)
        wrong, _, why = text.partition(": ")
        value = "VALUE"
        for word, after in zip(words, [*words[1:], value], strict=True):
            if wrong == word.split("=")[0]:
                value = word.partition("=")[2] or after
        near, hint = "".join(f"Did you mean {each}?" for each in _NEAR.findall(message)), ""
        if why.startswith(("no such", "unexpected")):
            context: Any = error.ctx  # type: ignore[attr-defined]
            settable = any(each.name == "settings" for each in context.command.params)
            hint = _hint(wrong, words[0], value if settable else "") or near
            if "--resume" in words and Path(wrong).is_dir():
                hint = f"Write --out {wrong}."
        see = "--help" if wrong == words[0] else f"{words[0]} --help"
        text = text.replace("{given}", f'"{value}"')
        stop(f"{text}. {hint or f'See crinoid {see}.'}")


def _hint(unknown: str, command: str, value: str) -> str:
    """Return how to write a scenario or a key instead, or which commands have an option."""
    from crinoid.cli.commands import COMMANDS
    from crinoid.scenario import builtin_names  # slow to load
    from crinoid.scenario.kinds import all_keys
    from crinoid.scenario.scenario import scenario_schema

    if unknown == command:
        named = unknown.endswith(".toml") or unknown in builtin_names()
        return f"Write crinoid run {unknown}." if named else ""
    if not unknown.startswith("--"):
        return f"Write --set {unknown}." if value and "=" in unknown else ""
    name = unknown[2:].replace("-", "_")
    every = all_keys(scenario_schema()) if value else ()
    keys = [key for key in every if name in (key, key.split(".")[-1])]
    keys.sort(key=lambda key: ".0." in key)  # rather of a table than of one in a list
    if keys:
        return f"Write --set {keys[0]}={value}."
    owner = next((each.name for each in COMMANDS if unknown in (o.flag for o in each.options)), "")
    return f"It is an option of crinoid {owner}." if owner else ""
