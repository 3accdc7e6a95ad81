"""Tuning a controller: progress of the search, the scenario with its new gains, and a table."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from crinoid.assembly.prepared import Prepared
from crinoid.cli.folder import check_own, claimed
from crinoid.cli.interruption import Interruption
from crinoid.cli.notes import say_doubts, say_notes
from crinoid.cli.progress import progress_bar
from crinoid.programs import keep_programs
from crinoid.replacement import replacing
from crinoid.report import write_report
from crinoid.scenario import Mistake, Scenario, ScenarioError
from crinoid.status import Status
from crinoid.tuning import TUNING
from crinoid.tuning.tuning import Tuning, check_tunable

TUNED = "tuned.toml"
_HEAD = "# gains by `crinoid tune`\n\n"


def tune_gains(
    scenario: Scenario, seeds: int, iterations: int, folder: Path, *, force: bool, console: Console
) -> str:
    """Search for gains, save and draw what was found, and sum it up; return what went wrong."""
    for name, value in (("--seeds", seeds), ("--iterations", iterations)):
        if value < 1:
            raise ScenarioError([Mistake(name, f"got {value}, takes a number of 1 or more")])
    check_tunable(scenario)
    keep_programs()
    prepared = Prepared(scenario)
    prepared.check()
    with claimed(folder):
        if not force:
            check_own(folder / TUNING)
        say_doubts(console, prepared)
        with Interruption() as interruption:
            with progress_bar(console) as bar:
                (task,) = bar.task_ids
                tuning = _built(scenario, seeds, iterations)

                def report(done: int, total: int, least: float) -> None:
                    reached = f"{done} of {total}, root of cost {1e3 * least**0.5:.3g} mm"
                    bar.update(
                        task, total=total, completed=done, description="tuning", reached=reached
                    )

                def stop() -> bool:
                    # before anything could be run there is nothing to save: heard at once
                    return bool(np.isfinite(tuning.least)) and interruption.stop()

                tuning.run(report, stop)
                stopped = interruption.stop()
                if np.isfinite(tuning.least) and not stopped:
                    tuning.hold_out(interruption.stop)
            stopped = interruption.stop()
            if not np.isfinite(tuning.least):
                return (
                    f"{tuning.failure}; no start could be run; try a smaller simulation.time_step"
                )
            _save(tuning, folder)
            figures = write_report(folder / TUNING)
            console.print(tuning_table(tuning))
            say_notes(console, _notes(tuning))
            for each in (folder / TUNED, folder / TUNING, *figures):
                console.print(f"wrote {each}", soft_wrap=True)
    if stopped:
        words = f"after {int(tuning.tried.sum())} trials; the best gains so far are saved"
        return f"{Status.INTERRUPTED} {words}"
    return ""


def _built(scenario: Scenario, seeds: int, iterations: int) -> Tuning:
    try:
        return Tuning(scenario, seeds, iterations)
    except RuntimeError as error:  # no equilibrium to start from
        raise ScenarioError([Mistake("", str(error))]) from error


def _save(tuning: Tuning, folder: Path) -> None:
    with replacing(folder / TUNED) as temporary:
        temporary.write_text(_HEAD + tuning.tuned().to_toml(), "utf-8")
    with replacing(folder / TUNING) as temporary:
        tuning.dataset().to_netcdf(temporary, engine="netcdf4")


def tuning_table(tuning: Tuning) -> Table:
    """Sum up a search: gains, and costs in draws that were not tuned for, before and after."""
    table = Table(title=tuning.scenario.title, title_justify="left")
    for name in ("", "before", "after"):
        table.add_column(name, justify="right" if name else "left")
    data = tuning.dataset()
    for name, given, tuned in zip(
        data["gain"].values, data["given"].values, data["tuned"].values, strict=True
    ):
        table.add_row(str(name), f"{given:.4g}", f"{tuned:.4g}")
    words = "other draws" if tuning.random else "the run"
    before, after = (np.sqrt(np.mean(data[name].values)) for name in ("before", "after"))
    table.add_row(f"root of cost, {words}", *map(_length, (before, after)))
    before, after = (
        np.sqrt(np.mean(data[f"{name}_error"].values ** 2)) for name in ("before", "after")
    )
    table.add_row(f"tip error, RMS, {words}", *map(_length, (before, after)))
    return table


def _length(value: float) -> str:
    return "-" if np.isnan(value) else f"{1e3 * value:.4g} mm"


def _notes(tuning: Tuning) -> list[str]:
    notes = []
    if not tuning.random:
        notes.append("nothing in this scenario is random: all seeds give the same run")
    lost = int(np.isnan(tuning.cost[:, 0]).sum())
    if lost:
        notes.append(f"{lost} of {len(tuning.cost)} starts could not be run: {tuning.failure}")
    worse = tuning.held_out and tuning.held_out["after"].mean() > tuning.held_out["before"].mean()
    if worse and tuning.random:
        notes.append("in draws that were not tuned for it is worse: take more --seeds")
    return notes
