"""Measures of runs, with their units: the same in studies, comparisons and batches."""

from collections.abc import Hashable, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from crinoid.results.metrics import EFFORT, Measure, Measures

_ROUND = 1e-9  # relative difference of equal instants of two runs


def stacked(runs: Sequence[xr.Dataset | None]) -> xr.Dataset:
    """Return the data of runs along a new first dimension ``run``.

    Variables that are equal in all of them do not get it. The runs, of one structure, save the
    same instants, each up to where it ended; None of a run that has none. Missing numbers become
    NaN.
    """
    there = {number: run for number, run in enumerate(runs) if run is not None}
    if not there:
        return xr.Dataset()
    time = max((run["time"] for run in there.values()), key=len)
    near = _ROUND * max(1.0, float(abs(time).max()))
    aligned = [run.reindex(time=time, method="nearest", tolerance=near) for run in there.values()]

    def varies(name: Hashable) -> bool:
        first, *others = (run[name].variable for run in aligned if name in run.variables)
        return "time" in first.dims or not all(map(first.equals, others))

    found = xr.concat(
        aligned,
        pd.Index(there, name="run"),
        data_vars=[name for name in aligned[0].data_vars if varies(name)],
        coords=[name for name in aligned[0].coords if name != "time" and varies(name)],
        compat="override",
        join="exact",
        combine_attrs="override",
    )
    return found.reindex(run=range(len(runs))).drop_vars("run")


def tabulated(
    over: tuple[str, ...],
    found: Sequence[Measures | None],
    status: np.ndarray,
    registry: Mapping[str, Measure],
    along: str = "input",
) -> xr.Dataset:
    """Return the measures of many runs ``over`` some dimensions; NaN of a run that has none.

    They are ordered as the ``status`` of each run in its array, the last dimension changing
    fastest; the inputs that can move are ``along`` a dimension.
    """
    unit = {name: text for each in found if each for name, text in each.unit.items()}
    numbers = {
        name: np.reshape([each.numbers[name] if each else np.nan for each in found], status.shape)
        for name in registry
    }
    speeds = [[each.speed.get(name, np.nan) if each else np.nan for name in unit] for each in found]
    effort = np.reshape(np.array(speeds, float), (*status.shape, len(unit)))
    return measures_dataset(over, numbers, registry, effort, unit, status, along)


def measures_dataset(
    over: tuple[str, ...],
    numbers: Mapping[str, np.ndarray],
    registry: Mapping[str, Measure],
    effort: np.ndarray,
    unit: Mapping[str, str],
    status: np.ndarray,
    along: str = "input",
) -> xr.Dataset:
    """Return measures of many runs, speeds of their inputs and status, with their attributes."""
    found: dict[str, tuple[Any, ...]] = {
        name: (over, values, registry[name].attributes) for name, values in numbers.items()
    }
    # CF has no unit for a mixture
    about = {"long_name": EFFORT, "comment": f"in {along}_unit"}
    found["effort"] = (*over, along), effort, about
    found["status"] = over, status, {"long_name": "ok, or what went wrong and when"}
    inputs, units = np.array(list(unit), object), np.array(list(unit.values()), object)
    coords = {
        along: (along, inputs, {"long_name": "input that can move"}),
        f"{along}_unit": (along, units, {"long_name": "unit of effort"}),
    }
    return xr.Dataset(found, coords)
