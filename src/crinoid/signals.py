"""Signals of a run in its dataset: readings of the sensors, commands and states of actuators."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from crinoid.actuation import Input
from crinoid.dynamics import Lines
from crinoid.record import Record
from crinoid.variables import Content, quantity


def signals(
    kept: Record,
    inputs: Sequence[Input],
    readings: Sequence[tuple[str, str]],
    lines: Lines | None = None,
) -> Content:
    """Return the signals of saved instants.

    Parameters
    ----------
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
    found = Content(
        {"sensor_reading": _signal("sensor_reading", kept.reading)},
        {
            "reading": ("reading", names, {"long_name": "sensor and value"}),
            "reading_unit": ("reading", units, {"long_name": "unit of sensor_reading"}),
        },
    )
    others = inputs[kept.servo.shape[-1] :]
    if kept.drive is None or kept.drive_command is None:
        return found
    if lines is not None and kept.line is not None:
        wound = [others[drive].name for drive in lines.drives]
        sides = ["_opposite" * (name in wound[:index]) for index, name in enumerate(wound)]
        found.variables["line_load"] = _signal("line_load", kept.line)
        found.coordinates["line"] = (
            "line",
            [name + side for name, side in zip(wound, sides, strict=True)],
            {"long_name": "tendon of given length or chamber of given volume"},
        )
        units = ["Pa" if fluid else "N" for fluid in lines.fluid]
        found.coordinates["line_unit"] = "line", units, {"long_name": "unit of line_load"}
    found.variables["actuator_command"] = _signal("actuator_command", kept.drive_command)
    found.variables["actuator_state"] = _signal("actuator_state", kept.drive)
    for name, values, meaning in (
        ("input", [each.name for each in others], "input of an actuator"),
        (
            "input_unit",
            [each.unit for each in others],
            "unit of actuator_command and actuator_state",
        ),
        ("input_lower", [float(each.lower) for each in others], "lower limit"),
        ("input_upper", [float(each.upper) for each in others], "upper limit"),
    ):
        found.coordinates[name] = "input", values, {"long_name": meaning}
    return found


def _signal(name: str, values: ArrayLike) -> tuple[tuple[str, ...], np.ndarray, dict[str, str]]:
    dims, found, about = quantity(name, np.asarray(values), 2)
    return dims, found, about | {"comment": f"in {dims[-1]}_unit"}  # CF has none for a mixture
