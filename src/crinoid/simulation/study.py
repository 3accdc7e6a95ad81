"""Several cases of one scenario, one after the other, and the table that compares them."""

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

from crinoid.result import Result
from crinoid.scenario import Scenario
from crinoid.simulation.run import Report, play


class Case(NamedTuple):
    """One case of a study."""

    number: int
    values: dict[str, Any]
    """What was varied, by dotted key."""
    result: Result


def play_cases(
    scenario: Scenario,
    *,
    report: Callable[[int, int], Report | None] | None = None,
    resume: Callable[[int], Result | None] = lambda number: None,
) -> Iterator[Case]:
    """Run the cases of a scenario, yielding each as it ends, until one is interrupted.

    ``report`` makes the progress callback of a case from its number (from 1) and how many there
    are; ``resume`` finds an earlier result of it.
    """
    cases = scenario.cases()
    for number, (values, case) in enumerate(cases, start=1):
        follow = report(number, len(cases)) if report is not None else None
        result = play(case, report=follow, resume=resume(number))
        yield Case(number, values, result)
        if result.interrupted:
            return
