"""The instants of many runs on top of each other."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr

__all__ = ["stacked"]

_ROUND = 1e-9
"""Part of an instant by which it may differ from that of another run."""


def stacked(runs: Sequence[xr.Dataset | None]) -> xr.Dataset:
    """Return the data of runs along a new dimension ``run``, in front.

    What is the same in all of them stays without it.

    Parameters
    ----------
    runs
        Data of runs of one structure that save the same instants, each from the first one up to
        where it ended; None of a run that has none. What is not there becomes NaN.
    """
    there = [run for run in runs if run is not None]
    if not there:
        return xr.Dataset()
    longest = max(there, key=lambda run: run.sizes["time"])
    common = [0 if run is None else _common(run, longest) for run in runs]
    names = dict.fromkeys(name for run in there for name in run.variables)
    found: dict[Any, tuple[Any, ...]] = {}
    for name in names:
        first = next(run[name] for run in there if name in run.variables)
        values = [None if run is None or name not in run.variables else run[name] for run in runs]
        if "time" in first.dims and name != "time":
            data = _along_time(values, common, longest.sizes["time"])
            found[name] = ("run", *first.dims), data, first.attrs
        elif name == "time" or _alike(values):
            found[name] = first.dims, longest[name].values if name == "time" else first.values
            found[name] = *found[name], first.attrs
        else:
            found[name] = ("run", *first.dims), _side_by_side(values, first), first.attrs
    coordinates = {name: found.pop(name) for name in names if name in longest.coords}
    return xr.Dataset(found, coordinates)


def _common(run: xr.Dataset, longest: xr.Dataset) -> int:
    """Return how many instants of a run are among those of the longest one."""
    time = run["time"].values
    same = np.isclose(time, longest["time"].values[: time.size], rtol=_ROUND, atol=_ROUND)
    return int(np.argmin(same)) if not same.all() else time.size


def _along_time(
    values: Sequence[xr.DataArray | None], common: Sequence[int], length: int
) -> np.ndarray:
    first = next(value for value in values if value is not None)
    whole = min(common) == length and None not in [type(value) for value in values]
    kind = first.dtype if whole and first.dtype.kind != "f" else float
    found = np.full((len(values), length, *first.shape[1:]), 0 if whole else np.nan, kind)
    for row, value in enumerate(values):
        if value is not None:
            found[row, : common[row]] = value.values[: common[row]]
    return found


def _alike(values: Sequence[xr.DataArray | None]) -> bool:
    first, *others = [value.values for value in values if value is not None]
    nan = first.dtype.kind == "f"
    return all(np.array_equal(first, other, equal_nan=nan) for other in others)


def _side_by_side(values: Sequence[xr.DataArray | None], first: xr.DataArray) -> np.ndarray:
    number = first.dtype.kind in "biuf"
    nothing = np.full(first.shape, np.nan if number else "", float if number else object)
    return np.stack([nothing if value is None else value.values for value in values])
