"""A study: the cases of a scenario one after the other, and a table of them."""

import csv
import math
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import pandas as pd

from crinoid.assembly.prepared import Prepared
from crinoid.cli import display
from crinoid.cli.finding import checked_runs, complete, page_in
from crinoid.cli.folder import check_replaced, claimed, clear, contains
from crinoid.cli.interruption import Interrupted, Interruption
from crinoid.cli.run import find_earlier, is_complete, play_case, trouble
from crinoid.cli.seed_means import SeedTables
from crinoid.compilation import make_room
from crinoid.diagnostics.plausibility import plausibility_warnings
from crinoid.foundation.status import Status
from crinoid.results.metrics import (
    CASES,
    Measure,
    known,
    measured,
    measures_of,
    read_rows,
    write_rows,
)
from crinoid.results.result import Result
from crinoid.scenario import Scenario, ScenarioError
from crinoid.simulation import Progress
from crinoid.studies.design import Design

_MOST_HELD = 20_000_000  # numbers that cases keep in memory at most from their check to their run
_OF_A_SYSTEM = 10_000  # numbers that need as much memory as a system


def run_study(scenario: Scenario, folder: Path, *, resume: bool, force: bool) -> str:
    """Run the cases of a scenario, save and compare them; return what went wrong, if anything.

    They are the runs of a sweep, in this process and with whole results. All are checked before
    anything is written. A case that fails or is refused then does not stop the others.
    """
    plan = Design.of_vary(scenario)
    odd: dict[str, list[str]] = {}
    cases: dict[str, Scenario] = {}
    ready: dict[str, Prepared] = {}
    held = 0
    for name, prepared in checked_runs(plan, range(1, plan.runs + 1), "vary"):
        odd[name], cases[name] = plausibility_warnings(prepared), prepared.scenario
        held += _OF_A_SYSTEM + prepared.count
        if held <= _MOST_HELD:  # the others are read again: all would fill the memory
            ready[name] = prepared
    with claimed(folder):
        display.say_notes(display.notes_of_cases(odd))
        doubted = {doubt for each in odd.values() for doubt in each}
        return _run_cases(plan, cases, ready, folder, doubted, resume=resume, force=force)


def _run_cases(
    plan: Design,
    cases: dict[str, Scenario],
    ready: dict[str, Prepared],
    folder: Path,
    doubted: Collection[str],
    *,
    resume: bool,
    force: bool,
) -> str:
    registry = measures_of(plan.scenario)
    if not force:
        check_replaced(folder, cases, resume=resume)
    rows = _earlier_rows(plan, folder, cases)  # each is kept until its case is run again
    notes: dict[str, list[str]] = {}
    failures: list[str] = []
    ended = ""
    with Interruption() as interruption, display.progress_bar() as bar:
        for number, (name, case) in enumerate(cases.items(), start=1):
            try:
                if interruption.release():
                    raise Interrupted
                prepared = ready.pop(name, None) or Prepared(case)
                report = display.reporter(bar, f"{number}/{len(cases)} ")
                run = _play(prepared, folder / name, report, interruption.stop, resume=resume)
                interruption.stop()  # from here on the case has its row in the table
            except Interrupted:
                if not notes:
                    raise
                ended = f"interrupted before {name}; --resume goes on from there"
                break
            if not run.directory:
                ended = f"{name}: {run.wrong}"
                break
            if run.directory == name or name not in rows:
                status = run.wrong or Status.OK.value
                numbers = {**dict.fromkeys(registry), **run.measures}
                rows[name] = plan.row(number, numbers, status, run.directory)
            table = [rows[each] for each in cases if each in rows]
            of_run = run.result.notes if run.result else []
            notes[name] = [*(note for note in of_run if note not in doubted), *run.lacking]
            if run.wrong:
                failures.append(f"{name}: {run.wrong}")
            try:
                write_rows(folder / CASES, table)
            except OSError as error:
                text = f"{folder / CASES}: {error.strerror or error}"
                ended = f"{text}; the cases are saved, --resume goes on and writes their table"
                break
            if number == 1:
                clear(folder, cases, resume=resume, force=force)
            if run.result is not None and run.result.interrupted:
                ended = f"interrupted in {name}; --resume goes on from there"
                if run.directory != name:
                    ended += f"; the case so far is in {folder / run.directory}, "
                    ended += "its finished result is kept"
                break
            make_room()
    if notes:
        printed = display.cases_table(plan.scenario.title, plan.keys, table, registry)
        means = _means(plan, rows, registry)
        written = means.show([printed], folder, display.notes_of_cases(notes))
        display.say_where([folder / CASES, *written])
    return ended or display.listed(failures, CASES)


def _means(
    plan: Design, rows: Mapping[str, Mapping[str, Any]], registry: Mapping[str, Measure]
) -> SeedTables:
    """Return means of the runs that reached their end."""
    done = {run: rows[name] for run in range(1, plan.runs + 1) if (name := plan.name(run)) in rows}
    runs = [run for run, row in done.items() if Status.of(row["status"]) is Status.OK]
    table = pd.DataFrame([done[run] for run in runs], columns=list(registry)).replace("", math.nan)
    numbers = {name: table[name].to_numpy(float) for name in registry}
    return SeedTables(plan, runs, numbers)


class _CaseRun(NamedTuple):
    result: Result | None  # none if the case was refused, or could not be written
    wrong: str
    directory: str  # name of the folder with all of it; empty if it could not be saved
    lacking: Sequence[str] = ()  # notes of a page that could not be written
    measures: Mapping[str, float | None] = MappingProxyType({})
    """The measures of the run; none of a case that was refused."""


def _play(
    prepared: Prepared,
    folder: Path,
    report: Callable[[Progress], None],
    stop: Callable[[], bool],
    *,
    resume: bool,
) -> _CaseRun:
    """Run a case, or the rest of it."""
    earlier = find_earlier(prepared, folder) if resume else None
    done = earlier is not None and (earlier.failure or is_complete(earlier, prepared.scenario))
    try:
        if earlier is not None and done:
            _, lacking = complete(earlier, folder)
            wrong = trouble(earlier, folder, [])
            return _CaseRun(earlier, wrong, folder.name, lacking, _measures(earlier))
        result, paths, unsaved = play_case(prepared, earlier, folder, report, stop)
        if unsaved or result is None:
            return _CaseRun(result, unsaved, "")
        found, place = _measures(result), paths[0].parent
    except ScenarioError as error:
        return _CaseRun(None, f"refused: {'; '.join(error.lines)}", folder.name)
    return _CaseRun(result, trouble(result, folder, paths), place.name, page_in(place)[1], found)


def _measures(result: Result) -> dict[str, float | None]:
    return {name: known(value) for name, value in measured(result).numbers.items()}


def _earlier_rows(
    plan: Design, folder: Path, cases: Mapping[str, Scenario]
) -> dict[str, dict[str, Any]]:
    """Return the rows of an earlier table whose results are there and of the same cases."""
    found: dict[str, dict[str, Any]] = {}
    registry = measures_of(plan.scenario)
    try:
        there = {row.get("case"): row for row in read_rows(folder / CASES)[1]}
    except (OSError, ValueError, csv.Error):  # none, or one that somebody changed
        return found
    for run, (name, case) in enumerate(cases.items(), start=1):
        row = there.get(name, {})
        columns = {"case", *plan.keys, *registry, "status", "directory"}
        if set(row) != columns or row["directory"] != name:
            continue
        status = row["status"]
        if Status.of(status) is not Status.INTERRUPTED and contains(folder / name, case):
            with suppress(ValueError):
                numbers = {key: float(row[key]) if row[key] else None for key in registry}
                found[name] = plan.row(run, numbers, status, name)
    return found
