"""Finding numbers of a scenario from a record: progress, the scenario with them, and a table."""

import math
from collections.abc import Sequence
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
from crinoid.identification import IDENTIFICATION
from crinoid.identification.experiment import given_values
from crinoid.identification.identification import Identification
from crinoid.identification.record import read_record
from crinoid.replacement import replacing
from crinoid.scenario import Mistake, Scenario, ScenarioError
from crinoid.status import Status

IDENTIFIED = "identified.toml"
_HEAD = "# numbers by `crinoid identify`; {} of the record were set aside as lost markers\n\n"
_ALIKE = 0.95
"""Correlation from which on two numbers are hard to tell apart."""
_REMEMBERS = 2.0
"""Integral time of what is left, over that of white noise, that says something of the model."""


def identify_numbers(
    scenario: Scenario,
    record: Path,
    keys: Sequence[str],
    folder: Path,
    *,
    force: bool,
    console: Console,
) -> str:
    """Search for numbers, save and draw what was found, and sum it up; return what went wrong."""
    if not keys:
        text = "got no key, takes keys of numbers such as arm.youngs_modulus,water.drag_normal"
        raise ScenarioError([Mistake("--of", text)])
    given_values(scenario, keys)
    prepared = prepare_one(scenario, "a record")
    prepared.check()
    read = read_record(record, scenario.arm.dimension, prepared.system.inputs)
    with place_of(folder / IDENTIFICATION, force=force):
        say_doubts(console, prepared)
        with Interruption() as interruption:
            with progress_bar(console) as bar:
                (task,) = bar.task_ids
                bar.update(task, description="identifying", reached="compiling")
                search = _built(scenario, keys, read)

                def report(trials: int, cost: float) -> None:
                    told = f"{trials} trials, {cost**0.5:.4g} of the scatter left"
                    bar.update(task, reached=told)

                complete = search.run(report, interruption.stop)
            if search.failure:
                return f"{search.failure} (with the numbers that the scenario gives)"
            if search.found is None:
                return f"{Status.INTERRUPTED} before there was anything to save"
            words = f"after {search.trials} trials; the best numbers so far are saved"
            status = "" if complete else f"{Status.INTERRUPTED} {words}"
            data = search.dataset(status or Status.OK.value)
            with replacing(folder / IDENTIFIED) as temporary:
                temporary.write_text(
                    _HEAD.format(_aside(data)) + search.identified().to_toml(), "utf-8"
                )
            files = save_finding(data, folder / IDENTIFICATION)
            console.print(identification_table(data))
            say_notes(console, [*read.notes, *search.notes, *_notes(search, data)])
            say_written(console, [folder / IDENTIFIED, *files])
    return status


def _built(scenario: Scenario, keys: Sequence[str], record: object) -> Identification:
    try:
        return Identification(scenario, keys, record)  # type: ignore[arg-type]
    except RuntimeError as error:  # no equilibrium to start from
        raise ScenarioError([Mistake("", str(error))]) from error


def identification_table(data: xr.Dataset) -> Table:
    """Sum up a search: numbers before and after, and how well they are known."""
    aside = f"set aside as lost markers: {_aside(data)}"
    table = Table(
        title=str(data.attrs["title"]), title_justify="left", caption=aside, caption_justify="left"
    )
    table.add_column("", no_wrap=True)
    for name in ("given", "found", "standard error", "of it"):
        table.add_column(name, justify="right")
    for key in data["parameter"].values:
        row = data.sel(parameter=key)
        given, found, error = (float(row[name]) for name in ("given", "found", "standard_error"))
        if not np.isfinite(error):
            table.add_row(str(key), f"{given:.4g}", f"{found:.4g}", "not known", "")
            continue
        share = error / abs(found)
        places = min(6, max(2, 2 - math.floor(math.log10(share)))) if share > 0 else 6
        table.add_row(
            str(key), f"{given:.4g}", f"{found:.{places}g}", f"{error:.2g}", f"{100 * share:.2g} %"
        )
    return table


def _aside(data: xr.Dataset) -> str:
    return f"{int(data['set_aside'].sum())} of {data.sizes['time']} rows"


def _notes(search: Identification, data: xr.Dataset) -> list[str]:
    notes = []
    keys = [str(key) for key in data["parameter"].values]
    alike = np.abs(np.triu(data["correlation"].values, 1))
    for row, column in np.argwhere(alike > _ALIKE):
        value = data["correlation"].values[row, column]
        notes.append(
            f"{keys[row]} and {keys[column]} are hard to tell apart by this record (correlation "
            f"{value:.3f}): another motion would, or one of them known"
        )
    if not np.isfinite(data["standard_error"].values).all():
        notes.append("this record does not tell all of these numbers; name fewer")
    interval = float(np.median(np.diff(data["time"].values)))
    for name, scatter, time in zip(
        data["quantity"].values, data["scatter"].values, data["remembered"].values, strict=True
    ):
        if time > _REMEMBERS * interval / 2:
            notes.append(
                f"what is left of {name} ({scatter:.3g} RMS) remembers itself for {time:.2g} s: "
                "the model does not say all of it, and the errors count it in"
            )
    late = search.experiment.record.time.size - search.experiment.time.size
    if late:
        notes.append(f"{late} rows after the end of the run (simulation.duration) are left out")
    return notes
