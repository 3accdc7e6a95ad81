"""Comparison of controllers: progress, a file, a figure and a table."""

from pathlib import Path

import numpy as np
import xarray as xr
from rich import box
from rich.table import Table

from crinoid.cli import display
from crinoid.cli.command import console
from crinoid.cli.finding import finding
from crinoid.cli.interruption import Interruption
from crinoid.foundation.status import Status
from crinoid.results.measure_labels import label_of, main_measures, unit_for
from crinoid.results.metrics import write_rows
from crinoid.results.units import Unit, largest, si_unit
from crinoid.scenario import Scenario
from crinoid.studies.comparison import (
    COMPARISON,
    COMPARISON_TABLE,
    ControllerComparison,
    best_controller,
    compared_measures,
    comparison_rows,
)
from crinoid.studies.statistics import differences, row_means
from crinoid.view.figures.controllers import speed_unit


def compare_controllers(
    scenario: Scenario, controllers: str, seeds: int, first_seed: int, folder: Path, *, force: bool
) -> str:
    """Run a scenario under each controller, save, draw and sum up; return what went wrong."""
    path, others = folder / COMPARISON, [COMPARISON_TABLE]
    kinds = [kind.strip() for kind in controllers.split(",")]
    every = range(first_seed, first_seed + seeds)
    with (
        finding(scenario, path, "a comparison", force=force, others=others) as found,
        Interruption() as interruption,
    ):
        with display.progress_bar() as bar:
            comparison = ControllerComparison(scenario, kinds, every)
            interruption.has_some = lambda: comparison.has_runs
            comparison.run(display.reporter(bar, ""), interruption.stop)
            interruption.stop()
        data = comparison.dataset()
        rms, notes = data["rms_error"].values, display.seed_notes(seeds)
        if seeds > 1 and np.isfinite(rms).all() and not np.ptp(rms, axis=1).any():
            notes = ["nothing in this scenario is random: all seeds give the same run"]
        of_runs = {
            name: [note for note in arm.notes if note not in found.doubts]
            for name, arm in comparison.runs.items()
        }
        rows = comparison_rows(data)
        paths = found.save(data, {COMPARISON_TABLE: lambda path: write_rows(path, rows)})
        console.print(comparison_table(data))
        display.say_when(scenario)
        display.say_notes([*notes, *display.notes_of_cases(of_runs)])
        display.say_written(paths)
    failures = [
        f"{name}: {arm.status}"
        for name, arm in comparison.runs.items()
        if Status.of(arm.status) not in (Status.OK, Status.INTERRUPTED)
    ]
    text, status = display.listed(failures, COMPARISON), str(data.attrs["status"])
    if Status.of(status) is Status.INTERRUPTED:
        return f"{status} and saved" + (f"; {text}" if text else "")
    return text


def comparison_table(data: xr.Dataset) -> Table:
    """Return means with intervals of 95 %, over the runs that reached their end."""
    rows: list[tuple[str, ...]] = []

    def add(name: str, values: xr.DataArray, unit: Unit) -> None:
        head = f"{name} ({unit.name})" if unit.name else name
        rows.append((head, *row_means(values.values).texts(unit)))

    for name in main_measures(compared_measures(data)):
        add(label_of(name), data[name], unit_for(data[name]))
    rms = data["rms_error"]
    length = unit_for(rms)
    worst = ("-" if np.isnan(v) else length.number(v) for v in rms.max("seed").values.tolist())
    rows.insert(1, (f"RMS tip error, worst run ({length.name})", *worst))
    kinds = data["controller"].values
    for index, name in enumerate(data["input"].values):
        speed = data["effort"][..., index]
        unit = speed_unit(str(data["input_unit"].values[index]), largest(speed.values))
        add(f"RMS speed of {name}", speed, unit)
    ticks = [si_unit(time, "s").text(time) for time in data["tick_time"].values.tolist()]
    rows.append(("time per tick", *ticks))
    if len(kinds) > 1:
        best = best_controller(data)
        than, p_values = differences(rms.values, rms.values[best])
        texts = than.texts(length)
        chances = ["-" if np.isnan(each) else f"{each:.1g}" for each in p_values.tolist()]
        texts[best] = chances[best] = "-"
        rows += [
            (f"RMS tip error less that of {kinds[best]} ({length.name})", *texts),
            ("p value", *chances),
        ]
    count = data.sizes["seed"]
    complete = np.isfinite(rms.values).sum(axis=1)
    rows.append(("runs", *(str(n) if n == count else f"{n} of {count}" for n in complete)))
    return display.new_table(
        data.attrs["title"], ("", *map(str, kinds)), rows, box=box.SIMPLE, pad_edge=False
    )
