"""Plausibility of a scenario before its run: notes on unusual values, never refusals.

Numbers with a unit, and what an expert would miss; the rules need neither JAX nor a run. `RULES`
is their one list; docs/reference/notes.md is made from it.
"""

import re
from collections.abc import Collection

import numpy as np

from crinoid.assembly.prepared import Prepared
from crinoid.diagnostics.plausibility.checks import CHECKS
from crinoid.diagnostics.plausibility.rule import Rule
from crinoid.diagnostics.plausibility.table import RANGES
from crinoid.diagnostics.plausibility.task_checks import TASK_CHECKS
from crinoid.scenario import ScenarioError

__all__ = ["IN_THE_WATER", "RULES", "plausibility_warnings"]

RULES = (*RANGES, *CHECKS, *TASK_CHECKS)

IN_THE_WATER = ("water", "flow")
"""Tables that a current depends on."""


def plausibility_warnings(prepared: Prepared, tables: Collection[str] = ()) -> list[str]:
    """Return a sentence for each implausible value of one case, in some tables or in all."""
    found = [note for rule in RULES for note in _notes(rule, prepared)]
    return [note for note in found if not tables or note.split(":")[0].split(".")[0] in tables]


def _notes(rule: Rule, prepared: Prepared) -> list[str]:
    """Return the notes of a rule, one for all tables of a list; or that its numbers overflow."""
    found: dict[str, list[str]] = {}
    try:
        with np.errstate(over="raise", divide="raise", invalid="raise"):
            for note in rule.notes(prepared.facts):
                found.setdefault(re.sub(r"\.\d+", ".*", note.split(":")[0]), []).append(note)
    except ScenarioError:
        raise
    except (ArithmeticError, ValueError):
        text = f"cannot be judged by {rule.limit}: the numbers exceed the range of the computation"
        return [f"{rule.keys[0]}: {text}"]
    return [
        first + (f" ({len(others)} more of {key})" if others else "")
        for key, (first, *others) in found.items()
    ]
