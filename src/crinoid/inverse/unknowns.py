"""Numbers of a scenario to find, each of one key or of several keys in proportion."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from crinoid.scenario import Mistake, Scenario, ScenarioError, got
from crinoid.scenario.document import value_at

Vector = Float[np.ndarray, " parameter"]


def given_numbers(
    scenario: Scenario, keys: Sequence[str], instead: str = ""
) -> tuple[dict[str, Any], list[Mistake]]:
    """Return the given values by key, and the mistakes of keys that name no real number.

    ``instead`` is how several numbers of a list may be named, where they may.
    """
    document, mistakes = scenario.to_dict(), []
    given = {key: value_at(document, key) for key in keys}
    for key, value in given.items():
        if key.partition(".")[0] in ("simulation", "output"):
            text = "is a setting of the computation. Name a parameter of the experiment."
            mistakes.append(Mistake(key, text))
        elif value is None:
            scenario.with_values({key: 1.0})  # raises if the key does not exist
            mistakes.append(Mistake(key, f"has no initial value. Set one: --set {key}=NUMBER"))
        elif isinstance(value, list):
            hint = f"Name one of them, such as {key}.0{instead.format(key) or '.'}"
            mistakes.append(Mistake(key, got(value, "be a single number", hint)))
        elif not isinstance(value, float):
            mistakes.append(Mistake(key, got(value, "be a real number")))
    return given, mistakes


class Unknowns:
    """Numbers of a scenario to find: logarithms of factors on the given values.

    So a number has the sign of its given value. ``a+b`` is one number for the keys ``a`` and ``b``,
    whose values have one factor; it is given as the value of ``a``.

    Raises
    ------
    ScenarioError
        If a key names no number of an experiment, or one that cannot be found from.
    """

    def __init__(self, scenario: Scenario, keys: Sequence[str]) -> None:
        self.keys = tuple(keys)  # key of each number, with plus signs between keys in proportion
        parts = [[part.strip() for part in key.split("+")] for key in self.keys]
        every = [part for some in parts for part in some]
        mistakes = [
            Mistake("--of", f"got {part} twice; must name each parameter once")
            for part in dict.fromkeys(every)
            if every.count(part) > 1
        ]
        given, wrong = given_numbers(scenario, every, ", or all as one: {0}.0+{0}.1.")
        for part, value in given.items():
            if isinstance(value, float) and value == 0:
                text = got(0, "be another number to start from", "It sets the sign and the scale.")
                wrong.append(Mistake(part, text))
        if mistakes := [*mistakes, *wrong]:
            raise ScenarioError(mistakes)
        self._given = [{part: float(given[part]) for part in some} for some in parts]
        self.given: Vector = np.array([next(iter(some.values())) for some in self._given])
        """Given value of each number."""

    def values(self, logs: Vector) -> dict[str, float]:
        """Return the values by key for logarithms of the numbers over their given values."""
        return {
            part: float(factor * value)
            for factor, some in zip(np.exp(logs), self._given, strict=True)
            for part, value in some.items()
        }
