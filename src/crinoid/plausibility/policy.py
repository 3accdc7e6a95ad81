"""A policy's scenario against that which it was trained on."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from crinoid.assembly.description import KEY, PHYSICAL, Description
from crinoid.plausibility.facts import Facts
from crinoid.plausibility.rule import Rule
from crinoid.scenario import ScenarioError, shown

_NEAR = 1e-6
"""Part of a number by which it may differ."""


def _trained(facts: Facts) -> Iterator[str]:
    """Yield what differs from all that the policy has met, one number after the other."""
    control = facts.scenario.control
    if control.kind != "neural" or control.neural.weights is None:
        return
    try:
        told = Description.of(Path(control.neural.weights))
    except ScenarioError:
        return  # refused by whoever needs it
    here, there = (dict(_numbers(each, "")) for each in (facts.scenario.to_dict(), told.scenario))
    for key in dict.fromkeys([*here, *there]):
        met = told.draw.get(key, [there.get(key)] * 2)
        got = here.get(key)
        if not _within(got, met):
            usual = shown(met[0]) if met[0] == met[1] else f"{met[0]:g} to {met[1]:g}"
            without = "without it" if met[0] is None else f"with {usual}"
            words = f"the policy of {KEY} was trained {without}, and may fail here"
            yield f"{key}: got {'none' if got is None else shown(got)}; {words}"


def _within(got: Any, met: list[Any]) -> bool:
    low, high = met
    if not all(isinstance(each, int | float) for each in (got, low, high)):
        return got == low
    room = _NEAR * max(abs(low), abs(high))
    return low - room <= got <= high + room


def _numbers(value: Any, name: str) -> Iterator[tuple[str, Any]]:
    """Yield the values of tables by dotted key."""
    if isinstance(value, dict | list):
        items = value.items() if isinstance(value, dict) else enumerate(value)
        for key, inner in items:
            if name or key in PHYSICAL:
                yield from _numbers(inner, f"{name}.{key}" if name else str(key))
    else:
        yield name, value


POLICY = (
    Rule((KEY,), "the arm, the water and the sensors that its policy was trained on", _trained),
)
