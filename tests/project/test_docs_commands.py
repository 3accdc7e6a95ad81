"""The commands of the documentation: options and keys exist, scenarios can be read."""

import re
import shlex
from functools import cache

import pytest
import typer

import crinoid
from benchmarks.command import app as benchmarks
from crinoid.cli.app import app
from crinoid.scenario import builtin_names
from helpers.paths import ROOT
from validation.cases import all_cases
from validation.command import app as validation
from validation.command import chosen

PAGES = sorted(
    page
    for page in [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]
    if "_build" not in page.parts
)

OMITTED = re.compile(r"\.\.\.|[A-Z]{3,}|…|\[(?!\[|-?\d|\"|')")
"""Signs of a command that stands for others: SCENARIO, [OPTIONS], and so on."""
UNFINISHED = ("MissingParameter", "BadOptionUsage")
"""Mistakes of a command that stands for others, or that only names an option."""


OTHERS = {
    "validation": typer.main.get_command(validation),
    "benchmarks": typer.main.get_command(benchmarks),
}
"""Programs of the repository."""
PROGRAM = r"(?:crinoid|python -m (?:validation|benchmarks))"
COMMAND = re.compile(rf"^(?:\$ )?((?:[^\n]*&& )?(?:\S*/)?{PROGRAM} [^\n]*)(?!\ncrinoid: )$", re.M)
"""A line of a block with a command, unless the next one is the line of a mistake."""


def commands(text):
    """Yield the arguments of each command of a page, and whether it may be unfinished."""
    for language, block in re.findall(r"^```([^\n]*)\n(.*?)^```", text, re.M | re.S):
        if language in ("", "bash", "console") or "%%bash" in block:
            for line in COMMAND.findall(block.replace("\\\n", " ")):
                yield from ((words, bool(OMITTED.search(line))) for words in parts(line))
    prose = re.sub(r"^```.*?^```", "", text, flags=re.M | re.S)
    for line in re.findall(rf"`({PROGRAM} \w[^`]*)`", prose):
        if not OMITTED.search(line):
            yield from ((words, True) for words in parts(line))


def parts(line):
    """Yield the arguments of each command of a line, up to a comment, a pipe or a redirection."""
    words = shlex.split(line, comments=True)
    ends = [i for i, word in enumerate(words) if word in ("&&", "|", "||", ">", ";")]
    for start, end in zip([-1, *ends], [*ends, len(words)], strict=True):
        program, *arguments = words[start + 1 : end]
        if program.endswith("crinoid"):
            yield arguments
        elif program == "python" and arguments[:1] == ["-m"]:
            yield arguments[1:]


@cache
def group():
    return typer.main.get_command(app)


@cache
def loaded(name, settings):
    return crinoid.load(name, list(settings))


def check(words):
    """Parse a command as the command line does; read its scenario, if it is a built-in one."""
    if words == ["--version"] or words[0].startswith("--"):
        return
    command = OTHERS.get(words[0]) or group().commands[words[0]]
    assert not command.hidden
    context = command.make_context(words[0], list(words[1:]))
    chosen(all_cases(), context.params.get("cases") or (), every=False, peers=False)
    name = context.params.get("scenario")
    if name in builtin_names():
        loaded(name, tuple(context.params.get("settings") or ()))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_commands_of_a_page_can_be_parsed(page):
    wrong = []
    for words, unfinished in commands(page.read_text("utf-8")):
        try:
            check(words)
        except Exception as error:
            kind = type(error).__name__
            if not (unfinished and kind in UNFINISHED):
                wrong.append(f"crinoid {shlex.join(words)}: {kind}: {error}")
    assert not wrong, "\n".join(wrong)


def test_the_readme_lists_every_command():
    text = (ROOT / "README.md").read_text("utf-8")
    shown = {name for name, each in group().commands.items() if not each.hidden}
    assert shown <= set(re.findall(r"^\| `crinoid (\w+)", text, re.M))
