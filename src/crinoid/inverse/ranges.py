"""Ranges of numbers of a scenario, as coordinates from 0 to 1."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from crinoid.inverse.unknowns import given_numbers
from crinoid.scenario import Scenario, ScenarioError, got, refusal
from crinoid.scenario.document import value_of
from crinoid.scenario.variation import Span

Point = Float[np.ndarray, " key"]

_TINY = 1e-300  # ratio of values of different signs, in place of their logarithm
_FORM = "be KEY=FROM:TO or KEY=FROM:TO:log with FROM below TO, such as arm.length=0.3:0.6"


class Ranges:
    """Ranges of numbers, written ``KEY=FROM:TO`` or ``KEY=FROM:TO:log``.

    Raises
    ------
    ScenarioError
        If one names no real number of the scenario, or has an end that the scenario refuses.
    """

    def __init__(self, scenario: Scenario, over: Sequence[str]) -> None:
        if not over:
            raise refusal("--over", f"got nothing; must {_FORM}")
        pairs = [_read(text) for text in over]
        self.spans = dict(pairs)  # range of each key
        self.keys = tuple(self.spans)
        if len(self.spans) < len(pairs):
            raise refusal("--over", "got a key twice; must name each once")
        given, mistakes = given_numbers(scenario, list(self.spans))
        if mistakes:
            raise ScenarioError(mistakes)
        self._scenario = scenario
        self.given = np.array(list(given.values()))  # given value of each key
        for key, span in self.spans.items():
            for end in (span.first, span.last):
                scenario.with_values({key: float(end)})

    @property
    def start(self) -> Point:
        """Coordinates of the given values, or of the nearest within the ranges."""
        found = []
        for value, span in zip(self.given, self.spans.values(), strict=True):
            ends = np.array([value, span.first, span.last], float)
            if span.log:
                ends = np.log(np.maximum(ends / span.first, _TINY))
            found.append((ends[0] - ends[1]) / (ends[2] - ends[1]))
        return np.clip(found, 0.0, 1.0)

    def values(self, point: Point, digits: int = 12) -> dict[str, float]:
        """Return the values by key at some coordinates, rounded and within the ranges."""
        found = {}
        for (key, span), part in zip(self.spans.items(), point, strict=True):
            value = float(f"{span.at(float(part)):.{digits}g}")
            found[key] = float(min(max(value, span.first), span.last))
        return found

    def scenario(self, point: Point, digits: int = 12) -> Scenario:
        """Return the scenario at some coordinates.

        Raises
        ------
        ScenarioError
            If the values exclude each other.
        """
        return self._scenario.with_values(self.values(point, digits))


def _read(text: str) -> tuple[str, Span]:
    key, equals, values = (part.strip() for part in text.partition("="))
    first, *others = (part.strip() for part in values.split(":"))
    log = others[1:] == ["log"]
    ends = [value_of(each) for each in (first, *others[:1])]
    numbers = all(type(end) in (int, float) and math.isfinite(end) for end in ends)
    if not key or not equals or len(others) != 1 + log or not numbers or not ends[0] < ends[1]:
        raise refusal("--over", got(text, _FORM))
    if log and not ends[0] * ends[1] > 0:
        raise refusal("--over", got(text, "have ends of one sign, not 0, with log"))
    return key, Span(*ends, log=log)
