"""The engine of a sweep: who runs which batch, and what becomes of those that fail."""

import time
from collections import Counter, deque
from collections.abc import Callable
from math import inf
from typing import NamedTuple

import tomli_w

from crinoid.status import Status
from crinoid.sweep.crew import Crew
from crinoid.sweep.plan import Plan
from crinoid.sweep.store import SweepStore
from crinoid.sweep.work import Row, Work

__all__ = ["run_batches"]

_TRIES = 3
_LOOK = 0.2
"""Time between two looks at workers and at wishes to stop (s)."""
_LEAST = 60.0
"""Time that a batch has at least (s)."""
_PATIENCE = 10.0
"""Longest that a batch may take, in times of what the slowest run so far would make of it."""

Report = Callable[[int], None]
"""Called with the number of runs that are saved."""


class _Flight(NamedTuple):
    number: int
    begun: float


def run_batches(
    plan: Plan,
    store: SweepStore,
    crew: Crew,
    done: set[int],
    report: Report,
    stop: Callable[[], bool],
) -> bool:
    """Run the batches of a plan that are not done, and save each.

    One whose worker dies, or takes far longer than others, is tried again, three times in all;
    then its runs fail.

    Parameters
    ----------
    plan, store, crew
        What to run, where to save it, and who runs it.
    done
        Numbers of the batches that are saved; those that are run are added.
    report
        Called with the number of runs that are saved.
    stop
        Asked five times a second whether to stop.

    Returns
    -------
    bool
        Whether all are done.
    """
    scenario = tomli_w.dumps(plan.scenario.to_dict())
    batches = plan.batches
    waiting = deque(number for number in range(len(batches)) if number not in done)
    under: dict[str, _Flight] = {}
    tries: Counter[int] = Counter()
    slowest: dict[int, float] = {}  # time of a run, by structure
    found: list[tuple[int, list[Row]]] = []
    saved = sum(batches[number].runs.size for number in done)

    def keep(number: int, rows: list[Row]) -> None:
        nonlocal saved
        store.save(number, batches[number], rows)
        done.add(number)
        saved += len(rows)
        report(saved)

    def failed(number: int, reason: str) -> None:
        tries[number] += 1
        if tries[number] < _TRIES:
            waiting.append(number)
            return
        row = Row.without(f"{Status.FAILED}: {reason}, {_TRIES} times")
        found.append((number, [row] * batches[number].runs.size))

    report(saved)
    while waiting or under or found:
        for worker, threads in crew.workers().items():
            if waiting:
                number = waiting.popleft()
                values = [plan.values(run) for run in batches[number].runs.tolist()]
                crew.give(worker, Work(scenario, values, threads))
                under[worker] = _Flight(number, time.monotonic())
        for number, rows in found:  # while workers are at work again
            keep(number, rows)
        found.clear()
        if stop():
            return False
        for ended in crew.ended(_LOOK):
            flight = under.pop(ended.worker)
            if ended.rows is None:
                failed(flight.number, ended.reason)
                continue
            _, structure = batches[flight.number]
            each = (time.monotonic() - flight.begun) / len(ended.rows)
            slowest[structure] = max(slowest.get(structure, 0.0), each)
            found.append((flight.number, ended.rows))
        for worker, flight in list(under.items()):
            runs, structure = batches[flight.number]
            most = max(_LEAST, _PATIENCE * slowest.get(structure, inf) * runs.size)
            if time.monotonic() - flight.begun > most:
                del under[worker]
                crew.replace(worker)
                failed(flight.number, f"its worker took longer than {most:.0f} s")
    return True
