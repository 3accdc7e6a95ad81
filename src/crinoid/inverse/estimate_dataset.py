"""Datasets of estimates: tip, shape and current with deviations, innovations, consistency."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from jaxtyping import Float

from crinoid.assembly.plan import AssembledScenario
from crinoid.control import Estimate
from crinoid.foundation.axes import AXES
from crinoid.foundation.result_variables import quantity
from crinoid.results.dataset import described

_SIGMAS = 2.0  # standard deviations within which innovations are counted
_TAIL = 0.025  # probability beyond each end of the interval of the mean square

Ticks = Float[np.ndarray, " tick"]
Values = Float[np.ndarray, "tick y"]


class Filtered(NamedTuple):
    """Filtered states, their deviations, and innovations, of each call."""

    states: Float[np.ndarray, "tick z"]
    deviations: tuple[np.ndarray, np.ndarray, np.ndarray]
    """Standard deviations of tip and nodes, square root of the covariance of the current."""
    innovation: Values  # new readings less those expected; nan without a new one
    innovation_std: Values
    squared: Ticks  # squares of the innovations, normalised by their covariance and summed up


def estimate_dataset(
    plan: AssembledScenario, time: Ticks, found: Estimate, filtered: Filtered, measured: Values
) -> xr.Dataset:
    """Return estimates and innovations at the times (s) of the calls of an observer."""
    axes = plan.scenario.arm.dimension
    assert found.position is not None
    assert found.flow_velocity is not None
    tip = {"value": np.array(found.tip.value), "std": np.asarray(found.tip.std)}
    if axes == 2:
        tip["value"][:, 2] = np.unwrap(tip["value"][:, 2])
    variables: dict[str, Any] = {}
    for ending, part in (("", "value"), ("_std", "std")):
        pointing = ("angle", tip[part][:, 2]) if axes == 2 else ("direction", tip[part][:, 3:])
        for name, values in (
            ("tip_position", tip[part][:, :axes]),
            (f"tip_{pointing[0]}", pointing[1]),
            ("position", getattr(found.position, part)),
            ("flow_velocity", getattr(found.flow_velocity, part)),
        ):
            full = f"estimated_{name}{ending}"
            variables[full] = quantity(full, np.asarray(values), axes)
    by_reading = "time reading"
    variables |= described([
        ("sensor_reading", by_reading, "", measured, "new readings; nan without one"),
        ("innovation", by_reading, "", filtered.innovation,
         "new readings less those expected; nan without a new one"),
        ("innovation_std", by_reading, "", filtered.innovation_std,
         "standard deviation of innovation"),
        ("normalised_innovation_squared", "time", "1", filtered.squared,
         "squares of the innovations over their covariance, summed over the new readings"),
    ])  # fmt: skip
    names = [
        (f"{sensor.name}.{name}", unit)
        for sensor in plan.sensors
        for name, unit in sensor.measurand.names(axes)
    ]
    lengths = np.concatenate([np.zeros(1), np.cumsum(plan.system.reference.rest_length)])
    along = "distance from the root along the arm at rest"
    coordinates = [
        ("time", "time", "s", time, "time"),
        ("axis", "axis", "", list(AXES[axes]), ""),
        ("arc_length", "node", "m", lengths, along),
        ("reading", "reading", "", [name for name, _ in names], "sensor and value"),
        ("reading_unit", "reading", "", [unit for _, unit in names], "unit of readings"),
    ]
    return xr.Dataset(variables, described(coordinates))


def consistency(filtered: Filtered) -> dict[str, Any]:
    """Return how the innovations compare with their covariance (Bar-Shalom et al. 2001).

    The sum of their normalised squares follows a chi-squared law with as many degrees of freedom as
    readings, where the model is right.
    """
    from scipy.special import chdtri  # slow to load

    new = np.isfinite(filtered.innovation)
    count = int(new.sum())
    near = np.abs(filtered.innovation[new]) <= _SIGMAS * filtered.innovation_std[new]
    return {
        "readings_used": count,
        "mean_square": float(filtered.squared.sum() / count),
        "mean_square_low": float(chdtri(count, 1 - _TAIL) / count),
        "mean_square_high": float(chdtri(count, _TAIL) / count),
        "within_two_std": float(near.mean()),
    }
