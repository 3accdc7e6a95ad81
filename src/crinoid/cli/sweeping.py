"""Running a sweep: what is checked first, progress, what is said at the end, and estimates."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import xarray as xr
from rich.console import Console
from rich.progress import Progress

from crinoid.assembly.prepared import Prepared
from crinoid.cases import CASES
from crinoid.cli.checking import of_case
from crinoid.cli.crew import Hands, count_of, open_crew
from crinoid.cli.folder import claimed, clear
from crinoid.cli.interruption import Interruption
from crinoid.cli.lines import say_notes, say_written
from crinoid.cli.notes import notes_of_cases
from crinoid.cli.pages import page_beside
from crinoid.cli.progress import progress_bar
from crinoid.cli.sweep_table import estimate_table, sweep_table, worst_lines
from crinoid.cli.trial import time_run
from crinoid.plausibility import doubts
from crinoid.programs import keep_programs
from crinoid.scenario import Mistake, ScenarioError, counted
from crinoid.status import Status
from crinoid.sweep import PLAN, CrewError, Plan, SweepStore, has_zarr, run_batches

_MOST_TRIED = 1000
"""Values of a key that are tried before a sweep begins."""
_MOST_TOLD = 100
"""Structures of which is told what is odd."""
_MOST_FAILURES = 4
_NO_ZARR = "Zarr is not installed (pip install 'crinoid[sweep]'): the study is a netCDF file"
_GO_ON = "--resume goes on from there"


def run_sweep(
    plan: Plan,
    folder: Path,
    hands: Hands,
    *,
    sized: bool,
    resume: bool,
    force: bool,
    console: Console,
) -> str:
    """Run a sweep, collect and sum up its runs; return what went wrong, if anything.

    ``sized`` tells whether a user has chosen the size of batches.
    """
    store = SweepStore(folder)
    held = store.holds()
    known = resume and PLAN in held
    if known:
        plan = _same_plan(store.read_plan(), plan, folder, sized=sized)
    elif held and not force:
        text = f"{folder} holds {held[0]} already; takes another folder, --resume to go on with "
        raise ScenarioError([Mistake("--out", f"{text}a sweep, or --force to replace it")])
    say_notes(console, notes_of(plan))
    with claimed(folder):
        store.tidy()
        if not known:
            clear(folder, {}, force=force)
            store.begin(plan)
        done = store.finished(plan)
        with Interruption() as interruption:
            interruption.stop()  # from here on there is something to save
            try:
                with progress_bar(console) as bar:
                    if not _run(plan, store, hands, done, bar, interruption.stop):
                        return f"{Status.INTERRUPTED}: {_saved(plan, done)}"
                    bar.update(bar.task_ids[0], description="collecting", reached="")
                    data, files = store.collect(plan)
            except OSError as error:
                reason = f"{error.filename or folder}: {error.strerror or error}"
                return f"{reason}; {_saved(plan, done)}"
            except CrewError as error:
                return f"{error}; {_saved(plan, done)}"
    console.print(sweep_table(data))
    pages, lacking = page_beside(folder)
    say_notes(console, lacking if has_zarr() else [_NO_ZARR, *lacking])
    say_written(console, [*files, *pages])
    for line in worst_lines(plan, data, folder):
        console.print(line, soft_wrap=True)
    return _failures(data)


def estimate_sweep(plan: Plan, hands: Hands, console: Console) -> None:
    """Tell what a sweep would take, from a trial of its first run; write nothing."""
    say_notes(console, notes_of(plan))
    threads = count_of(hands)
    if hands.scheduler is not None:
        crew = open_crew(hands)
        threads = sum(crew.workers().values())
        crew.close()
    keep_programs()
    with console.status("timing the first run"):
        found = time_run(plan)
    console.print(estimate_table(plan, found, threads))


def notes_of(plan: Plan) -> list[str]:
    """Check a plan, and return what a user should know of it before it is run."""
    found = notes_of_cases(check_runs(plan))
    if plan.sampling in ("sobol", "saltelli") and plan.count.bit_count() > 1:
        found.append(f"--count: {plan.count} is no power of two, which Sobol points balance by")
    return found


def check_runs(plan: Plan) -> dict[str, list[str]]:
    """Check representative runs; return the notes on the first of each structure."""
    firsts = {int(runs[0]) for runs in plan.structures[:_MOST_TOLD]}
    odd = {}
    for run in plan.examples(_MOST_TRIED):
        with of_case("--vary", plan.values(run)):
            prepared = Prepared(plan.case(run))
            prepared.check()
        if run in firsts:
            odd[plan.name(run)] = doubts(prepared)
    return odd


def _run(
    plan: Plan,
    store: SweepStore,
    hands: Hands,
    done: set[int],
    bar: Progress,
    stop: Callable[[], bool],
) -> bool:
    """Run the batches that are missing, and tell whether all are there."""
    if len(done) == len(plan.batches):
        return True
    task = bar.task_ids[0]
    bar.update(task, description="starting")
    crew = open_crew(hands)

    def report(saved: int) -> None:
        if bar.tasks[0].total is None:  # the time left is that of what is run now
            bar.reset(task, total=plan.runs, completed=saved, description="sweep")
        bar.update(task, completed=saved, reached=f"{saved} of {plan.runs} runs")

    try:
        return run_batches(plan, store, crew, done, report, stop)
    finally:
        crew.close()


def _same_plan(earlier: Plan, plan: Plan, folder: Path, *, sized: bool) -> Plan:
    """Return the plan that is gone on with; refuse another one."""
    wanted = plan if sized else replace(plan, batch=earlier.batch)
    one, other = earlier.to_dict(), wanted.to_dict()
    differing = [key for key in one if one[key] != other[key]]
    if differing:
        text = f"the sweep in {folder} is of another plan ({', '.join(differing)} differ"
        text += f"{'s' if len(differing) == 1 else ''}); takes the same command, or another folder"
        raise ScenarioError([Mistake("--resume", text)])
    return earlier


def _saved(plan: Plan, done: set[int]) -> str:
    count = len(done)
    verb = "is" if count == 1 else "are"
    return f"{count} of {counted(len(plan.batches), 'batch', 'batches')} {verb} saved, {_GO_ON}"


def _failures(data: xr.Dataset) -> str:
    """Say which runs did not reach their end, and why."""
    status = data["status"].values
    wrong = [index for index, words in enumerate(status) if Status.of(words) is not Status.OK]
    if not wrong:
        return ""
    told = "; ".join(f"run {index + 1} {status[index]}" for index in wrong[:_MOST_FAILURES])
    left = len(wrong) - _MOST_FAILURES
    more = f"; {left} more {'is' if left == 1 else 'are'} in {CASES}" if left > 0 else ""
    return f"{len(wrong)} of {len(status)} runs did not reach their end: {told}{more}"
