"""Statistics of a sweep over all conditions, each with its share of time."""

from contextlib import suppress
from typing import Any

import numpy as np
import xarray as xr
from jaxtyping import Float

from crinoid.results.extremes import Gumbel
from crinoid.results.fatigue import YEAR, combined_life
from crinoid.studies.sweep.plan import SweepDesign

EXTREMES = "extremes.csv"
_PERIODS = (1.0, 10.0, 50.0, 100.0)
"""Return periods (year)."""
_OVER, _BY_PERIOD = ("return_period", "estimate"), "_by_return_period"
_LIFE = {"units": "year", "long_name": "fatigue life over the shares of time of all runs"}
_SHARE = {"units": "1", "long_name": "share of time of the run"}
_WITHIN = {"units": "1", "long_name": "share of all time within target.tolerance"}


def over_all_time(
    data: xr.Dataset, plan: SweepDesign, shares: Float[np.ndarray, " run"]
) -> xr.Dataset:
    """Return a study with life, time within tolerance and extremes over all conditions.

    A run that fails is outside of the tolerance. Extremes need three runs of each case that reach
    their end, and differ.
    """
    found: dict[str, Any] = {
        "combined_life": ((), combined_life(data["life"].values, shares), _LIFE)
    }
    within, parts = data["within_tolerance"], shares.reshape(-1, plan.seeds).sum(axis=1)
    if within.notnull().any():
        found["combined_within_tolerance"] = (), within.fillna(0.0).values @ shares, _WITHIN
    for name, values in data.items():
        if str(name).startswith("max_") and not str(name).endswith(("_station", "_time")):
            rows = [row[np.isfinite(row)] for row in values.values.reshape(-1, plan.seeds)]
            with suppress(ValueError):  # few runs, or equal ones
                fit = Gumbel(*rows, shares=parts / parts.sum())
                levels = [fit.return_level(each * YEAR / judged_time(plan)) for each in _PERIODS]
                found[f"{name}{_BY_PERIOD}"] = _OVER, np.array(levels), values.attrs
    coords = {
        "share_of_time": ("run", shares, _SHARE),
        "return_period": ("return_period", [*_PERIODS], {"units": "year"}),
        "estimate": ("estimate", np.array(["value", "low", "high"], object)),
    }
    return data.assign(found).assign_coords(coords)


def judged_time(plan: SweepDesign) -> float:
    """Return the time of a run from which errors count (s)."""
    return plan.scenario.simulation.duration - plan.scenario.judged_from


def extremes_of(data: xr.Dataset) -> xr.Dataset:
    """Return the extremes of a study by measure, over return periods and estimates."""
    found = {str(name): each for name, each in data.items() if each.dims == _OVER}
    return xr.Dataset({name.removesuffix(_BY_PERIOD): each for name, each in found.items()})
