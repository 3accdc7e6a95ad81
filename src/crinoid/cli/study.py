"""A study: the cases of a scenario one after the other, and a table of them."""

import csv
from collections.abc import Callable, Collection, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from rich.console import Console

from crinoid.assembly.prepared import Prepared
from crinoid.batch import measures
from crinoid.cases import CASES, COLUMNS, MEASURES, case_name, is_table, read_rows, write_rows
from crinoid.cli.attempt import attempt, find_earlier, is_complete, trouble
from crinoid.cli.checking import of_case
from crinoid.cli.folder import (
    check_replaced,
    claimed,
    clear,
    holds,
    place_for,
    save,
    say_where,
    stopped,
)
from crinoid.cli.interruption import Interrupted, Interruption
from crinoid.cli.lines import say_notes
from crinoid.cli.notes import notes_of_cases
from crinoid.cli.pages import page_beside
from crinoid.cli.progress import progress_bar, reporter
from crinoid.cli.tables import cases_table
from crinoid.plausibility import doubts
from crinoid.programs import make_room
from crinoid.report.page.file import PAGE, is_page
from crinoid.result import Result
from crinoid.scenario import Scenario, ScenarioError
from crinoid.simulation import Progress
from crinoid.status import Status

_MOST_FAILURES = 4
_MOST_HELD = 20_000_000
"""Numbers that cases hold at most from their check to their run."""
_OF_A_SYSTEM = 10_000
"""Numbers that take as much memory as a system."""


def run_study(
    scenario: Scenario, folder: Path, *, resume: bool, force: bool, console: Console
) -> str:
    """Run the cases of a scenario, save and compare them; return what went wrong, if anything.

    All are checked before anything is written. A case that fails or is refused then does not keep
    the others from being run.
    """
    cases = scenario.cases()
    names = [case_name(number, len(cases)) for number in range(1, len(cases) + 1)]
    odd: dict[str, list[str]] = {}
    ready: dict[str, Prepared] = {}
    held = 0
    for name, (values, case) in zip(names, cases, strict=True):
        prepared = Prepared(case)
        odd[name] = _checked(values, prepared)
        held += _OF_A_SYSTEM + prepared.count
        if held <= _MOST_HELD:  # what others read is read again: all would fill the memory
            ready[name] = prepared
    with claimed(folder):
        say_notes(console, notes_of_cases(odd))
        doubted = {doubt for each in odd.values() for doubt in each}
        return _run_cases(
            scenario, cases, ready, folder, doubted, resume=resume, force=force, console=console
        )


def _checked(values: dict[str, Any], prepared: Prepared) -> list[str]:
    """Check the files and the room of a case; return what is odd about it."""
    with of_case("vary", values):
        prepared.check()
        return doubts(prepared)


def _run_cases(
    scenario: Scenario,
    cases: list[tuple[dict[str, Any], Scenario]],
    ready: dict[str, Prepared],
    folder: Path,
    doubted: Collection[str],
    *,
    resume: bool,
    force: bool,
    console: Console,
) -> str:
    names = [case_name(number, len(cases)) for number in range(1, len(cases) + 1)]
    wanted = {name: case for name, (_, case) in zip(names, cases, strict=True)}
    if not force:
        check_replaced(folder, wanted, resume=resume)
    # until a case is run again, what is known of it stays
    rows = _earlier_rows(folder, wanted, {n: v for n, (v, _) in zip(names, cases, strict=True)})
    done: set[str] = set()
    told: dict[str, list[str]] = {}
    failures: list[str] = []
    ended = ""
    with Interruption() as interruption, progress_bar(console) as bar:
        for number, (values, case) in enumerate(cases, start=1):
            name = names[number - 1]
            try:
                if interruption.release():
                    raise Interrupted
                report = reporter(bar, f"{number}/{len(cases)} ")
                run = _Run(ready.pop(name, Prepared(case)), folder / name, resume)
                result, wrong = run.play(report, interruption.stop)
                interruption.stop()  # from here on the case has its row in the table
            except Interrupted:
                if not done:
                    raise
                ended = f"interrupted before {name}; --resume goes on from there"
                break
            if not run.saved:
                ended = f"{name}: {wrong}"
                break
            if run.directory == name or name not in rows:
                rows[name] = _row(name, values, result, wrong) | {"directory": run.directory}
            done.add(name)
            table = [rows[each] for each in names if each in rows]
            notes = [note for note in (result.notes if result else []) if note not in doubted]
            told[name] = [*notes, *run.lacking]
            if wrong:
                failures.append(f"{name}: {wrong}")
            try:
                write_rows(folder / CASES, table)
            except OSError as error:
                text = f"{folder / CASES}: {error.strerror or error}"
                ended = f"{text}; the cases are saved, --resume goes on and writes their table"
                break
            if number == 1:
                clear(folder, wanted, resume=resume, force=force)
            if result is not None and result.interrupted:
                ended = f"interrupted in {name}; --resume goes on from there"
                if run.directory != name:
                    ended += f"; what there is of it is in {folder / run.directory}, "
                    ended += "its finished result stays"
                break
            make_room()
    if done:
        console.print(cases_table(scenario, table))
        pages, lacking = page_beside(folder)
        say_notes(console, [*notes_of_cases(told), *lacking])
        say_where(console, [folder / CASES, *pages])
    return ended or _listed(failures)


class _Run:
    """One case, and whether all of it is in its folder."""

    def __init__(self, prepared: Prepared, folder: Path, resume: bool) -> None:
        self.prepared, self.folder, self.resume = prepared, folder, resume
        self.saved = True
        self.directory = folder.name
        self.lacking: list[str] = []
        """Notes of a page that could not be written."""

    def play(
        self, report: Callable[[Progress], None], stop: Callable[[], bool]
    ) -> tuple[Result | None, str]:
        """Return its result, none if it is refused, and what went wrong."""
        prepared = self.prepared
        earlier = find_earlier(prepared, self.folder) if self.resume else None
        if earlier is not None and (earlier.failure or is_complete(earlier, prepared.scenario)):
            if not is_page(self.folder / PAGE):
                _, self.lacking = page_beside(self.folder)
            return earlier, trouble(earlier, self.folder, [])
        place = place_for(self.folder, prepared.scenario)
        try:
            result = attempt(prepared, earlier, self.folder, report, stop, into=place)
        except ScenarioError as error:
            return None, f"refused: {'; '.join(error.lines)}"
        except OSError as error:
            self.saved = False
            return None, stopped(error, place)
        paths, wrong = save(result, self.folder, place)
        self.saved = not wrong
        if self.saved:
            self.directory = paths[0].parent.name
            _, self.lacking = page_beside(paths[0].parent)
        return result, wrong or trouble(result, self.folder, paths)


def _row(name: str, values: dict[str, Any], result: Result | None, wrong: str) -> dict[str, Any]:
    row: dict[str, Any] = dict.fromkeys(MEASURES, "")
    if result is not None:
        found = {name: measures.MEASURES[name].of(result) for name in MEASURES}
        row |= {name: value for name, value in found.items() if value is not None}
    return {"case": name, **values, **row, "status": wrong or Status.OK.value}


def _earlier_rows(
    folder: Path, wanted: Mapping[str, Scenario], values: Mapping[str, dict[str, Any]]
) -> dict[str, dict[str, Any]]:
    """Return the rows of an earlier table whose results are there and of the same cases."""
    found: dict[str, dict[str, Any]] = {}
    if not is_table(folder / CASES):
        return found
    try:
        _, rows = read_rows(folder / CASES)
    except (OSError, ValueError, csv.Error):  # a table that somebody changed
        return found
    for row in rows:
        name, directory = row["case"], row["directory"]
        if name not in wanted or directory != name or set(row) != {*COLUMNS, *values[name]}:
            continue
        if Status.of(row["status"]) is Status.INTERRUPTED or not holds(folder / name, wanted[name]):
            continue
        with suppress(ValueError):
            numbers = {key: float(row[key]) if row[key] else "" for key in MEASURES}
            found[name] = row | values[name] | numbers
    return found


def _listed(failures: list[str]) -> str:
    left = len(failures) - _MOST_FAILURES
    more = [f"{left} more {'is' if left == 1 else 'are'} in {CASES}"] if left > 0 else []
    return "; ".join([*failures[:_MOST_FAILURES], *more])
