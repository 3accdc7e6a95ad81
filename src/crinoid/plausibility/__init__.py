"""Odd numbers of a scenario, looked for before it is run: notes, never refusals.

A rule is plain text and numbers: it needs neither JAX nor a run. `RULES` is the one place that
says what is looked at; docs/notes.md is made from it.
"""

from collections.abc import Collection

import numpy as np

from crinoid.assembly.prepared import Prepared
from crinoid.plausibility.arm import ARM
from crinoid.plausibility.base import BASE
from crinoid.plausibility.current import CURRENT
from crinoid.plausibility.facts import Facts
from crinoid.plausibility.load import LOAD
from crinoid.plausibility.loop import LOOP
from crinoid.plausibility.obstacle import OBSTACLE
from crinoid.plausibility.policy import POLICY
from crinoid.plausibility.rule import Rule
from crinoid.plausibility.thread import THREAD
from crinoid.plausibility.time import TIME
from crinoid.plausibility.tool import TOOL
from crinoid.plausibility.usual import USUAL
from crinoid.plausibility.vehicle import VEHICLE
from crinoid.scenario import ScenarioError
from crinoid.scenario.tables import AT_REST

__all__ = ["AT_REST", "IN_THE_WATER", "RULES", "Facts", "Rule", "doubts"]

_FIRST = (*USUAL, *ARM)
"""Rules on single numbers. Where an arm or its water is odd, what follows from it is too,
and goes without saying."""
_THEN = (*BASE, *CURRENT, *LOAD, *TOOL, *THREAD, *VEHICLE, *OBSTACLE, *LOOP, *POLICY, *TIME)
RULES = (*_FIRST, *_THEN)

IN_THE_WATER = ("water", "flow")
"""Tables that a current depends on."""


def doubts(prepared: Prepared, tables: Collection[str] = ()) -> list[str]:
    """Return a sentence for each number of a scenario that is not plausible; one case.

    Parameters
    ----------
    prepared
        What is to be run.
    tables
        The tables that matter; all if none is named.
    """
    facts = Facts(prepared)
    found = [doubt for rule in _FIRST for doubt in _told(rule, facts)]
    if not any(doubt.startswith(("arm.", "water.")) for doubt in found):
        found += [doubt for rule in _THEN for doubt in _told(rule, facts)]
    return [doubt for doubt in found if not tables or doubt.split(":")[0].split(".")[0] in tables]


def _told(rule: Rule, facts: Facts) -> list[str]:
    """Return the doubts of a rule; the last one says where its numbers overflow."""
    found: list[str] = []
    try:
        with np.errstate(over="raise", divide="raise", invalid="raise"):
            for doubt in rule.doubts(facts):
                found.append(doubt)
    except ScenarioError:
        raise
    except (ArithmeticError, ValueError):
        first, *more = rule.keys
        along = f" (with {', '.join(more)})" if more else ""
        against = f" against {rule.against}" if rule.against else ""
        text = f"cannot be judged{along}{against}; numbers go beyond what can be computed"
        found.append(f"{first}: {text}")
    return found
