"""Running and saving, with progress while it lasts and a table when it is over."""

from collections.abc import Collection
from pathlib import Path

from rich.console import Console

from crinoid.assembly.prepared import Prepared
from crinoid.cli.attempt import attempt, find_earlier, is_complete, trouble
from crinoid.cli.folder import (
    check_replaced,
    claimed,
    clear,
    interrupted,
    place_for,
    save,
    say_where,
    stopped,
)
from crinoid.cli.interruption import Interruption
from crinoid.cli.lines import say_notes
from crinoid.cli.notes import say_doubts
from crinoid.cli.pages import page_beside
from crinoid.cli.progress import progress_bar, reporter
from crinoid.cli.study import run_study
from crinoid.cli.tables import equilibrium_table, run_table
from crinoid.plausibility import AT_REST
from crinoid.programs import keep_programs
from crinoid.result import Result
from crinoid.scenario import Mistake, Scenario, ScenarioError
from crinoid.simulation import SimulationError, at_rest, settle


def run_scenario(
    scenario: Scenario, folder: Path, *, resume: bool, force: bool, console: Console
) -> str:
    """Run a scenario, save it and show what came of it; return what went wrong, if anything."""
    keep_programs()
    if scenario.vary:
        return run_study(scenario, folder, resume=resume, force=force, console=console)
    prepared = Prepared(scenario)
    prepared.check()
    with claimed(folder):
        doubted = say_doubts(console, prepared)
        return _run_case(prepared, folder, doubted, resume=resume, force=force, console=console)


def _run_case(
    prepared: Prepared,
    folder: Path,
    doubted: Collection[str],
    *,
    resume: bool,
    force: bool,
    console: Console,
) -> str:
    scenario = prepared.scenario
    wanted = {"": scenario}
    if not force:
        check_replaced(folder, wanted, resume=resume)
    earlier = find_earlier(prepared, folder) if resume else None
    if earlier is not None and earlier.failure:
        text = f"the run in {folder} {earlier.failure.split(';')[0]}: it would fail there again"
        raise ScenarioError([Mistake("--resume", text)])
    if earlier is not None and is_complete(earlier, scenario):
        _say_run(console, earlier, doubted)
        console.print(f"the run in {folder} is complete: nothing to go on with", soft_wrap=True)
        return ""
    if not resume and interrupted(folder, scenario):
        text = f"{folder} holds an interrupted run of this scenario; --resume would go on with it"
        say_notes(console, [text])
    told = list(doubted)

    def tell(notes: list[str]) -> None:
        say_notes(console, notes)
        told.extend(notes)

    with Interruption() as interruption:
        with progress_bar(console) as bar:
            report, stop, place = reporter(bar, ""), interruption.stop, place_for(folder, scenario)
            try:
                result = attempt(prepared, earlier, folder, report, stop, tell, place)
            except OSError as error:
                return stopped(error, place)
            paths, unsaved = save(result, folder, place)
        if not unsaved:
            clear(folder, wanted, resume=resume, force=force)
        _say_run(console, result, told)
        pages, lacking = page_beside(paths[0].parent) if paths else ([], [])
        say_notes(console, lacking)
        say_where(console, paths + pages)
    return unsaved or trouble(result, folder, paths)


def find_equilibrium(scenario: Scenario, folder: Path, *, force: bool, console: Console) -> str:
    """Find the equilibrium of a scenario, save and show it; return what went wrong, if anything."""
    keep_programs()
    if scenario.vary:
        text = "an equilibrium is that of one case; give its values with --set and leave out vary"
        raise ScenarioError([Mistake("vary", text)])
    prepared = Prepared(at_rest(scenario))
    prepared.check()
    with claimed(folder):
        wanted = {"": prepared.scenario}
        if not force:
            check_replaced(folder, wanted, still=True)
        doubted = say_doubts(console, prepared, AT_REST)
        with Interruption() as interruption:
            try:
                result = settle(prepared)
            except SimulationError as error:
                result = error.result
            interruption.stop()
            paths, unsaved = save(result, folder, place_for(folder, prepared.scenario))
            if not unsaved:
                clear(folder, wanted, force=force)
            console.print(equilibrium_table(result))
            say_notes(console, [note for note in result.notes if note not in doubted])
            say_where(console, paths)
    return unsaved or trouble(result, folder, paths)


def _say_run(console: Console, result: Result, doubted: Collection[str]) -> None:
    console.print(run_table(result))
    say_notes(console, [note for note in result.notes if note not in doubted])
    if result.uncontrolled is not None:
        apart = [note for note in result.uncontrolled.notes if note not in result.notes]
        say_notes(console, [f"without control: {note}" for note in apart])
