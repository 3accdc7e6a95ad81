"""The tables of a sweep: what came of it, and what it would take."""

from pathlib import Path

import numpy as np
import xarray as xr
from rich.table import Table

from crinoid.cli.trial import Trial
from crinoid.report.units import DEGREES, Unit, largest, length_unit, si_unit
from crinoid.scenario import shown
from crinoid.sweep import Plan

_ROWS = {
    "rms_error": "tip error, RMS",
    "max_error": "tip error, maximum",
    "steady_error": "tip error, steady",
    "rms_error_uncontrolled": "tip error, RMS, free",
    "rms_angle_error": "angle error, RMS",
    "settling_time": "settled after",
    "work": "work of base and actuators",
}


_RUN, _BATCH = 400, 18_000
"""Bytes that are written of a run, and beside them of a batch, as `benchmarks/sweep.py` counts."""


def sweep_table(data: xr.Dataset) -> Table:
    """Sum up a sweep: quantiles over the runs that reached their end."""
    table = Table(title=str(data.attrs["title"]), title_justify="left")
    for name in ("", "median", "95 %", "worst", "of run"):
        table.add_column(name, justify="right" if name else "left")
    for name, words in _ROWS.items():
        values = data[name].values
        known = values[np.isfinite(values)]
        if known.size == 0:
            continue
        unit = _unit(str(data[name].attrs["units"]), largest(known))
        numbers = (*np.quantile(known, (0.5, 0.95)), known.max())
        run = int(data["run"].values[np.nanargmax(values)])
        table.add_row(words, *(unit.text(float(number)) for number in numbers), str(run))
    complete, count = int(np.isfinite(data["rms_error"].values).sum()), data.sizes["run"]
    table.add_row("runs", str(count) if complete == count else f"{complete} of {count}", "", "", "")
    return table


def worst_lines(plan: Plan, data: xr.Dataset, folder: Path) -> list[str]:
    """Name the run of the largest error, and how to play it again."""
    errors = data["rms_error"].values
    if not np.isfinite(errors).any():
        return []
    run = int(np.nanargmax(errors)) + 1
    error = float(errors[run - 1])
    values = ", ".join(f"{key} = {shown(value)}" for key, value in plan.values(run).items())
    told = (
        f"run {run}{f' ({values})' if values else ''}, tip error {length_unit(error).text(error)}"
    )
    return [f"worst: {told}", f"play it: crinoid run --case {folder} {run}"]


def estimate_table(plan: Plan, trial: Trial, workers: int) -> Table:
    """Tell what a sweep would take."""
    table = Table(title=plan.scenario.title or None, title_justify="left", show_header=False)
    whole = "whole" if trial.part > 0.99 else f"{trial.part:.1%} of it"
    hours = plan.runs * trial.seconds / 3600 / max(1, workers)
    size = (plan.runs * _RUN + len(plan.batches) * _BATCH) / 1e9
    for row in (
        ("runs", str(plan.runs)),
        ("batches", f"{len(plan.batches)} of up to {plan.batch} runs"),
        ("structures", str(len(plan.structures))),
        ("workers", str(workers)),
        ("time of a run", f"{trial.seconds:.3g} s on one core (timed: the first run, {whole})"),
        ("hours", f"{hours:.3g}" if workers else "unknown: the scheduler has no workers"),
        ("gigabytes", f"{size:.2g}"),
    ):
        table.add_row(*row)
    return table


def _unit(name: str, magnitude: float) -> Unit:
    if name == "m":
        return length_unit(magnitude)
    return DEGREES if name == "rad" else si_unit(magnitude, name)
