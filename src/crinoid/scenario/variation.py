"""Values that vary from case to case, and every combination of them."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from crinoid.scenario.document import value_of
from crinoid.scenario.errors import Mistake, ScenarioError, shown

__all__ = ["Span", "combination", "read_variation"]

_TAKES = "takes FROM:TO:COUNT, FROM:TO:COUNT:log or values with commas between them"
_LOG = "log"


@dataclass(frozen=True)
class Span:
    """Numbers from one to another, both ends included.

    Parameters
    ----------
    first, last
        Ends.
    count
        Number of values; None where they are sampled.
    log
        Whether equal steps are equal ratios.
    """

    first: int | float
    last: int | float
    count: int | None = None
    log: bool = False

    def at(self, part: float) -> float:
        """Return the number a part of the way along, 0 at the first end and 1 at the last."""
        if self.log:
            size = abs(self.first) ** (1 - part) * abs(self.last) ** part
            return math.copysign(size, self.first)
        return self.first * (1 - part) + self.last * part

    def values(self) -> list[int | float]:
        """Return its ``count`` numbers; integers where its ends are and all come out as such."""
        assert self.count is not None
        steps = self.count - 1
        whole = isinstance(self.first, int) and isinstance(self.last, int) and not self.log
        if whole and (self.last - self.first) % steps == 0:
            stride = int((self.last - self.first) // steps)
            return [self.first + index * stride for index in range(self.count)]
        return [self.at(index / steps) for index in range(self.count)]

    def __str__(self) -> str:
        count = [] if self.count is None else [self.count]
        return ":".join(map(str, (self.first, self.last, *count, *([_LOG] if self.log else []))))


def combination(choices: Mapping[str, Sequence[Any]], number: int) -> dict[str, Any]:
    """Return one of the combinations of choices, each by its key; the last key changes fastest.

    Parameters
    ----------
    choices
        One value or more for each key.
    number
        Which combination, from 0 to the product of their counts less 1.
    """
    found = {}
    for key, values in reversed(list(choices.items())):
        number, place = divmod(number, len(values))
        found[key] = values[place]
    return dict(reversed(found.items()))


def read_variation(text: str) -> tuple[str, Span | list[Any]]:
    """Read ``KEY=FROM:TO:COUNT``, ``KEY=FROM:TO`` or ``KEY=A,B``, as ``--vary`` takes them.

    ``:log`` behind a range makes equal steps equal ratios. A single value is TOML, and words need
    no quotes.

    Returns
    -------
    key
        The dotted key.
    values
        What it takes.
    """
    key, equals, values = (part.strip() for part in text.partition("="))
    if not equals or not key:
        takes = "takes KEY=FROM:TO:COUNT or KEY=A,B, such as arm.length=0.3:0.6:4"
        raise ScenarioError([Mistake("--vary", f"got {shown(text)}, {takes}")])
    if key.split(".")[0].strip("\"' ") == "vary":
        raise ScenarioError([Mistake("--vary", f"got {shown(text)}, takes a key that can vary")])
    parts = [part.strip() for part in values.split(":")]
    if len(parts) > 1 and isinstance(value_of(parts[0]), (int, float)):
        return key, _span(text, parts)
    found = _split(values)
    if not all(found):
        raise ScenarioError([Mistake("--vary", f"got {shown(text)} with no value, {_TAKES}")])
    return key, [value_of(each) for each in found]


def _span(text: str, parts: list[str]) -> Span:
    def refuse(reason: str) -> ScenarioError:
        return ScenarioError([Mistake("--vary", f"got {shown(text)}, {reason}")])

    log = parts[-1] == _LOG
    numbers = [value_of(part) for part in (parts[:-1] if log else parts)]
    if len(numbers) not in (2, 3):
        raise refuse(_TAKES)
    first, last = numbers[:2]
    for end in (first, last):
        if isinstance(end, bool) or not isinstance(end, (int, float)) or not math.isfinite(end):
            raise refuse(f"takes a finite number at each end, not {shown(end)}")
    if first == last:
        raise refuse("takes two different ends")
    if log and not first * last > 0:
        raise refuse("takes two ends of one sign, neither of them 0, with log")
    count = numbers[2] if len(numbers) == 3 else None
    if count is not None and (type(count) is not int or count < 2):
        raise refuse(f"takes a count of 2 or more, not {shown(count)}")
    return Span(first, last, count, log)


def _split(text: str) -> list[str]:
    """Split at the commas that are not within brackets or quotes."""
    parts, depth, quote = [""], 0, ""
    for letter in text:
        if quote:
            quote = "" if letter == quote else quote
        elif letter in "\"'":
            quote = letter
        elif letter in "[{":
            depth += 1
        elif letter in "]}":
            depth -= 1
        elif letter == "," and depth == 0:
            parts.append("")
            continue
        parts[-1] += letter
    return [part.strip() for part in parts]
