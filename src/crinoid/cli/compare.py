"""Comparing controllers: progress while they run, a file, a figure and a table."""

from pathlib import Path

import numpy as np
import xarray as xr
from rich.console import Console
from rich.table import Table

from crinoid.cli.finding import place_of, prepare_one, save_finding
from crinoid.cli.interruption import Interruption
from crinoid.cli.lines import say_notes, say_written
from crinoid.cli.notes import notes_of_cases, say_doubts
from crinoid.cli.progress import progress_bar, reporter
from crinoid.comparison import COMPARISON, Comparison
from crinoid.report.compare import speed_unit
from crinoid.report.units import DEGREES, Unit, largest, length_unit, si_unit
from crinoid.scenario import Mistake, Scenario, ScenarioError, one_of, shown
from crinoid.scenario.control import KINDS
from crinoid.scenario.kinds import installed
from crinoid.status import Status

_MOST_FAILURES = 4


def kinds_of(text: str) -> list[str]:
    """Return the kinds of controllers in a list with commas."""
    kinds = [kind.strip() for kind in text.split(",")]
    known = [kind for kind in (*KINDS, *installed("controllers")) if kind != "custom"]
    for kind in kinds:
        if kind not in known:
            text = f"got {shown(kind)}, takes {one_of(known)}, with commas between them"
            raise ScenarioError([Mistake("--controllers", text)])
        if kinds.count(kind) > 1:
            text = f"got {shown(kind)} twice, takes each one once"
            raise ScenarioError([Mistake("--controllers", text)])
    return kinds


def seeds_of(count: int, first: int) -> range:
    """Return the seeds from the first one on."""
    if count < 1:
        raise ScenarioError([Mistake("--seeds", f"got {count}, takes a number of 1 or more")])
    if first < 0:
        raise ScenarioError([Mistake("--first-seed", f"got {first}, takes a number of 0 or more")])
    return range(first, first + count)


def compare_controllers(
    scenario: Scenario,
    kinds: list[str],
    seeds: range,
    folder: Path,
    *,
    force: bool,
    console: Console,
) -> str:
    """Run a scenario under each controller, save, draw and sum up; return what went wrong."""
    prepared = prepare_one(scenario, "a comparison")
    prepared.check()
    with place_of(folder / COMPARISON, force=force):
        doubted = say_doubts(console, prepared)
        with Interruption() as interruption:
            with progress_bar(console) as bar:
                comparison = Comparison(scenario, kinds, seeds)

                def stop() -> bool:
                    # until a run is complete there is nothing to save: a wish is heard at once
                    return comparison.begun and interruption.stop()

                comparison.run(reporter(bar, ""), stop)
                interruption.stop()
            dataset = comparison.dataset()
            files = save_finding(dataset, folder / COMPARISON)
            console.print(comparison_table(dataset))
            told = {
                name: [note for note in notes if note not in doubted]
                for name, notes in comparison.notes.items()
            }
            say_notes(console, [*_alike(dataset), *notes_of_cases(told)])
            say_written(console, files)
    return _trouble(dataset)


def comparison_table(data: xr.Dataset) -> Table:
    """Sum up a comparison: means over the runs that reached their end."""
    table = Table(title=str(data.attrs["title"]), title_justify="left")
    table.add_column("")
    for kind in data["controller"].values:
        table.add_column(str(kind), justify="right")

    def add(name: str, values: np.ndarray, unit: Unit) -> None:
        table.add_row(name, *("-" if np.isnan(v) else unit.text(float(v)) for v in values))

    rms, most = data["rms_error"].values, data["max_error"].values
    unit = length_unit(largest(most))
    add("tip error, RMS", _mean(rms), unit)
    add("tip error, RMS, worst run", _most(rms), unit)
    add("tip error, maximum", _most(most), unit)
    if "none" in data["controller"].values and _stays(Scenario.from_toml(data.attrs["scenario"])):
        free = data["fluctuation"].sel(controller="none").values
        ratio = _mean(rms / free)
        cells = ("-" if np.isnan(value) else f"{value:.1%}" for value in ratio)
        table.add_row("tip error over fluctuation", *cells)
    if "rms_angle_error" in data:
        add("angle error, RMS", _mean(data["rms_angle_error"].values), DEGREES)
        add("angle error, maximum", _most(data["max_angle_error"].values), DEGREES)
    for index, name in enumerate(data["input"].values):
        speed = data["effort"].values[..., index]
        unit = speed_unit(str(data["input_unit"].values[index]), largest(speed))
        add(f"speed of {name}, RMS", _mean(speed), unit)
    work = data["work"].values
    add("work of base and actuators", _mean(work), si_unit(largest(work), "J"))
    tick = data["tick_time"].values
    table.add_row(
        "time per tick",
        *("-" if np.isnan(t) else si_unit(float(t), "s").text(float(t)) for t in tick),
    )
    count = data.sizes["seed"]
    complete = np.isfinite(rms).sum(axis=1)
    table.add_row("runs", *(str(n) if n == count else f"{n} of {count}" for n in complete))
    return table


def _mean(values: np.ndarray) -> np.ndarray:
    """Return the mean over seeds of what there is; NaN where there is nothing."""
    there = np.isfinite(values)
    total = np.where(there, values, 0.0).sum(axis=1)
    return np.where(there.any(axis=1), total / np.maximum(1, there.sum(axis=1)), np.nan)


def _most(values: np.ndarray) -> np.ndarray:
    there = np.isfinite(values)
    return np.where(there.any(axis=1), np.where(there, values, -np.inf).max(axis=1), np.nan)


def _stays(scenario: Scenario) -> bool:
    """Tell whether the tip is not to go away from its mean."""
    moves = scenario.target.frame == "base" and scenario.base.motion
    return not (scenario.target.moves or moves)


def _alike(data: xr.Dataset) -> list[str]:
    """Return a note if seeds make no difference."""
    rms = data["rms_error"].values
    if data.sizes["seed"] < 2 or not np.isfinite(rms).all() or np.ptp(rms, axis=1).any():
        return []
    return ["nothing in this scenario is random: all seeds give the same run"]


def _trouble(data: xr.Dataset) -> str:
    """Say which runs did not reach their end, and why."""
    kinds, seeds = data["controller"].values, data["seed"].values
    failures = []
    for (row, column), words in np.ndenumerate(data["status"].values):
        if Status.of(words) not in (Status.OK, Status.INTERRUPTED):
            failures.append(f"{kinds[row]} with seed {seeds[column]}: {words}")
    left = len(failures) - _MOST_FAILURES
    told = "; ".join(failures[:_MOST_FAILURES])
    if left > 0:
        told += f"; {left} more {'is' if left == 1 else 'are'} in {COMPARISON}"
    summed = str(data.attrs["status"])
    if Status.of(summed) is Status.INTERRUPTED:
        return f"{summed} and saved" + (f"; {told}" if told else "")
    return told
