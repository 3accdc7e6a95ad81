"""Signals of a run in its dataset: readings of the sensors, commands and states of actuators."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from crinoid.actuation import Input
from crinoid.record import Record
from crinoid.space import CHANNEL_TABLE

_CHANNELS = {channel.name for channel in CHANNEL_TABLE}


def with_signals(
    dataset: xr.Dataset,
    kept: Record,
    inputs: Sequence[Input],
    readings: Sequence[tuple[str, str]],
) -> xr.Dataset:
    """Add the signals of the same instants.

    Parameters
    ----------
    dataset
        That of what was saved.
    kept
        What was saved.
    inputs
        Those of the system; the base's channels have variables of their own.
    readings
        Name and unit of each value that the sensors give.
    """
    names, units = [name for name, _ in readings], [unit for _, unit in readings]
    dataset = dataset.assign(
        sensor_reading=_signal(
            "reading", kept.reading, "newest known readings of the sensors", "reading_unit"
        )
    ).assign_coords(
        reading=("reading", names, {"long_name": "sensor and value"}),
        reading_unit=("reading", units, {"long_name": "unit of sensor_reading"}),
    )
    others = [each for each in inputs if each.name not in _CHANNELS]
    if kept.drive is None or kept.drive_command is None:
        return dataset
    return dataset.assign(
        actuator_command=_signal("input", kept.drive_command, "commands of the actuators"),
        actuator_state=_signal("input", kept.drive, "what the actuators drive the arm with"),
    ).assign_coords(
        input=("input", [each.name for each in others], {"long_name": "input of an actuator"}),
        input_unit=(
            "input",
            [each.unit for each in others],
            {"long_name": "unit of actuator_command and actuator_state"},
        ),
        input_lower=("input", [float(each.lower) for each in others], {"long_name": "lower limit"}),
        input_upper=("input", [float(each.upper) for each in others], {"long_name": "upper limit"}),
    )


def _signal(
    dim: str, values: ArrayLike, meaning: str, unit: str = "input_unit"
) -> tuple[tuple[str, str], np.ndarray, dict[str, str]]:
    # CF has no unit for a mixture
    return ("time", dim), np.asarray(values), {"long_name": meaning, "comment": f"in {unit}"}
