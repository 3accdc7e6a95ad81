"""Numbers of a scenario to find, each of one key or of several keys in proportion."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from crinoid.scenario import Mistake, Scenario, ScenarioError
from crinoid.scenario.document import value_at
from crinoid.scenario.errors import got

Vector = Float[np.ndarray, " parameter"]


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
        self.keys = tuple(keys)
        """Key of each number, with plus signs between keys in proportion."""
        parts = [[part.strip() for part in key.split("+")] for key in self.keys]
        every = [part for some in parts for part in some]
        mistakes = [
            Mistake("--of", f"got {part} twice; must name each parameter once")
            for part in dict.fromkeys(every)
            if every.count(part) > 1
        ]
        given = {part: value_at(scenario.to_dict(), part) for part in every}
        for part, value in given.items():
            if part.startswith("simulation."):
                text = "is a setting of the computation. Name a parameter of the experiment."
                mistakes.append(Mistake(part, text))
            elif value is None:
                scenario.with_values({part: 1.0})  # raises if the key does not exist
                text = f"has no initial value. Set one: --set {part}=NUMBER"
                mistakes.append(Mistake(part, text))
            elif isinstance(value, list):
                hint = f"Name one of them, such as {part}.0, or all as one: {part}.0+{part}.1."
                mistakes.append(Mistake(part, got(value, "be a single number", hint)))
            elif not isinstance(value, float):
                mistakes.append(Mistake(part, got(value, "be a real number")))
            elif value == 0:
                text = got(0, "be another number to start from", "It sets the sign and the scale.")
                mistakes.append(Mistake(part, text))
        if mistakes:
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
