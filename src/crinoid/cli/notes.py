"""Notes under a table."""

import re
from collections import Counter
from collections.abc import Collection, Mapping, Sequence

from rich.console import Console

from crinoid.assembly.prepared import Prepared
from crinoid.cli.lines import say_notes
from crinoid.plausibility import doubts

_MOST = 6
_NUMBER = re.compile(r"\d[\d.]*(?:e[+-]?\d+)?")


def say_doubts(console: Console, prepared: Prepared, tables: Collection[str] = ()) -> list[str]:
    """Show what is odd about a scenario before it is run; return it."""
    found = doubts(prepared, tables)
    say_notes(console, found)
    return found


def notes_of_cases(told: Mapping[str, Sequence[str]]) -> list[str]:
    """Return the notes of a study, each once with the cases that it holds for.

    Notes that differ in their numbers only are one; not all are returned where there are many.

    Parameters
    ----------
    told
        The notes by case, in order.
    """
    alike: dict[tuple[str, int], list[tuple[int, str]]] = {}
    for number, notes in enumerate(told.values()):
        count = Counter[str]()  # two notes of one case stay two
        for note in notes:
            words = _NUMBER.sub("#", note)
            alike.setdefault((words, count[words]), []).append((number, note))
            count[words] += 1
    names, found = list(told), []
    for cases in alike.values():
        numbers = [number for number, _ in cases]
        where = _ranges(names, numbers)
        if len({note for _, note in cases}) > 1:
            where += f" (numbers are those of {names[numbers[0]]})"
        found.append(f"{where}: {cases[0][1]}")
    left = len(found) - _MOST
    return found if left <= 0 else [*found[:_MOST], f"{left} more in the cases' results"]


def _ranges(names: list[str], numbers: list[int]) -> str:
    """Name cases, those that follow each other by the first and the last."""
    runs: list[list[int]] = []
    for number in numbers:
        if runs and number == runs[-1][-1] + 1:
            runs[-1].append(number)
        else:
            runs.append([number])
    parts = []
    for run in runs:
        if len(run) > 2:
            parts.append(f"{names[run[0]]} to {names[run[-1]]}")
        else:
            parts += [names[number] for number in run]
    return ", ".join(parts)
