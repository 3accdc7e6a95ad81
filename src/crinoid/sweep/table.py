"""Rows of runs as a dataset, with names and units."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import xarray as xr
from jaxtyping import Int

from crinoid import cases
from crinoid.batch.measures import EFFORT, MEASURES
from crinoid.batch.variation import coordinate
from crinoid.dataset import describe
from crinoid.sweep.plan import Plan
from crinoid.sweep.work import Row

__all__ = ["assemble", "case_rows", "tabulate"]


def tabulate(runs: Int[np.ndarray, " run"], rows: Sequence[Row]) -> xr.Dataset:
    """Return the rows of some runs as a dataset over ``run``; what is not known is NaN."""
    units = {name: unit for row in rows for name, unit in row.unit.items()}
    measures = {name: [row.measures.get(name, np.nan) for row in rows] for name in MEASURES}
    effort = [[row.effort.get(name, np.nan) for name in units] for row in rows]
    return _dataset(
        runs,
        np.array([row.status for row in rows], object),
        {name: np.array(values) for name, values in measures.items()},
        np.array(effort).reshape(len(rows), len(units)),
        units,
    )


def assemble(plan: Plan, parts: Iterator[xr.Dataset]) -> xr.Dataset:
    """Return all runs of a plan in order, with what varied, from the datasets of its batches."""
    count = plan.runs
    status = np.full(count, "", object)
    measures = {name: np.full(count, np.nan) for name in MEASURES}
    effort: dict[str, np.ndarray] = {}
    first: dict[str, int] = {}
    units: dict[str, str] = {}
    for part in parts:
        places = part["run"].values - 1
        status[places] = part["status"].values
        for name, values in measures.items():
            values[places] = part[name].values
        for index, name in enumerate(map(str, part["input"].values)):
            speeds = part["effort"].values[:, index]
            effort.setdefault(name, np.full(count, np.nan))[places] = speeds
            units[name] = str(part["input_unit"].values[index])
            first[name] = min(first.get(name, count), int(places[np.isfinite(speeds)].min()))
    names = sorted(units, key=lambda name: (first[name], name))  # whatever the order of batches
    data = _dataset(
        np.arange(1, count + 1),
        status,
        measures,
        np.stack([effort[name] for name in names], 1) if names else np.empty((count, 0)),
        {name: units[name] for name in names},
    )
    varied = [plan.values(run) for run in range(1, count + 1)]
    about = {"long_name": "seed of everything random"}
    seeds = [values.get("seed", plan.scenario.seed) for values in varied]
    found = {key: coordinate(key, [values[key] for values in varied]) for key in plan.keys}
    data = data.assign_coords(found | {"seed": ("run", np.array(seeds, np.int64), about)})
    return data.assign_attrs(describe(plan.scenario) | {"plan": plan.to_toml()})


def case_rows(plan: Plan, data: xr.Dataset) -> Iterator[dict[str, Any]]:
    """Yield the rows of ``cases.csv``."""
    columns = {name: data[name].values for name in cases.MEASURES}
    for index, status in enumerate(data["status"].values):
        name = plan.name(index + 1)
        measures = {key: _text(float(values[index])) for key, values in columns.items()}
        varied = plan.values(index + 1)
        yield {"case": name, **varied, **measures, "status": status, "directory": name}


def _dataset(
    runs: np.ndarray,
    status: np.ndarray,
    measures: dict[str, np.ndarray],
    effort: np.ndarray,
    units: dict[str, str],
) -> xr.Dataset:
    found: dict[str, tuple[Any, ...]] = {
        name: ("run", values, MEASURES[name].attributes) for name, values in measures.items()
    }
    about = {"long_name": EFFORT, "comment": "in input_unit"}
    found["effort"] = (("run", "input"), effort, about)
    found["status"] = ("run", status, {"long_name": "ok, or what went wrong and when"})
    names, of_each = np.array(list(units), object), np.array(list(units.values()), object)
    return xr.Dataset(
        found,
        coords={
            "run": ("run", runs, {"long_name": "number of the run"}),
            "input": ("input", names, {"long_name": "input that can move"}),
            "input_unit": ("input", of_each, {"long_name": "unit of effort"}),
        },
    )


def _text(value: float) -> float | str:
    return "" if np.isnan(value) else value
