"""Write the tables of `docs/notes.md` from the rules themselves.

    python docs/make_notes_page.py

Run it after a change to what is told of a scenario or a run; `tests/test_docs.py` asks for it.
"""

from __future__ import annotations

from pathlib import Path

from crinoid import loop_health, notes
from crinoid.plausibility import RULES
from crinoid.simulation import margin

PAGE = Path(__file__).with_name("notes.md")
BEFORE, AFTER = "scenario", "run"


def before() -> str:
    """Return the table of what is looked at in a scenario, and in its control loop."""
    rows = ["| Keys | Plausible |", "|---|---|"]
    for rule in RULES:
        against = f" against {rule.against}" if rule.against else ""
        keys = ", ".join(f"`{key}`" for key in rule.keys)
        rows.append(f"| {keys}{against} | {rule.limit} |")
    gains = f"a stable linear loop with a modulus margin of {margin.ROBUST:g} or more"
    rows.append(f"| `control.pid.*` | {gains} |")
    return "\n".join(rows)


def after() -> str:
    """Return the table of what is looked at in a run."""
    often = loop_health._OFTEN
    told = [
        (
            "a channel at its limits",
            f"for {often['range']:.0%} of the controlled time at an end of its travel, "
            f"{often['speed']:.0%} at its greatest speed or {often['acceleration']:.0%} at its "
            "greatest acceleration, by saved instants",
        ),
        (
            "an error that grows",
            f"the RMS error over sixths of the controlled time rises by {loop_health._RISE - 1:.0%}"
            f" or more three times in a row and {loop_health._GROWN:g} times in all, and twice as "
            "much as without control",
        ),
        (
            "a limit cycle",
            f"{loop_health._NARROW:.0%} of the variance of the tip's error in the last half of the "
            f"controlled time is in one line of its spectrum, of {loop_health._CYCLES} cycles or "
            f"more, does not die down, and is {loop_health._OWN:g} times that without control",
        ),
        ("control that makes it worse", "a larger RMS error with control than without"),
        (
            "lock-in of vortices",
            f"a reduced velocity from {notes._LOCK_IN[0]:g} to {notes._LOCK_IN[1]:g} for "
            f"{notes._CYCLES:g} periods on end, on {notes._WORTH:.0%} of the length for "
            f"{notes._WORTH:.0%} of the time",
        ),
        (
            "a drag coefficient out of its range",
            f"the default `water.drag_normal` at Reynolds numbers outside "
            f"{notes._SUBCRITICAL[0]:g} to {notes._SUBCRITICAL[1]:g}",
        ),
        (
            "an absurd strain",
            f"more than {notes._STRAIN:.0%}; a run fails with an edge {notes._TORN:g} times longer "
            "or shorter",
        ),
        (
            "an obstacle pressed into the arm",
            f"by more than {notes._PRESSED:.0%} of the arm's radius",
        ),
        ("a sensor that gives nan or infinity", "one reading that is not finite"),
        ("an equilibrium that does not hold", "a mode at the start that does not swing back"),
    ]
    rows = ["| What | When it is told |", "|---|---|"]
    return "\n".join([*rows, *(f"| {what} | {when} |" for what, when in told)])


def updated(text: str) -> str:
    """Return a page with its tables renewed."""
    tables = {BEFORE: before(), AFTER: after()}
    for name, table in tables.items():
        begin, end = f"<!-- {name}: begin -->", f"<!-- {name}: end -->"
        head, rest = text.split(begin)
        _, tail = rest.split(end)
        text = f"{head}{begin}\n\n{table}\n\n{end}{tail}"
    return text


if __name__ == "__main__":
    PAGE.write_text(updated(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
