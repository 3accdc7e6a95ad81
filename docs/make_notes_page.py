"""Write the tables of `docs/reference/notes.md` from the rules themselves.

    python docs/make_notes_page.py

Run it after a change of a rule or a note: `tests/project/test_docs.py` compares.
"""

from __future__ import annotations

from pathlib import Path

from crinoid.diagnostics import control_loop as loop_health
from crinoid.diagnostics import lock_in
from crinoid.diagnostics import run_notes as notes
from crinoid.diagnostics.plausibility import RULES
from crinoid.simulation import loop_margin as margin

PAGE = Path(__file__).with_name("reference") / "notes.md"
BEFORE, AFTER = "scenario", "run"


def before() -> str:
    """Return the table of the rules for a scenario and its control loop."""
    rows = ["| Keys | Plausible |", "|---|---|"]
    for rule in RULES:
        keys = ", ".join(f"`{key}`" for key in rule.keys)
        rows.append(f"| {keys} | {rule.limit} |")
    gains = f"a stable linear loop with a modulus margin of {margin.ROBUST:g} or more"
    rows.append(f"| `control.pid.*` | {gains} |")
    return "\n".join(rows)


def after() -> str:
    """Return the table of the notes on a run."""
    often = loop_health._OFTEN
    found = [
        (
            "saturation of a channel",
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
            f"more, does not decay, and is {loop_health._OVER_UNCONTROLLED:g} times that without "
            "control",
        ),
        ("control that increases the error", "a larger RMS error with control than without"),
        (
            "lock-in of vortices",
            "a reduced velocity in the range of lock-in, from 4 to a number by the mass ratio (18 "
            "for an arm of nearly the density of water), without vortices in space, for "
            f"{lock_in._CYCLES:g} periods on end, on {lock_in._NOTED:.0%} of the length for "
            f"{lock_in._NOTED:.0%} of the time; or, where the mean flow is in that range, for "
            f"more than {lock_in._MOSTLY:.0%} of the time without a reversal",
        ),
        (
            "a drag coefficient outside of its range",
            f"the default `water.drag_normal` at Reynolds numbers outside "
            f"{notes._SUBCRITICAL[0]:g} to {notes._SUBCRITICAL[1]:g}, a given one more than "
            f"{notes._OFF:g} times that of a smooth cylinder or less than the inverse, or that of "
            f"the literature above {notes._CRISIS:g}; for most of the drag",
        ),
        (
            "a strain beyond linear elasticity",
            f"more than {notes._STRAIN:.0%}, of an edge or at the surface; a run fails with an "
            f"edge {notes._TORN:g} times longer or shorter",
        ),
        (
            "penetration of an obstacle",
            f"by more than {notes._PRESSED:.0%} of the arm's radius",
        ),
        ("a sensor that returns nan or infinity", "one reading that is not finite"),
        ("an unstable equilibrium", "a mode at the start without restoring force"),
    ]
    rows = ["| Note | Condition |", "|---|---|"]
    return "\n".join([*rows, *(f"| {what} | {when} |" for what, when in found)])


def updated(text: str) -> str:
    """Return a page with new tables."""
    tables = {BEFORE: before(), AFTER: after()}
    for name, table in tables.items():
        begin, end = f"<!-- {name}: begin -->", f"<!-- {name}: end -->"
        head, rest = text.split(begin)
        _, tail = rest.split(end)
        text = f"{head}{begin}\n\n{table}\n\n{end}{tail}"
    return text


if __name__ == "__main__":
    PAGE.write_text(updated(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
