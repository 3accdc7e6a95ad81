"""A short trial of a sweep: how long a run takes, and how much is kept of it."""

import time
from typing import NamedTuple

from crinoid.assembly.prepared import Prepared
from crinoid.simulation import Progress, play
from crinoid.sweep import Plan

_LONGEST = 10.0
"""Time after which a trial is long enough (s)."""


class Trial(NamedTuple):
    """Time that a run takes."""

    seconds: float
    """Time of a whole run on one core (s)."""
    part: float
    """How much of a run that was timed of."""


def time_run(plan: Plan) -> Trial:
    """Time the first run of a plan, or its first ten seconds; compiling does not count."""
    _play(plan, 0.0)
    begun = time.perf_counter()
    part = _play(plan, _LONGEST)
    return Trial((time.perf_counter() - begun) / part, part)


def _play(plan: Plan, seconds: float) -> float:
    """Run for some seconds at least, and return how much of the whole it came to."""
    case = plan.case(1)
    ends: dict[str, float] = {}
    begun = time.perf_counter()

    def report(progress: Progress) -> None:
        ends[progress.label] = progress.time

    play(Prepared(case), report=report, stop=lambda: time.perf_counter() - begun > seconds)
    stages = 2 if case.control.kind != "none" and case.control.compare else 1
    return max(sum(ends.values()), case.simulation.time_step) / (stages * case.simulation.duration)
