"""What crinoid refuses, and in which words."""

from collections.abc import Callable
from pathlib import Path

import pytest

from crinoid.assembly.prepared import Prepared
from crinoid.scenario import Scenario, ScenarioError


def refused(make: Callable[..., object], *arguments: object) -> ScenarioError:
    with pytest.raises(ScenarioError) as caught:
        make(*arguments)
    return caught.value


def mistake(function: Callable[..., object], *arguments: object, **options: object) -> str:
    """Return the only line of the mistake in a scenario that a function finds."""
    with pytest.raises(ScenarioError) as caught:
        function(*arguments, **options)
    (line,) = caught.value.lines
    return line


def refusal(case: Scenario) -> str:
    """Return the one line with which the files of a scenario are refused."""
    (line,) = refused(Prepared(case).notes).lines
    assert "\n" not in line
    return line


def written_and_answered(path: Path) -> dict[str, list]:
    """Read a file of mistakes: TOML as people write it, and below it, indented, the answer.

    A long answer goes on in the next line. A line ``== TITLE ==`` begins a section, ``#`` a
    comment. Returned are the parameters ``text, answer`` of each section.
    """
    sections, case, text, answer = {}, [], [], []
    for line in [*path.read_text("utf-8").splitlines(), "== end =="]:
        if line.startswith("    "):
            answer.append(line.strip())
            continue
        if answer:
            said = " ".join(answer)
            case.append(pytest.param("\n".join(text), said, id=said.partition(":")[0]))
            text, answer = [], []
        if line.startswith("== "):
            case = sections.setdefault(line.strip("= "), [])
        elif not line.startswith("#"):
            text.append(line)
    return sections
