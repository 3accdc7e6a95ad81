"""Variations: lists and ranges of values, and their combinations."""

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import BeforeValidator, Field

from crinoid.scenario.document import plain, value_of
from crinoid.scenario.errors import ScenarioError, got, refusal, shown
from crinoid.scenario.quantity import Quantity

_FORMS = "be FROM:TO:COUNT, FROM:TO:COUNT:log or values with commas between them"
_LOG = "log"
_TWO_ENDS = re.compile(r"([\d.e]*\d)(?: *- *| *\.\. *| +to +| +)(\d[\d.e-]*)")
"""A range in another form."""

_Values = Annotated[list[Any], Field(min_length=1), Quantity(expects="a list of one value or more")]
Variations = Annotated[
    dict[str, _Values],
    BeforeValidator(plain),
    Quantity(expects='keys such as "arm.length", each with a list of one value or more'),
]


@dataclass(frozen=True)
class Span:
    """Range of numbers, both ends included."""

    first: int | float
    last: int | float
    count: int | None = None
    """Number of values; None of a range to sample."""
    log: bool = False
    """Whether equal steps are equal ratios."""

    def at(self, part: float) -> float:
        """Return the number at a part of the range, 0 at the first end and 1 at the last."""
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


@dataclass(frozen=True)
class Levels:
    """Levels of what varies together, made when they are asked for."""

    count: int
    at: Callable[[int], dict[str, Any]]
    """The values of a level by dotted key."""

    @staticmethod
    def of(key: str, values: Sequence[Any]) -> "Levels":
        """Return the levels of one key."""
        return Levels(len(values), lambda place: {key: values[place]})

    @staticmethod
    def together(columns: Sequence["Levels"]) -> "Levels":
        """Return levels of several keys, each with the values at the same place of all."""
        count = columns[0].count
        return Levels(count, lambda at: {k: v for each in columns for k, v in each.at(at).items()})


def combination(axes: Sequence[Levels], number: int) -> dict[str, Any]:
    """Return the values of one combination of levels; the last axis changes fastest.

    ``number`` is from 0 to the product of the counts of levels less 1.
    """
    found = []
    for levels in reversed(axes):
        number, place = divmod(number, levels.count)
        found.append(levels.at(place))
    return {key: value for level in reversed(found) for key, value in level.items()}


def case_words(values: Mapping[str, Any]) -> str:
    """Return the values of a case, as the beginning of a message about it."""
    return f"case {', '.join(f'{key} = {shown(value)}' for key, value in values.items())}: "


def read_variation(text: str) -> tuple[str, Span | list[Any]]:
    """Return key and values of ``KEY=FROM:TO:COUNT``, ``KEY=FROM:TO`` or ``KEY=A,B`` (``--vary``).

    ``:log`` behind a range makes equal steps equal ratios. A single value is TOML, and words need
    no quotes.
    """
    key, equals, values = (part.strip() for part in text.partition("="))
    if not equals or not key:
        raise _refusal(text, "be KEY=FROM:TO:COUNT or KEY=A,B, such as arm.length=0.3:0.6:4")
    if key.split(".")[0].strip("\"' ") == "vary":
        raise _refusal(text, "begin with a key that can vary")
    parts = [part.strip() for part in values.split(":")]
    if len(parts) > 1 and isinstance(value_of(parts[0]), (int, float)):
        return key, _span(text, parts)
    found = _split(values)
    if not all(found):
        raise _refusal(text, _FORMS)
    if len(found) == 1 and (ends := _TWO_ENDS.fullmatch(found[0])):
        raise refusal("--vary", got(text, _FORMS, f"Write {key}={ends[1]}:{ends[2]}:3."))
    return key, [value_of(each) for each in found]


def _refusal(text: str, must: str) -> ScenarioError:
    return refusal("--vary", got(text, must))


def _span(text: str, parts: list[str]) -> Span:
    log = parts[-1] == _LOG
    numbers = [value_of(part) for part in (parts[:-1] if log else parts)]
    if len(numbers) not in (2, 3):
        raise _refusal(text, _FORMS)
    first, last = numbers[:2]
    for end in (first, last):
        if isinstance(end, bool) or not isinstance(end, (int, float)) or not math.isfinite(end):
            raise _refusal(text, f"have a finite number at each end, not {shown(end)}")
    if first == last:
        raise _refusal(text, "have two different ends")
    if log and not first * last > 0:
        raise _refusal(text, "have ends of one sign, not 0, with log")
    count = numbers[2] if len(numbers) == 3 else None
    if count is not None and (type(count) is not int or count < 2):
        raise _refusal(text, f"have a count of 2 or more, not {shown(count)}")
    return Span(first, last, count, log)


def _split(text: str) -> list[str]:
    """Split at the commas outside of brackets and quotes."""
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
