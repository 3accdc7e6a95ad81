"""Plausibility of a scenario before its run: notes on unusual values, never refusals.

The rules need neither JAX nor a run. `RULES` is their one list;
docs/reference/notes.md is made from it.
"""

from collections.abc import Collection

import numpy as np

from crinoid.assembly.facts import Facts
from crinoid.assembly.prepared import Prepared
from crinoid.diagnostics.plausibility.checks import BASIC_CHECKS, CHECKS
from crinoid.diagnostics.plausibility.rule import Rule
from crinoid.diagnostics.plausibility.table import BASIC, DERIVED
from crinoid.diagnostics.plausibility.task_checks import TASK_CHECKS
from crinoid.scenario import ScenarioError
from crinoid.scenario.scenario import AT_REST

__all__ = ["AT_REST", "IN_THE_WATER", "RULES", "Facts", "Rule", "plausibility_warnings"]

_FIRST = (*BASIC, *BASIC_CHECKS)
"""Where these find an implausible arm or water, the others follow from it and are left out."""
_THEN = (*DERIVED, *CHECKS, *TASK_CHECKS)
RULES = (*_FIRST, *_THEN)

IN_THE_WATER = ("water", "flow")
"""Tables that a current depends on."""


def plausibility_warnings(prepared: Prepared, tables: Collection[str] = ()) -> list[str]:
    """Return a sentence for each implausible value of one case, in some tables or in all."""
    facts = prepared.facts
    if (found := facts.warnings) is None:
        found = [note for rule in _FIRST for note in _warnings(rule, facts)]
        if not any(note.startswith(("arm.", "water.")) for note in found):
            found += [note for rule in _THEN for note in _warnings(rule, facts)]
        facts.warnings = found
    return [note for note in found if not tables or note.split(":")[0].split(".")[0] in tables]


def _warnings(rule: Rule, facts: Facts) -> list[str]:
    """Return the notes of a rule; the last one says where its numbers overflow."""
    found: list[str] = []
    try:
        with np.errstate(over="raise", divide="raise", invalid="raise"):
            for note in rule.warnings(facts):
                found.append(note)
    except ScenarioError:
        raise
    except (ArithmeticError, ValueError):
        first, *more = rule.keys
        along = f" (with {', '.join(more)})" if more else ""
        by = f" by {rule.quantity}" if rule.quantity else ""
        text = f"cannot be judged{along}{by}: the numbers exceed the range of the computation"
        found.append(f"{first}: {text}")
    return found
