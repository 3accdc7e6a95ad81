"""A run or an equilibrium: resumed if asked, saved, and summed up in a table."""

from collections.abc import Callable, Collection
from pathlib import Path

from crinoid.assembly.prepared import Prepared, at_rest
from crinoid.cli import display
from crinoid.cli.command import console
from crinoid.cli.finding import complete, page_in, require_one
from crinoid.cli.folder import check_replaced, claimed, clear, contains, place_for, save, stopped
from crinoid.cli.interruption import Interruption
from crinoid.foundation.status import Status
from crinoid.results.result import RESULT, Result, ResultError
from crinoid.scenario import Scenario, ScenarioError, refusal
from crinoid.scenario.scenario import AT_REST
from crinoid.simulation import Progress, SimulationError, Tell, play, settle


def run_scenario(scenario: Scenario, folder: Path, *, resume: bool, force: bool, full: bool) -> str:
    """Run a scenario of one case, save and sum it up; return what went wrong, if anything."""
    prepared = Prepared(scenario)
    prepared.check()
    with claimed(folder):
        doubted = display.say_doubts(prepared)
        if not force:
            check_replaced(folder, {"": scenario}, resume=resume)
        earlier = find_earlier(prepared, folder) if resume else None
        if earlier is not None and earlier.failure:
            text = f"the run in {folder} {earlier.failure.split(';')[0]}. It would fail there again"
            raise refusal("--resume", f"{text}; start a new run (omit --resume).")
        if earlier is not None and is_complete(earlier, scenario):
            _say_run(earlier, doubted, full=full)
            console.print(f"The run in {folder} is complete; nothing to resume.", soft_wrap=True)
            paths, lacking = complete(earlier, folder)
            display.say_notes(lacking)
            display.say_where(paths)
            return ""
        broken_off = (Status.INTERRUPTED, Status.UNFINISHED)
        if not resume and contains(folder, scenario, *broken_off):
            text = f"{folder} contains an interrupted run of this scenario. Use --resume to "
            display.say_notes([f"{text}continue it."])
        known = list(doubted)

        def tell(notes: list[str]) -> None:
            display.say_notes(notes)
            known.extend(notes)

        with Interruption() as interruption:
            with display.progress_bar() as bar:
                report = display.reporter(bar, "")
                played = play_case(prepared, earlier, folder, report, interruption.stop, tell)
            result, paths, unsaved = played
            if result is None:
                return unsaved
            if not unsaved:
                clear(folder, {"": scenario}, resume=resume, force=force)
            _say_run(result, known, full=full)
            pages, lacking = page_in(paths[0].parent) if paths else ([], [])
            display.say_notes(lacking)
            display.say_where(paths + pages)
        return unsaved or trouble(result, folder, paths)


def find_equilibrium(scenario: Scenario, folder: Path, *, force: bool) -> str:
    """Find the equilibrium of a scenario, save and sum it up; return what went wrong."""
    require_one(scenario, "an equilibrium")
    prepared = Prepared(at_rest(scenario))
    prepared.check()
    with claimed(folder):
        wanted = {"": prepared.scenario}
        if not force:
            check_replaced(folder, wanted, still=True)
        doubted = display.say_doubts(prepared, AT_REST)
        with Interruption() as interruption:
            try:
                result = settle(prepared)
            except SimulationError as error:
                result = error.result
            interruption.stop()
            paths, unsaved = save(result, folder, place_for(folder, prepared.scenario))
            if not unsaved:
                clear(folder, wanted, force=force)
            notes = [note for note in result.notes if note not in doubted]
            display.show(display.equilibrium_table(result), notes, [])
            display.say_where(paths)
    return unsaved or trouble(result, folder, paths)


def _say_run(result: Result, known: Collection[str], *, full: bool) -> None:
    notes = [note for note in result.notes if note not in known]
    other = [] if result.uncontrolled is None else result.uncontrolled.notes
    said = {display.words_of(note) for note in result.notes}
    notes += [f"without control: {note}" for note in other if display.words_of(note) not in said]
    display.show(display.run_table(result, full=full), notes, [])


def find_earlier(prepared: Prepared, folder: Path) -> Result | None:
    """Return the result to resume; None if the folder has none."""
    scenario, path = prepared.scenario, folder / RESULT
    if not path.exists():
        return None
    try:
        earlier = Result.load(folder, lazily=True)
        described = [run.scenario for run in (earlier, earlier.uncontrolled) if run is not None]
    except ResultError as error:
        raise refusal("--resume", str(error)) from error
    except ScenarioError as error:
        text = f"the scenario in {path} cannot be read: {error.lines[0]}"
        raise refusal("--resume", text) from error
    duration = scenario.simulation.duration
    for each in described:
        try:
            same = each.with_values({"simulation.duration": duration}) == scenario
        except ScenarioError:  # such as a table of motion that ends before that
            same = False
        if not same:
            keys = display.difference(earlier.dataset.attrs, scenario)
            text = f"the run in {folder} is of another scenario{keys}; only its duration may "
            raise refusal("--resume", f"{text}change. Choose another folder (--out).")
        if duration < each.simulation.duration:
            text = f"the run in {folder} already covers {each.simulation.duration} s"
            raise refusal("--resume", f"{text}; nothing to resume")
    now = prepared.digests
    changed = [file for file, digest in earlier.digests.items() if now.get(file, digest) != digest]
    if changed:
        text = f"{' and '.join(changed)} changed since the run in {folder} started. Restore the "
        raise refusal("--resume", f"{text}earlier content, or start a new run (omit --resume).")
    return earlier


def is_complete(earlier: Result, scenario: Scenario) -> bool:
    """Return whether an earlier result has all runs of a scenario up to their end."""
    runs = [earlier]
    if scenario.control.compared:
        if earlier.uncontrolled is None:
            return False
        runs.append(earlier.uncontrolled)
    end = scenario.simulation.duration - 0.5 * scenario.simulation.time_step
    return all(run.ended is Status.OK and float(run.dataset["time"][-1]) > end for run in runs)


def play_case(
    prepared: Prepared,
    earlier: Result | None,
    folder: Path,
    report: Callable[[Progress], None],
    stop: Callable[[], bool],
    tell: Tell | None = None,
) -> tuple[Result | None, list[Path], str]:
    """Run and save a scenario, or the rest of it.

    Return its result, none if nothing could be written; its files; and why they are not in its
    folder, if they are not.
    """
    place = place_for(folder, prepared.scenario)
    try:
        result = play(prepared, report=report, resume=earlier, stop=stop, tell=tell, into=place)
    except ResultError as error:
        raise refusal("--resume", f"the run in {folder}: {error}") from error
    except OSError as error:
        return None, [], stopped(error, place)
    return result, *save(result, folder, place)


def trouble(result: Result, folder: Path, paths: list[Path]) -> str:
    """Return what went wrong with a run, and in which other folder it is; empty if it is well."""
    aside = ""
    if paths and paths[0].parent != folder:
        aside = f"saved in {paths[0].parent}; the finished result in {folder} is kept"
    if result.failure:
        return f"{result.failure}; {aside}" if aside else result.failure
    if result.interrupted:
        ended = result if result.ended is Status.INTERRUPTED else result.uncontrolled
        assert ended is not None
        return f"{ended.status}; {aside or 'the run so far is saved, --resume continues it'}"
    return ""
