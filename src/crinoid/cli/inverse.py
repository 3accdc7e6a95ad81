"""Tuning of a controller and identification of numbers: progress, the new scenario, a table."""

import math
from pathlib import Path

import numpy as np
import xarray as xr
from rich.table import Table

from crinoid.cli.command import FAILED, MISSED
from crinoid.cli.display import new_table, progress_bar, show
from crinoid.cli.finding import finding, solvable
from crinoid.cli.interruption import Interruption
from crinoid.foundation.status import Status
from crinoid.inverse import IDENTIFICATION, TUNING
from crinoid.inverse.experiments_file import read_experiments
from crinoid.inverse.gain_design import tunable_numbers
from crinoid.inverse.identification import Identification, marker_errors
from crinoid.inverse.tuning import HELD_OUT, MARGINS, Tuning
from crinoid.inverse.unknowns import Unknowns
from crinoid.results.units import DEGREES, si_unit
from crinoid.scenario import ScenarioText, counted

_LITTLE = 0.9
"""Tip error over that without control above which a tuning deserves a note."""
_ALIKE = 0.95
"""Correlation of two numbers from which on a note reports it."""
_MOST_CORRELATED = 2.0
"""Variance of a mean of residuals, over that of white noise, from which on a note reports it."""


def tune_controller(
    text: ScenarioText, seeds: int, iterations: int, margin: float, folder: Path, *, force: bool
) -> str:
    """Search, save and draw what was found, and sum it up; return what went wrong."""
    scenario = text.scenario
    tunable_numbers(scenario)
    with (
        finding(scenario, folder / TUNING, "a tuning", force=force) as found,
        Interruption() as interruption,
    ):
        with progress_bar() as bar:
            (task,) = bar.task_ids
            with solvable():
                tuning = Tuning(scenario, seeds, iterations, margin)

            def report(done: int, total: int, least: float) -> None:
                best = (
                    f"root of cost {1e3 * least**0.5:.3g} mm" if np.isfinite(least) else "none yet"
                )
                reached = f"{done} of at most {total} trials, {best}"
                bar.update(task, total=total, completed=done, description="tuning", reached=reached)

            interruption.has_some = lambda: bool(np.isfinite(tuning.least))
            tuning.run(report, interruption.stop)
            stopped = interruption.stop()
            if np.isfinite(tuning.least) and not stopped:
                bar.update(task, description="comparing", reached="other draws, before and after")
                tuning.hold_out(interruption.stop)
        stopped = interruption.stop()
        if not np.isfinite(tuning.least):
            return f"no start could be run: {tuning.failure}"
        data = tuning.dataset()
        tuned = text.with_values(tuning.tuned(), "numbers by `crinoid tune`")
        files = found.save(data, {"tuned.toml": tuned})
        show(tuning_table(data, tuning.random), _tuning_notes(tuning, data), files)
    if stopped:
        words = f"after {counted(int(tuning.trials.sum()), 'trial')}; the best so far is saved"
        return f"{Status.INTERRUPTED} {words}"
    return ""


def tuning_table(data: xr.Dataset, random: bool) -> Table:
    """Return the table of a tuning: numbers, margins and costs, before and after."""
    columns = (data[name].values for name in ("key", "given", "tuned"))
    rows: list[tuple[str, ...]] = [
        (str(k), f"{given:.4g}", f"{tuned:.4g}", "")
        for k, given, tuned in zip(*columns, strict=True)
    ]
    for name in MARGINS if data.attrs["margin"] else ():
        before, after = (float(data[f"{when}_{name}_margin"]) for when in ("before", "after"))
        rows.append((f"{name} margin", _margin(name, before), _margin(name, after), ""))
    if data.attrs["margin"]:
        rows.append(("weakest in", data.attrs["before_water"], data.attrs["after_water"], ""))
    words = "other draws" if random else "the run"
    costs = (np.sqrt(data[name].values.mean()) for name in HELD_OUT)
    rows.append((f"root of cost, {words}", *map(_length, costs)))
    errors = (np.sqrt((data[f"{name}_error"].values ** 2).mean()) for name in HELD_OUT)
    rows.append((f"tip error, RMS, {words}", *map(_length, errors)))
    return new_table(data.attrs["title"], ("", "before", "after", "without\ncontrol"), rows)


def _margin(name: str, value: float) -> str:
    if np.isnan(value):
        return "unstable"
    unit = {"phase": DEGREES, "delay": si_unit(value if np.isfinite(value) else 1.0, "s")}.get(name)
    return f"{value:.3g}" if unit is None else unit.text(value)


def _length(value: float) -> str:
    return "-" if np.isnan(value) else f"{1e3 * value:.4g} mm"


def _tuning_notes(tuning: Tuning, data: xr.Dataset) -> list[str]:
    notes = []
    if not tuning.random:
        notes.append("nothing in this scenario is random: all seeds give the same run")
    if not tuning.keeps_margin:
        notes.append(
            f"none of the {int(tuning.trials.sum())} trials keeps the modulus margin asked for, "
            f"{tuning.margin:g}, and bears commands two control periods later"
        )
    if ends := data.attrs["at_end"]:
        notes.append(f"at an end of the search: {ends}. Continue from tuned.toml")
    lost = int(np.isnan(tuning.cost).all(axis=1).sum())
    if lost:
        notes.append(f"{lost} of {len(tuning.cost)} starts could not be run: {tuning.failure}")
    held = tuning.held_out
    if "after" in held and held["after"].mean() > held["before"].mean():
        if tuning.margin and not data["before_modulus_margin"] >= tuning.margin:
            notes.append("it costs more than before, as it had less margin then")
        elif tuning.random:
            notes.append("in draws that were not tuned for it is worse: use more --seeds")
    if HELD_OUT[-1] in held and (
        held["after_error"].mean() > _LITTLE * held["uncontrolled_error"].mean()
    ):
        other = 'control.kind = "lqg"' if tuning.scenario.control.kind == "pid" else "another kind"
        notes.append(
            "the tuned controller hardly holds the tip better than none. Run tuned.toml and read "
            f"its notes, drive other inputs, or try {other}."
        )
    if held and tuning.ended_at_limit:
        notes.append(
            f"the search ended at --iterations {tuning.iterations}. Use more for a lower cost."
        )
    return notes


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
            files = found.save(data, {"identified.toml": identified})
            read = [note for each in records for note in each.notes]
            notes = [*read, *search.notes, *_identification_notes(search, data)]
            show(identification_table(data), notes, files)
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
        rows.append((f"RMS error, {marker}", _length(before[marker]), _length(error), "", ""))
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
