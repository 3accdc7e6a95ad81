"""Signals of a run in its dataset: readings of the sensors, commands and states of actuators."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from crinoid.actuation import Input
from crinoid.dynamics import Lines
from crinoid.record import Record
from crinoid.variables import quantity


def with_signals(
    dataset: xr.Dataset,
    kept: Record,
    inputs: Sequence[Input],
    readings: Sequence[tuple[str, str]],
    lines: Lines | None = None,
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
    lines
        Tendons of given length and chambers of given volume.
    """
    names, units = [name for name, _ in readings], [unit for _, unit in readings]
    dataset = dataset.assign(sensor_reading=_signal("sensor_reading", kept.reading)).assign_coords(
        reading=("reading", names, {"long_name": "sensor and value"}),
        reading_unit=("reading", units, {"long_name": "unit of sensor_reading"}),
    )
    others = inputs[dataset.sizes["channel"] :]
    if kept.drive is None or kept.drive_command is None:
        return dataset
    if lines is not None and kept.line is not None:
        wound = [others[drive].name for drive in lines.drives]
        sides = ["_opposite" * (name in wound[:index]) for index, name in enumerate(wound)]
        units = ["Pa" if fluid else "N" for fluid in lines.fluid]
        dataset = dataset.assign(line_load=_signal("line_load", kept.line)).assign_coords(
            line=(
                "line",
                [name + side for name, side in zip(wound, sides, strict=True)],
                {"long_name": "tendon of given length or chamber of given volume"},
            ),
            line_unit=("line", units, {"long_name": "unit of line_load"}),
        )
    return dataset.assign(
        actuator_command=_signal("actuator_command", kept.drive_command),
        actuator_state=_signal("actuator_state", kept.drive),
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


def _signal(name: str, values: ArrayLike) -> tuple[tuple[str, ...], np.ndarray, dict[str, str]]:
    dims, found, about = quantity(name, np.asarray(values), 2)
    return dims, found, about | {"comment": f"in {dims[-1]}_unit"}  # CF has none for a mixture
