"""Mistakes in a scenario, one line each."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any, TypeVar

from pydantic import BaseModel

_Read = TypeVar("_Read")


@dataclass(frozen=True)
class Mistake:
    """One mistake in a scenario.

    Parameters
    ----------
    key
        Dotted key with indexes, in the form of ``--set`` (``flow.0.velocity``). Empty where no
        key is to blame.
    text
        The value, the right one and the remedy, as `got` writes them.
    instead
        The nearest valid key, if there is one.
    in_space
        The text for a spatial arm, if it differs.
    """

    key: str
    text: str
    instead: str = ""
    in_space: str = ""

    def under(self, prefix: str) -> Mistake:
        """Return the same mistake seen from the table that contains this one as ``prefix``."""
        instead = join(prefix, self.instead) if self.instead else ""
        return replace(self, key=join(prefix, self.key), instead=instead)

    def in_dimension(self, dimension: int) -> Mistake:
        """Return the same mistake in the words for a planar or a spatial arm."""
        text = self.in_space if dimension == 3 and self.in_space else self.text
        return replace(self, text=text, in_space="")

    def __str__(self) -> str:
        line = f"{self.key}: {self.text}" if self.key else self.text
        return f"{line}; did you mean {self.instead}?" if self.instead else line


class ScenarioError(ValueError):
    """A scenario that cannot be used; ``str()`` gives one line per mistake.

    Parameters
    ----------
    mistakes : iterable of Mistake
        One or more mistakes, also an attribute.

    Examples
    --------
    >>> try:
    ...     crinoid.Scenario(arm={"length": -1.0})
    ... except crinoid.ScenarioError as error:
    ...     print(error)
    arm.length: got -1.0; must be a number above 0 (m)
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


@contextmanager
def mistakes_at(key: str, where: str) -> Iterator[None]:
    """Raise mistakes again at another key, each after the words of where it is."""
    try:
        yield
    except ScenarioError as error:
        mistakes = [Mistake(key, f"{where}{mistake}") for mistake in error.mistakes]
        raise ScenarioError(mistakes) from error


def gathered(readers: Mapping[str, Callable[[], _Read]]) -> dict[str, _Read]:
    """Return the result of each function by the key of its table; raise all mistakes together."""
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


def percent(share: float) -> str:
    """Return a share in percent, where it is not far above 1."""
    return f"{share:.0%}" if share < 10 else "over 1000%"


def shown(value: Any) -> str:
    """Return a value in the form of TOML, shortened to fit into a line."""
    if isinstance(value, (dict, BaseModel)):
        return "a table"
    if isinstance(value, (list, tuple)):
        text = f"[{', '.join(shown(item) for item in value)}]"
    elif isinstance(value, (bool, str)):
        text = json.dumps(value, ensure_ascii=False)
    else:
        text = " ".join(str(value).split())
    return text if len(text) <= 60 else f"{text[:57]}..."


def got(value: Any, must: str, hint: str = "") -> str:
    """Return the text of a mistake: the value, the right one, and the remedy.

    Parameters
    ----------
    value
        The wrong value, shown as in TOML.
    must
        The right value, from its verb on: ``be at least 4``.
    hint
        The remedy, a sentence in the imperative.
    """
    return mistake_text(f"got {shown(value)}", must, hint)


def missing(must: str, hint: str = "") -> str:
    """Return the text of a mistake for a key without a value; see `got`."""
    return mistake_text("missing", must, hint)


def mistake_text(subject: str, must: str, hint: str = "") -> str:
    """Return the text of a mistake whose subject is not only a value; see `got`."""
    text = f"{subject}; must {must}"
    return f"{text}. {hint}" if hint else text


def refusal(key: str, subject: str, must: str = "", hint: str = "") -> ScenarioError:
    """Return the mistake at a key: a whole text, or its subject and its condition."""
    return ScenarioError([Mistake(key, mistake_text(subject, must, hint) if must else subject)])


def counted(number: int, one: str, more: str = "") -> str:
    """Return a number with its noun, such as 1 row and 2 rows."""
    return f"{number} {one if number == 1 else more or f'{one}s'}"


def one_of(values: Iterable[Any], last_word: str = "or") -> str:
    """Return values in the form of TOML, as a list in a sentence."""
    *first, last = (shown(value) for value in values)
    return f"{', '.join(first)} {last_word} {last}" if first else last
