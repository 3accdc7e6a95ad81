"""Identification of numbers of a scenario: progress, the new scenario, a table."""

import math
from pathlib import Path

import numpy as np
import xarray as xr
from rich.table import Table

from crinoid.cli.command import FAILED, MISSED
from crinoid.cli.display import new_table, progress_bar
from crinoid.cli.finding import finding, solvable
from crinoid.cli.interruption import Interruption
from crinoid.foundation.status import Status
from crinoid.inverse import IDENTIFICATION
from crinoid.inverse.experiments_file import read_experiments
from crinoid.inverse.identification import Identification, marker_errors
from crinoid.inverse.unknowns import Unknowns
from crinoid.results.units import length_text
from crinoid.scenario import ScenarioText, counted

_ALIKE = 0.95  # correlation of two numbers from which on a note reports it
_MOST_CORRELATED = 2.0  # variance of a mean of residuals over that of white noise: more has a note


def identify_numbers(
    text: ScenarioText, record: Path, unknowns: Unknowns, folder: Path, *, force: bool
) -> tuple[str, int]:
    """Search, save and draw what was found, and sum it up; return what went wrong, and the code."""
    scenario = text.scenario
    with finding(scenario, folder / IDENTIFICATION, "a record", force=force) as found:
        records = read_experiments(record, found.prepared, unknowns)
        with Interruption() as interruption:
            with progress_bar() as bar:
                (task,) = bar.task_ids
                bar.update(task, description="identifying", reached="compiling")
                with solvable():
                    search = Identification(scenario, unknowns.keys, records)

                def report(trials: int, cost: float) -> None:
                    reached = f"trial {trials} of at most {search.total}"
                    bar.update(task, reached=f"{reached}, {cost**0.5:.4g} of the scatter left")

                interruption.has_some = lambda: search.found is not None
                complete = search.run(report, interruption.stop)
            if search.failure:
                return f"{search.failure} (with the numbers that the scenario gives)", FAILED
            if search.found is None:
                return f"{Status.INTERRUPTED} before there was anything to save", FAILED
            words = f"after {counted(search.trials, 'trial')}; the best numbers so far are saved"
            status = "" if complete else f"{Status.INTERRUPTED} {words}"
            unsure = "; ".join(f"{key}: {why}" for key, why in search.undetermined().items())
            if unsure and complete:
                status = f"the record does not determine all numbers; name fewer. {unsure}"
            data = search.dataset(status or Status.OK.value)
            comment = f"{_lost_markers(data)} of the record were set aside as lost markers"
            comment = "; ".join(filter(None, ("numbers by `crinoid identify`", comment, status)))
            identified = text.with_values(search.numbers(), comment)
            read = [note for each in records for note in each.notes]
            notes = [*read, *search.notes, *_identification_notes(search, data)]
            files = {"identified.toml": identified}
            found.show(data, identification_table(data), notes=notes, files=files)
    return status, MISSED


def identification_table(data: xr.Dataset) -> Table:
    """Return the numbers before and after, and their standard errors."""
    rows = []
    for key in data["parameter"].values:
        row = data.sel(parameter=key)
        given, found, error = (float(row[name]) for name in ("given", "found", "standard_error"))
        share = error / abs(found)
        if not row["determined"]:
            rows.append((str(key), f"{given:.4g}", f"{found:.2g}", "not determined", ""))
            continue
        places = min(6, max(2, 2 - math.floor(math.log10(share)))) if share > 0 else 6
        numbers = (f"{given:.4g}", f"{found:.{places}g}", f"{error:.2g}", f"{100 * share:.2g} %")
        rows.append((str(key), *numbers))
    before, after = (marker_errors(data, name) for name in ("computed_before", "computed"))
    for marker, error in after.items():
        rows.append(
            (f"RMS error, {marker}", length_text(before[marker]), length_text(error), "", "")
        )
    heads = ("", "given", "found", "standard error", "of it")
    caption = f"set aside as lost markers: {_lost_markers(data)}"
    table = new_table(data.attrs["title"], heads, rows, caption=caption, caption_justify="left")
    table.columns[0].no_wrap = True
    return table


def _lost_markers(data: xr.Dataset) -> str:
    return f"{int(data['set_aside'].sum())} of {data.sizes['time']} rows"


def _identification_notes(search: Identification, data: xr.Dataset) -> list[str]:
    notes = []
    keys = [str(key) for key in data["parameter"].values]
    alike = np.abs(np.triu(data["correlation"].values, 1))
    for row, column in np.argwhere(alike > _ALIKE):
        value = data["correlation"].values[row, column]
        notes.append(
            f"{keys[row]} and {keys[column]} are strongly correlated by this record ({value:.3f}). "
            "Use another experiment, or fix one of them."
        )
    for name, scatter, time, variance in zip(
        data["quantity"].values, data["scatter"].values, *search.correlation, strict=True
    ):
        if variance > _MOST_CORRELATED:
            notes.append(
                f"the residual of {name} ({scatter:.3g} RMS) is autocorrelated over {time:.2g} s, "
                "so the model misses part of the motion. The standard errors account for it."
            )
    late = sum(each.late for each in search.experiments)
    if late:
        notes.append(f"{late} rows after the end of the run (simulation.duration) are left out")
    return notes
