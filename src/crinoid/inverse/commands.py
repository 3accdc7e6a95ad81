"""Recorded commands of inputs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import xarray as xr
from jaxtyping import Float

from crinoid.actuation import Input
from crinoid.recording.series import Series
from crinoid.results.result import Result


class Commands(NamedTuple):
    """Recorded commands, each valid until the time of the next."""

    time: Float[np.ndarray, " row"]
    values: Float[np.ndarray, "row input"]

    @staticmethod
    def of(parts: Sequence[Series], at: Sequence[int], inputs: int) -> Commands | None:
        """Return those in series of the inputs ``at`` these places; the others are at rest."""
        if not parts:
            return None
        times, first = np.unique(np.concatenate([part.time for part in parts]), return_index=True)
        values = np.zeros((times.size, inputs))
        values[:, at] = np.concatenate([part.values for part in parts])[first]
        return Commands(times, values)


def commands_of(result: Result, inputs: Sequence[Input]) -> Commands | None:
    """Return the commands in a result, each from its time step on; None without control."""
    data, step = result.dataset, result.scenario.simulation.time_step
    if result.scenario.control.kind == "none":
        return None
    rows = _by_name(data, "base_command", "channel")
    if "actuator_command" in data:
        rows |= _by_name(data, "actuator_command", "input")
    none = np.zeros(data.sizes["time"])
    values = np.stack([rows.get(each.name, none) for each in inputs], axis=1)
    # a result has the command of a time step at its end
    return Commands(data["time"].values - step, values)


def _by_name(data: xr.Dataset, variable: str, dim: str) -> dict[str, np.ndarray]:
    return dict(zip(map(str, data[dim].values), data[variable].values.T, strict=True))
