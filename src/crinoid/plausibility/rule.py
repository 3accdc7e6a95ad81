"""A rule: what of a scenario it looks at, what it takes for plausible, and what it says if not."""

import math
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

from crinoid.plausibility.facts import Facts
from crinoid.scenario import shown


class Rule(NamedTuple):
    """One thing that is looked at before a run."""

    keys: tuple[str, ...]
    """The keys of a scenario that it names; a ``*`` stands for any number or name."""
    limit: str
    """The plausible range, in words."""
    doubts: Callable[[Facts], Iterator[str]]
    """Yields a sentence that begins with the key for each number that is not."""
    against: str = ""
    """The quantity they are held against, where another rule has the same keys."""


def usual(
    key: str, low: float | int, high: float | int, unit: str, *, below: str = "", above: str = ""
) -> Rule:
    """Make the rule of numbers that are plausible or not by themselves; 0 always is.

    Of a vector its magnitude counts. ``below`` and ``above`` say what is likely wrong.
    """
    name = f" {unit}" if unit else ""
    limit = f"{low:g} to {high:g}{name}" if low else f"up to {high:g}{name}"

    def doubts(facts: Facts) -> Iterator[str]:
        for found, value in numbers(facts.scenario, key):
            size = math.hypot(*value) if isinstance(value, tuple) else abs(value)
            if size == 0 or low <= size <= high:
                continue
            cause = (below if size < low else above) or f"is it in {unit}?"
            yield f"{found}: got {shown(value)}{name}; usual is {limit}; {cause}"

    return Rule((key,), limit, doubts)


def numbers(root: Any, key: str) -> Iterator[tuple[str, Any]]:
    """Yield what a key stands for that is a number or a vector, with the key spelled out."""
    found: list[tuple[str, Any]] = [("", root)]
    for part in key.split("."):
        found = [
            (f"{name}.{inner}" if name else str(inner), value)
            for name, parent in found
            for inner, value in _parts(parent, part)
        ]
    for name, value in found:
        vector = isinstance(value, tuple) and all(isinstance(item, float) for item in value)
        if vector or (isinstance(value, int | float) and not isinstance(value, bool)):
            yield name, value


def _parts(parent: Any, part: str) -> list[tuple[Any, Any]]:
    if part != "*":
        return [(part, getattr(parent, part, None))]
    if isinstance(parent, tuple):
        return list(enumerate(parent))
    return list(getattr(parent, "present", {}).items())
