"""A plausibility rule: keys, their usual range, and a note on each value outside of it."""

import math
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np

from crinoid.assembly.facts import Facts
from crinoid.scenario import shown

Notes = Callable[[Facts], Iterator[str]]
"""Yields a note that begins with the key for each implausible value."""
Of = Callable[[Facts, Any, Any], Any]
"""From the facts, the value of a key and the table that contains it to one quantity or several;
None where the rule does not apply."""


class Rule(NamedTuple):
    """A check of a scenario before its run."""

    keys: tuple[str, ...]
    """The keys of a scenario that it judges; ``*`` matches any number or name."""
    limit: str
    """What is usual, in words."""
    notes: Notes


def rule(*keys: str, limit: str) -> Callable[[Notes], Rule]:
    """Return the decorator that makes a rule of a function."""
    return lambda notes: Rule(keys, limit, notes)


def range_rule(
    keys: str,
    low: float,
    high: float,
    unit: str = "",
    *,
    quantity: str = "",
    quantity_unit: str = "",
    of: Of | None = None,
    limit: str = "",
    below: str = "",
    above: str = "",
) -> Rule:
    """Return the rule that a value, or a quantity that follows from it, lies in a range.

    A comma separates keys; a ``*`` in one matches any number or name. ``of`` computes the quantity.
    Without it the value itself counts, a vector by its length, and 0 is always plausible. ``limit``
    is the range in words, ``below`` and ``above`` are hints on the likely mistake.
    """
    suffix = f" {unit}" if unit else ""
    limit, each = limit or _range(low, high, quantity_unit if of else unit), keys.split(", ")

    def notes(facts: Facts) -> Iterator[str]:
        for found, value, table in (one for key in each for one in numbers(facts.scenario, key)):
            size = of(facts, value, table) if of else magnitude(value) or None
            outside = [x for x in np.ravel(size) if x < low or x > high] if size is not None else []
            if outside:
                because = f" ({quantity} = {outside[0]:.3g} {quantity_unit}".rstrip() + ")"
                hint = (below if outside[0] < low else above) or (f"Is it in {unit}?" * bool(unit))
                yield unusual(found, f"{shown(value)}{suffix}{because if of else ''}", limit, hint)

    return Rule(tuple(each), f"{quantity}: {limit}" if quantity else limit, notes)


def unusual(key: str, value: str, usual: str, hint: str = "") -> str:
    """Return a note: the value, the usual ones, and the likely mistake or the remedy."""
    return f"{key}: got {value}; usual is {usual}. {hint}".rstrip()


def magnitude(value: Any) -> float:
    """Return the size of a number, or the length of a vector."""
    return math.hypot(*value) if isinstance(value, tuple) else float(abs(value))


def _range(low: float, high: float, unit: str) -> str:
    if math.isinf(high):
        return f"{low:g} {unit}".rstrip() + " or more"
    words = f"{low:g} to {high:g}" if low else f"up to {high:g}"
    return f"{words} {unit}".rstrip()


def numbers(root: Any, key: str) -> Iterator[tuple[str, Any, Any]]:
    """Yield each number or vector that a key matches: its own key, value and table."""
    found: list[tuple[str, Any, Any]] = [("", root, None)]
    for part in key.split("."):
        found = [
            (f"{name}.{inner}" if name else str(inner), value, parent)
            for name, parent, _ in found
            for inner, value in _entries(parent, part)
        ]
    for name, value, table in found:
        vector = isinstance(value, tuple) and all(isinstance(item, float) for item in value)
        if vector or (isinstance(value, int | float) and not isinstance(value, bool)):
            yield name, value, table


def _entries(parent: Any, part: str) -> list[tuple[Any, Any]]:
    if part != "*":
        found = getattr(parent, part, None)
        return [(part, getattr(parent, f"{part}_", None) if found is None else found)]
    if isinstance(parent, tuple):
        return list(enumerate(parent))
    return list(getattr(parent, "present", {}).items())
