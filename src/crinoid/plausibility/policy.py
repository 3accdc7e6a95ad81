"""A policy's scenario against that which it was trained on."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from crinoid.assembly.description import KEY, PHYSICAL, Description
from crinoid.plausibility.facts import Facts
from crinoid.plausibility.rule import Rule
from crinoid.scenario import ScenarioError, shown

_NEAR = 1e-6
"""Part of a number by which it may differ."""
_MOST = 3
"""Keys that are told of."""


def _trained(facts: Facts) -> Iterator[str]:
    control = facts.scenario.control
    if control.kind != "neural" or control.neural.weights is None:
        return
    try:
        told = Description.of(Path(control.neural.weights))
    except ScenarioError:
        return  # refused by whoever needs it
    here, there = (dict(_numbers(each, "")) for each in (facts.scenario.to_dict(), told.scenario))
    found = []
    for key in dict.fromkeys([*here, *there, *told.draw]):
        if key not in told.draw and key.split(".")[0] not in PHYSICAL:
            continue
        low, high = told.draw.get(key, [there.get(key)] * 2)
        if not _within(here.get(key), low, high):
            met = _shown(low) if low == high else f"{_shown(low)} to {_shown(high)}"
            found.append(f"{key} = {_shown(here.get(key))} (trained on {met})")
    if found:
        more = f" and {len(found) - _MOST} more" if len(found) > _MOST else ""
        words = ", ".join(found[:_MOST])
        yield f"{KEY}: the policy has not met {words}{more}, and may fail"


def _shown(value: Any) -> str:
    return "none" if value is None else f"{value:.4g}" if isinstance(value, float) else shown(value)


def _within(got: Any, low: Any, high: Any) -> bool:
    if not all(isinstance(each, int | float) for each in (got, low, high)):
        return got == low
    room = _NEAR * max(abs(low), abs(high))
    return low - room <= got <= high + room


def _numbers(value: Any, name: str) -> Iterator[tuple[str, Any]]:
    """Yield the values of tables by dotted key."""
    if isinstance(value, dict | list):
        items = value.items() if isinstance(value, dict) else enumerate(value)
        for key, inner in items:
            yield from _numbers(inner, f"{name}.{key}" if name else str(key))
    else:
        yield name, value


POLICY = (
    Rule((KEY,), "the arm, the water and the sensors that its policy was trained on", _trained),
)
