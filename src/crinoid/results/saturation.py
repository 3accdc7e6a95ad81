"""Saturation: the share of the controlled time that an input spends at its limits."""

from typing import NamedTuple

import numpy as np
import xarray as xr
from jaxtyping import Bool, Float

from crinoid.results.result import Result

_AT_END = 1e-3  # distance from the end of the travel, over the travel, that counts as its end
_AT_SPEED, _AT_ACCELERATION = 0.99, 0.95
"""Share of a limit that differences between saved instants reach at saturation."""
_OF_LIMITS = (
    *("base_servo", "channel_lower", "channel_upper", "channel_max_speed"),
    *("channel_max_acceleration", "actuator_command"),
)
"""Variables that show saturation of an input."""


class AtLimit(NamedTuple):
    """Share of the controlled time, from 0 to 1, that an input spends at each of its limits."""

    range: float
    speed: float
    acceleration: float


def limit_shares(result: Result) -> dict[str, AtLimit]:
    """Return the saturation of each driven input, by saved instants.

    The ends of a channel's travel count once it has left its initial position. Of other inputs the
    ends of their commands count, except 0.
    """
    scenario, data = result.scenario, result.dataset
    if not scenario.control.acts:
        return {}
    data = data[[name for name in _OF_LIMITS if name in data]].isel(time=controlled(result))
    if data.sizes["time"] < 3:
        return {}
    return {
        name: _of_channel(data.sel(channel=name))
        if name in data["channel"]
        else _of_actuator(data.sel(input=name))
        for name in scenario.driven
    }


def _of_channel(data: xr.Dataset) -> AtLimit:
    servo, time = data["base_servo"].values, data["time"].values
    ends = _ends(servo, float(data["channel_lower"]), float(data["channel_upper"]))
    ends &= np.cumsum(~ends) > 0
    speed = np.diff(servo) / np.diff(time)
    acceleration = np.diff(speed) / (0.5 * (time[2:] - time[:-2]))
    most = float(data["channel_max_acceleration"])
    return AtLimit(
        float(np.mean(ends)),
        float(np.mean(np.abs(speed) >= _AT_SPEED * float(data["channel_max_speed"]))),
        float(np.mean(np.abs(acceleration) >= _AT_ACCELERATION * most)),
    )


def _of_actuator(data: xr.Dataset) -> AtLimit:
    command = data["actuator_command"].values
    ends = _ends(command, float(data["input_lower"]), float(data["input_upper"]))
    return AtLimit(float(np.mean(ends & (command != 0))), 0.0, 0.0)


def _ends(
    values: Float[np.ndarray, " time"], lower: float, upper: float
) -> Bool[np.ndarray, " time"]:
    slack = _AT_END * (upper - lower)
    return (values <= lower + slack) | (values >= upper - slack)


def controlled(result: Result) -> Bool[np.ndarray, " time"]:
    """Return the saved instants at which the controller acts."""
    time = result.dataset["time"].values
    return time >= result.scenario.control.start - 1e-9
