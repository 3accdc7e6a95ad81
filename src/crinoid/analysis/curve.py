"""Cases of a scenario along the values of one number; without JAX."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from crinoid.assembly.prepared import Prepared, at_rest
from crinoid.scenario import Scenario, got, refusal
from crinoid.scenario.variation import Span, read_variation

_MOST = 10_000
_IDLE = ("title", "seed", "control", "simulation", "output", "sensor", "sensors")
"""Keys and tables without an effect on an equilibrium."""


def require_effect_at_rest(option: str, keys: Iterable[str]) -> None:
    """Refuse keys of tables without an effect on an equilibrium."""
    for key in keys:
        if (table := key.partition(".")[0]) in _IDLE:
            raise refusal(option, f"got {key}; {table} changes no equilibrium. Name another key.")


class Curve(NamedTuple):
    """Cases of a scenario along the values of one key."""

    key: str
    values: list[float]
    cases: list[Prepared]

    @staticmethod
    def of(scenario: Scenario, variations: Sequence[str]) -> Curve:
        """Return the cases of a scenario and its option ``--vary``, all of them checked."""
        if len(variations) != 1:
            raise refusal("--vary", f"got {len(variations)} keys; must name one")
        key, found = read_variation(variations[0])
        require_effect_at_rest("--vary", [key])
        if isinstance(found, Span) and found.count is None:
            raise refusal("--vary", got(variations[0], f"have a count, {key}=FROM:TO:COUNT"))
        if isinstance(found, Span) and (found.count or 0) > _MOST:
            raise refusal("--vary", got(found.count, f"have a count of at most {_MOST}"))
        values = found.values() if isinstance(found, Span) else found
        if not all(type(value) in (int, float) and math.isfinite(value) for value in values):
            raise refusal("--vary", got(variations[0], "have numbers as values"))
        if len({*values}) < len(values) or len(values) < 2:
            raise refusal("--vary", got(variations[0], "have 2 or more different values"))
        first, cases = Prepared(at_rest(scenario)), []
        for value in values:
            case = first.with_scenario(at_rest(scenario.with_values({key: value})))
            case.check()
            cases.append(case)
        return Curve(key, [float(value) for value in values], cases)
