"""Mistakes in a scenario, one line each."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any, TypeVar

__all__ = ["Mistake", "ScenarioError", "counted", "gathered", "join", "one_of", "shown"]

_Read = TypeVar("_Read")


@dataclass(frozen=True)
class Mistake:
    """One thing wrong with a scenario.

    Parameters
    ----------
    key
        Where it is: a dotted key with indexes, as ``--set`` takes it (``flow.0.velocity``).
        Empty where no key is to blame.
    text
        What was got and what is taken.
    instead
        The nearest valid key, if there is one.
    in_space
        The text where the arm is spatial, if it is another.
    """

    key: str
    text: str
    instead: str = ""
    in_space: str = ""

    def under(self, prefix: str) -> Mistake:
        """Return the same mistake seen from the table that holds this one as ``prefix``."""
        instead = join(prefix, self.instead) if self.instead else ""
        return replace(self, key=join(prefix, self.key), instead=instead)

    def told(self, *, in_space: bool) -> Mistake:
        """Return the same mistake with the text for a planar or a spatial arm, and only that."""
        text = self.in_space if in_space and self.in_space else self.text
        return replace(self, text=text, in_space="")

    def __str__(self) -> str:
        line = f"{self.key}: {self.text}" if self.key else self.text
        return f"{line}; did you mean {self.instead}?" if self.instead else line


class ScenarioError(ValueError):
    """A scenario that cannot be used; ``str()`` gives one line per mistake.

    Parameters
    ----------
    mistakes
        What is wrong, one or more; kept as a tuple in ``mistakes``.
    """

    def __init__(self, mistakes: Iterable[Mistake]) -> None:
        self.mistakes = tuple(mistakes)
        super().__init__(self.mistakes)

    @property
    def lines(self) -> list[str]:
        """The mistakes, one line each."""
        return [str(mistake) for mistake in self.mistakes]

    def __str__(self) -> str:
        return "\n".join(self.lines)


def gathered(readers: Mapping[str, Callable[[], _Read]]) -> dict[str, _Read]:
    """Return what each function gives, by the key of a table; or all that is wrong with them."""
    found, mistakes = {}, []
    for key, reader in readers.items():
        try:
            found[key] = reader()
        except ScenarioError as error:
            mistakes += [mistake.under(key) for mistake in error.mistakes]
    if mistakes:
        raise ScenarioError(mistakes)
    return found


def join(*parts: str) -> str:
    """Join parts of a key with dots, leaving out empty ones."""
    return ".".join(part for part in parts if part)


def shown(value: Any) -> str:
    """Return a value as TOML would write it, shortened to fit into a line."""
    if isinstance(value, dict):
        return "a table"
    if isinstance(value, (list, tuple)):
        text = f"[{', '.join(shown(item) for item in value)}]"
    elif isinstance(value, (bool, str)):
        text = json.dumps(value, ensure_ascii=False)
    else:
        text = " ".join(str(value).split())
    return text if len(text) <= 60 else f"{text[:57]}..."


def counted(number: int, one: str, more: str = "") -> str:
    """Return a number with what it counts, such as 1 row and 2 rows."""
    return f"{number} {one if number == 1 else more or f'{one}s'}"


def one_of(values: Iterable[Any], last_word: str = "or") -> str:
    """Return values as TOML would write them, as a list in a sentence."""
    *first, last = (shown(value) for value in values)
    return f"{', '.join(first)} {last_word} {last}" if first else last
