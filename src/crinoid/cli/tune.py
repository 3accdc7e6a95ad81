"""Tuning a controller: progress of the search, the scenario with its new gains, and a table."""

from pathlib import Path

import numpy as np
import xarray as xr
from rich.console import Console
from rich.table import Table

from crinoid.cli.finding import place_of, prepare_one, save_finding
from crinoid.cli.interruption import Interruption
from crinoid.cli.lines import say_notes, say_written
from crinoid.cli.notes import say_doubts
from crinoid.cli.progress import progress_bar
from crinoid.replacement import replacing
from crinoid.report.units import DEGREES, si_unit
from crinoid.scenario import Mistake, Scenario, ScenarioError
from crinoid.status import Status
from crinoid.tuning import TUNING
from crinoid.tuning.design import tuned_numbers
from crinoid.tuning.tuning import MARGINS, Tuning

TUNED = "tuned.toml"
_HEAD = "# by `crinoid tune`\n\n"


def tune_controller(
    scenario: Scenario,
    seeds: int,
    iterations: int,
    margin: float,
    folder: Path,
    *,
    force: bool,
    console: Console,
) -> str:
    """Search, save and draw what was found, and sum it up; return what went wrong."""
    if not 0 <= margin < 1:
        text = f"got {margin:g}, takes a number from 0 (none) to below 1"
        raise ScenarioError([Mistake("--margin", text)])
    for name, value in (("--seeds", seeds), ("--iterations", iterations)):
        if value < 1:
            raise ScenarioError([Mistake(name, f"got {value}, takes a number of 1 or more")])
    tuned_numbers(scenario)
    prepared = prepare_one(scenario, "a tuning")
    prepared.check()
    with place_of(folder / TUNING, force=force):
        say_doubts(console, prepared)
        with Interruption() as interruption:
            with progress_bar(console) as bar:
                (task,) = bar.task_ids
                tuning = _built(scenario, seeds, iterations, margin)

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
                return f"no start could be run: {tuning.failure}"
            data = tuning.dataset()
            with replacing(folder / TUNED) as temporary:
                temporary.write_text(_HEAD + tuning.tuned().to_toml(), "utf-8")
            files = save_finding(data, folder / TUNING)
            console.print(tuning_table(data, tuning.random))
            say_notes(console, _notes(tuning, data))
            say_written(console, [folder / TUNED, *files])
    if stopped:
        words = f"after {int(tuning.tried.sum())} trials; the best so far is saved"
        return f"{Status.INTERRUPTED} {words}"
    return ""


def _built(scenario: Scenario, seeds: int, iterations: int, margin: float) -> Tuning:
    try:
        return Tuning(scenario, seeds, iterations, margin)
    except RuntimeError as error:  # no equilibrium to start from
        raise ScenarioError([Mistake("", str(error))]) from error


def tuning_table(data: xr.Dataset, random: bool) -> Table:
    """Sum up a search: what was tuned, margins, and costs in other draws, before and after."""
    table = Table(title=str(data.attrs["title"]), title_justify="left")
    for name in ("", "before", "after"):
        table.add_column(name, justify="right" if name else "left")
    for name, given, tuned in zip(
        data["key"].values, data["given"].values, data["tuned"].values, strict=True
    ):
        table.add_row(str(name), f"{given:.4g}", f"{tuned:.4g}")
    for name in MARGINS if data.attrs["margin"] else ():
        before, after = (float(data[f"{when}_{name}_margin"]) for when in ("before", "after"))
        table.add_row(f"{name} margin", *(_margin(name, value) for value in (before, after)))
    if data.attrs["margin"]:
        table.add_row("weakest in", data.attrs["before_water"], data.attrs["after_water"])
    words = "other draws" if random else "the run"
    before, after = (np.sqrt(np.mean(data[name].values)) for name in ("before", "after"))
    table.add_row(f"root of cost, {words}", *map(_length, (before, after)))
    before, after = (
        np.sqrt(np.mean(data[f"{name}_error"].values ** 2)) for name in ("before", "after")
    )
    table.add_row(f"tip error, RMS, {words}", *map(_length, (before, after)))
    return table


def _margin(name: str, value: float) -> str:
    if np.isnan(value):
        return "unstable"
    unit = {"phase": DEGREES, "delay": si_unit(value if np.isfinite(value) else 1.0, "s")}.get(name)
    return f"{value:.3g}" if unit is None else unit.text(value)


def _length(value: float) -> str:
    return "-" if np.isnan(value) else f"{1e3 * value:.4g} mm"


def _notes(tuning: Tuning, data: xr.Dataset) -> list[str]:
    notes = []
    if not tuning.random:
        notes.append("nothing in this scenario is random: all seeds give the same run")
    if not tuning.keeps_margin:
        notes.append(
            f"none of the {int(tuning.tried.sum())} trials keeps the modulus margin asked for, "
            f"{tuning.asked:g}, and bears commands two control periods later"
        )
    lost = int(np.isnan(tuning.cost).all(axis=1).sum())
    if lost:
        notes.append(f"{lost} of {len(tuning.cost)} starts could not be run: {tuning.failure}")
    held = tuning.held_out
    if held and held["after"].mean() > held["before"].mean():
        if tuning.asked and not data["before_modulus_margin"] >= tuning.asked:
            notes.append("it costs more than before, as it had less margin then")
        elif tuning.random:
            notes.append("in draws that were not tuned for it is worse: take more --seeds")
    return notes
