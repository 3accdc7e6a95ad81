"""Running and saving, with progress while it lasts and a table when it is over."""

from __future__ import annotations

import csv
import gc
import os
import tempfile
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import jax
import platformdirs
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from crinoid.cli.tables import cases_table, equilibrium_table, run_table
from crinoid.metrics import deflection, settling_time, tip_error
from crinoid.plausibility import AT_REST, doubts
from crinoid.result import RESULT, Result, ResultError
from crinoid.scenario import Mistake, Scenario, ScenarioError, shown
from crinoid.simulation import Progress as Reached
from crinoid.simulation import SimulationError, check_room, equilibrium, play

CASES = "cases.csv"
_KEPT_COMPILED = 16
"""Cases after which compiled code is let go: where they differ in shape each holds some 2000 of the
65530 memory maps that Linux gives a process, which crashes without more."""
_MOST_NOTES = 6


def run_scenario(scenario: Scenario, folder: Path, *, resume: bool, console: Console) -> str:
    """Run a scenario, save it and show what came of it; return what went wrong, if anything."""
    keep_compiled_code()
    check(scenario, Scenario.notes, check_room)
    make(folder)
    told = say_doubts(console, scenario)
    if scenario.vary:
        return _run_cases(scenario, folder, told, resume=resume, console=console)
    earlier = _earlier(scenario, folder) if resume else None
    if earlier is not None and earlier.failure:
        text = f"the run in {folder} {earlier.failure.split(';')[0]}: it would fail there again"
        raise ScenarioError([Mistake("--resume", text)])
    with _bar(console) as bar:
        result = _play(scenario, _reporter(bar, ""), earlier, folder)
        paths = result.save(folder)
    console.print(run_table(result))
    say_notes(console, [note for note in result.notes if note not in told])
    if result.uncontrolled is not None:
        apart = [note for note in result.uncontrolled.notes if note not in result.notes]
        say_notes(console, [f"without control: {note}" for note in apart])
    _say_where(console, paths)
    return _trouble(result)


def find_equilibrium(scenario: Scenario, folder: Path, *, console: Console) -> str:
    """Find the equilibrium of a scenario, save and show it; return what went wrong, if anything."""
    keep_compiled_code()
    if scenario.vary:
        text = "an equilibrium is that of one case; give its values with --set and leave out vary"
        raise ScenarioError([Mistake("vary", text)])
    check(scenario, Scenario.notes, check_room)
    make(folder)
    told = say_doubts(console, scenario, AT_REST)
    try:
        result = equilibrium(scenario)
    except SimulationError as error:
        result = error.result
    paths = result.save(folder)
    console.print(equilibrium_table(result))
    say_notes(console, [note for note in result.notes if note not in told])
    _say_where(console, paths)
    return _trouble(result)


def keep_compiled_code() -> None:
    """Keep compiled code in the user's own cache folder, so that the next start is faster.

    Programs are read back and run from there: nobody else may write to it.
    """
    if "JAX_COMPILATION_CACHE_DIR" in os.environ:
        return
    folder = platformdirs.user_cache_path("crinoid") / "compiled"
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        folder.chmod(0o700)
    except OSError:
        return  # a read-only home: compile anew every time
    jax.config.update("jax_compilation_cache_dir", str(folder))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
    jax.config.update("jax_compilation_cache_max_size", 500_000_000)


def check(scenario: Scenario, *checks: Callable[[Scenario], object]) -> None:
    """Check every case of a scenario (its files, its room), before anything is written or run."""
    cases = scenario.cases()
    while cases:
        values, case = cases.pop(0)  # a case keeps what it has read
        try:
            for look in checks:
                look(case)
        except ScenarioError as error:
            if not values:
                raise
            told = ", ".join(f"{key} = {shown(value)}" for key, value in values.items())
            mistakes = [Mistake("vary", f"case {told}: {mistake}") for mistake in error.mistakes]
            raise ScenarioError(mistakes) from error


def say_doubts(console: Console, scenario: Scenario, tables: Collection[str] = ()) -> list[str]:
    """Show what is odd about a scenario before it is run, about its cases each thing once.

    Returns what was told of any case.
    """
    told: dict[str, list[str]] = {}
    cases = scenario.cases()
    count = len(cases)
    for number in range(1, count + 1):
        _, case = cases.pop(0)  # a case keeps what it has read
        for doubt in doubts(case, tables):
            told.setdefault(doubt, []).append(_case_name(number, count))
    say_notes(console, _of_cases(told) if scenario.vary else list(told))
    return list(told)


def say_notes(console: Console, notes: list[str]) -> None:
    """Show notes, a paragraph each."""
    for note in notes:
        console.print(f"note: {note}", soft_wrap=True)


def make(folder: Path) -> None:
    """Make a folder that can be written to, before time is spent on what should go there."""
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryFile(dir=folder):
        pass


def _run_cases(
    scenario: Scenario, folder: Path, doubted: list[str], *, resume: bool, console: Console
) -> str:
    cases = scenario.cases()
    count = len(cases)
    rows: list[dict[str, Any]] = []
    failures = []
    told: dict[str, list[str]] = {}
    with _bar(console) as bar:
        for number in range(1, count + 1):
            values, case = cases.pop(0)  # a case keeps what it has read
            name = _case_name(number, count)
            earlier = _earlier(case, folder / name) if resume else None
            label = f"{number}/{count} "
            if earlier is not None and earlier.failure:
                result = earlier  # it would fail there again
            else:
                result = _play(case, _reporter(bar, label), earlier, folder / name)
                result.save(folder / name)
            for note in result.notes:
                if note not in doubted:
                    told.setdefault(note, []).append(name)
            rows.append(_row(name, values, result))
            _write_cases(folder / CASES, rows)
            if number % _KEPT_COMPILED == 0:
                jax.clear_caches()
                gc.collect()
            if _trouble(result):
                failures.append(f"{name}: {_trouble(result)}")
            if result.interrupted:
                break
    console.print(cases_table(scenario, rows))
    say_notes(console, _of_cases(told))
    _say_where(console, [folder / CASES])
    if result.interrupted:
        return f"interrupted in {name}; --resume goes on from there"
    return "; ".join(failures)


def _case_name(number: int, count: int) -> str:
    return f"case-{number:0{max(2, len(str(count)))}d}"


def _of_cases(told: dict[str, list[str]]) -> list[str]:
    """Return the notes of a study's cases, each one once; not all of them where there are many."""
    notes = [
        f"{first}{f' and {len(others)} more' if others else ''}: {note}"
        for note, (first, *others) in told.items()
    ]
    left = len(notes) - _MOST_NOTES
    return notes if left <= 0 else [*notes[:_MOST_NOTES], f"{left} more in the cases' results"]


def _row(name: str, values: dict[str, Any], result: Result) -> dict[str, Any]:
    settled, free = settling_time(result), deflection(result)
    other = result.uncontrolled
    return {
        "case": name,
        **values,
        "deflection": "" if free is None else free,
        "steady_error": tip_error(result).steady,
        "rms_error": tip_error(result).rms,
        "rms_error_uncontrolled": "" if other is None else tip_error(other).rms,
        "settling_time": "" if settled is None else settled,
        "status": _trouble(result) or "ok",
        "directory": name,
    }


def _write_cases(path: Path, rows: list[dict[str, Any]]) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)


def _earlier(scenario: Scenario, folder: Path) -> Result | None:
    """Find the result to go on from; none where there is nothing yet."""
    if not (folder / RESULT).exists():
        return None
    try:
        earlier = Result.load(folder)
        described = earlier.scenario
    except ResultError as error:
        raise ScenarioError([Mistake("--resume", str(error))]) from error
    except ScenarioError as error:
        text = f"the scenario in {folder / RESULT} cannot be read: {error.lines[0]}"
        raise ScenarioError([Mistake("--resume", text)]) from error
    duration = scenario.simulation.duration
    if duration < described.simulation.duration:
        text = f"the run in {folder} is of {described.simulation.duration} s already"
        raise ScenarioError([Mistake("--resume", text)])
    longer = {"simulation.duration": duration}
    if described.with_values(longer) != scenario:
        text = f"the run in {folder} is of another scenario; only its duration may be changed"
        raise ScenarioError([Mistake("--resume", text)])
    return earlier


def _play(scenario: Scenario, report: Any, earlier: Result | None, folder: Path) -> Result:
    try:
        return play(scenario, report=report, resume=earlier)
    except ResultError as error:
        raise ScenarioError([Mistake("--resume", f"the run in {folder}: {error}")]) from error


def _trouble(result: Result) -> str:
    if result.failure:
        return result.failure
    if result.interrupted:
        stopped = result if result.status.startswith("interrupted") else result.uncontrolled
        assert stopped is not None
        return f"{stopped.status}; what there is has been saved, --resume goes on from there"
    return ""


def _say_where(console: Console, paths: list[Path]) -> None:
    for path in paths:
        console.print(f"wrote {path}", soft_wrap=True)
    console.print(f"figures: crinoid report {paths[0].parent}", soft_wrap=True)


@contextmanager
def _bar(console: Console) -> Iterator[Progress]:
    with Progress(
        TextColumn("{task.description:>14}"),
        BarColumn(),
        TextColumn("{task.fields[reached]}"),
        TimeRemainingColumn(),
        console=console,
        transient=True,
    ) as bar:
        bar.add_task("compiling", total=None, reached="")
        yield bar


def _reporter(bar: Progress, prefix: str) -> Any:
    """Make the callback that moves the bar: simulated time, speed and time left."""
    task = bar.task_ids[0]
    label = ""

    def report(reached: Reached) -> None:
        nonlocal label
        if reached.label != label:
            label = reached.label
            bar.reset(task, total=reached.duration, description=f"{prefix}{label}")
        speed = reached.time / reached.elapsed
        text = f"{reached.time:.1f} of {reached.duration:g} s, {speed:.0f} x real time"
        bar.update(task, completed=reached.time, reached=text)

    return report
