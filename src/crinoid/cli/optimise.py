"""Optimisation of the numbers of a scenario: progress, the new scenario, a table."""

import json
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import xarray as xr
from rich.table import Table

from crinoid.cli.command import FAILED, MISSED
from crinoid.cli.display import new_table, progress_bar
from crinoid.cli.finding import finding, solvable
from crinoid.cli.interruption import Interruption
from crinoid.foundation.status import Status
from crinoid.foundation.version import __version__
from crinoid.inverse import OPTIMISATION
from crinoid.inverse.goal import Goal
from crinoid.inverse.optimisation import Optimisation
from crinoid.inverse.ranges import Ranges
from crinoid.results.measure_labels import plain_unit
from crinoid.results.metrics import known
from crinoid.results.summary import SUMMARY_JSON
from crinoid.scenario import ScenarioText, counted

More = tuple[list[tuple[str, ...]], list[str]]
S = TypeVar("S", bound=Optimisation)


def optimise_numbers(
    text: ScenarioText,
    ranges: Ranges,
    goal: Goal,
    seeds: int,
    trials: int,
    folder: Path,
    *,
    rest: bool,
    force: bool,
) -> tuple[str, int]:
    """Search, save and draw what was found, and sum it up; return what went wrong, and the code."""
    search = partial(Optimisation, text.scenario, ranges, goal, seeds, trials, rest=rest)
    beyond = "A wider range may give a better value"
    path = folder / OPTIMISATION
    return search_and_save(text, path, "an optimisation", "optimise", beyond, search, force=force)


def search_and_save(
    text: ScenarioText,
    path: Path,
    subject: str,
    command: str,
    beyond: str,
    new: Callable[[], S],
    more: Callable[[S, xr.Dataset], More] = lambda *_: ([], []),
    *,
    force: bool,
) -> tuple[str, int]:
    """Search, save and draw what was found, and sum it up; return what went wrong, and the code.

    The ``path`` is that of its course, the ``subject`` its noun in messages. ``beyond`` is what to
    try where a number is at an end of its range. ``more`` returns further rows of the table, and
    notes.
    """
    with (
        finding(text.scenario, path, subject, force=force, others=[SUMMARY_JSON]) as found,
        Interruption() as interruption,
    ):
        with progress_bar() as bar, solvable():
            (task,) = bar.task_ids
            search = new()
            measure = search.goal.names[0]
            interruption.has_some = lambda: search.best is not None

            def report(done: int, total: int, least: float) -> None:
                best = f"{measure} {least:.4g}" if np.isfinite(least) else "limits not kept yet"
                reached = f"{done} of at most {total} trials, {best}" if done else ""
                words = "searching" if done else "compiling"
                bar.update(task, total=total, completed=done, description=words, reached=reached)

            search.run(report, interruption.stop)
        stopped = interruption.stop()
        if search.best is None:
            return f"no trial could be run: {search.runs.failure or search.why}", FAILED
        missed = search.missed()
        status = Status.OK.value
        if stopped:
            words = f"after {counted(len(search.trials), 'trial')}; the best so far is saved"
            status = "; ".join([f"{Status.INTERRUPTED} {words}", *missed])
        elif missed:
            status = f"no trial keeps all limits: {'; '.join(missed)}"
        words = f"numbers by `crinoid {command}`, for {measure}"
        summary = _summary(search, status)
        texts = {
            f"{command}d.toml": text.with_values(search.numbers(), words),
            SUMMARY_JSON: json.dumps(summary, indent=1, allow_nan=False),
        }
        data = search.dataset(status)
        notes = [f"a search without gradients: {search.why}"] if search.why else []
        if ends := ", ".join(summary["at_end"]):
            notes.append(f"at an end of its range: {ends}. {beyond}")
        if search.ended_early:
            notes.append("the search ended at its number of trials. More may give a better value")
        rows, others = more(search, data)
        table = optimisation_table(search, rows)
        found.show(data, table, notes=[*notes, *others], files=texts)
    return ("", 0) if status == Status.OK.value else (status, MISSED)


def optimisation_table(search: Optimisation, more: Sequence[Sequence[str]] = ()) -> Table:
    """Return the numbers and the measures, before and after, and other rows."""
    rows: list[Sequence[str]] = [
        (key, f"{given:.4g}", f"{best:.6g}")
        for (key, best), given in zip(search.numbers().items(), search.ranges.given, strict=True)
    ]
    assert search.given is not None
    assert search.best is not None
    before, after = search.given, search.best.found
    units = (plain_unit(each.unit) for each in search.goal.measures)
    unit = [f" ({each})" if each else "" for each in units]
    means = (_text(each[0].mean()) for each in (before, after))
    rows.append((f"{search.goal.names[0]}{unit[0]}", *means))
    for number, limit in enumerate(search.goal.limits, start=1):
        worst = (_text(max(limit.sign * x[number]) * limit.sign) for x in (before, after))
        rows.append((f"{limit}{unit[number]}", *worst))
    title = f"{search.scenario.title} ({search.method})"
    heads = ("", "before", "after", "without\ncontrol")
    rows += more
    count = max(map(len, rows))
    return new_table(title, heads[:count], [(*row, *[""] * (count - len(row))) for row in rows])


def _text(value: float) -> str:
    return f"{value:.4g}" if np.isfinite(value) else "-"


def _known(values: np.ndarray) -> list[float | None]:
    return [known(value) for value in values.tolist()]


def _summary(search: Optimisation, status: str) -> dict[str, Any]:
    """Return numbers, measures and limits, for other programs; SI units."""
    assert search.given is not None
    assert search.best is not None
    given = [float(value) for value in search.ranges.given]
    places = dict(zip(search.ranges.keys, search.best.point.tolist(), strict=True))
    return {
        "crinoid_version": __version__,
        "status": status,
        "method": search.method,
        "trials": len(search.trials),
        "seeds": search.seeds,
        "numbers": search.numbers(),
        "given": dict(zip(search.ranges.keys, given, strict=True)),
        "at_end": [key for key, place in places.items() if abs(place - round(place)) < 1e-3],
        "measures": {
            name: {"unit": measure.unit, "before": _known(before), "after": _known(after)}
            for name, measure, before, after in zip(
                search.goal.names, search.goal.measures, search.given, search.best.found,
                strict=True,
            )
        },
        "limits": [str(limit) for limit in search.goal.limits],
        "kept": not search.missed(),
    }  # fmt: skip
