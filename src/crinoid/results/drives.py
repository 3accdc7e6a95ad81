"""Drives of actuators in physical units: pressures, volumes, tensions and lengths."""

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from crinoid.results.result import Result
from crinoid.results.units import Unit, length_unit, power_of_ten, si_unit
from crinoid.scenario import Chamber, Tendon

_UNITS = {"max_pressure": "Pa", "max_volume": "m3", "max_tension": "N", "max_shortening": "m"}
_SMALL = 1e-3  # share below which it is written with a power of ten


class ActuatorDrive(NamedTuple):
    """Drive of an actuator over time."""

    name: str
    thread: Chamber | Tendon | None  # None for an actuator that is neither
    unit: str  # Pa, m3, N or m of chambers and tendons; of other actuators that of their input
    state: Float[np.ndarray, " time"]
    """What it drives the arm with; below 0 on the other side of a pair."""
    command: Float[np.ndarray, " time"]
    """Command of a controller, which adds to the constant drive and the schedule."""


def actuator_drives(result: Result) -> list[ActuatorDrive]:
    """Return the drives of all actuators; empty without any.

    The drive of a chamber or tendon is its share times ``max_pressure`` (Pa), ``max_volume`` (m3),
    ``max_tension`` (N) or ``max_shortening`` (m); a single tendon of given tension has its
    pretension too.
    """
    data, scenario = result.dataset, result.known_scenario
    if "actuator_state" not in data:
        return []
    found = []
    for name, unit in zip(data["input"].values, data["input_unit"].values, strict=True):
        each = [data[f"actuator_{part}"].sel(input=name).values for part in ("state", "command")]
        thread = scenario.threads.get(str(name))
        if thread is not None:
            unit = _UNITS[thread.largest_key]
            each = [thread.largest * part for part in each]
        if isinstance(thread, Tendon) and unit == "N" and not thread.pair:
            each[0] += thread.pretension
        found.append(ActuatorDrive(str(name), thread, str(unit), *each))
    return found


def drive_unit(unit: str, most: float) -> Unit:
    """Return the unit to read drives in: kPa of Pa, mL of m3, shares by a power of ten."""
    if unit in ("Pa", "m3"):
        return Unit(1e-3, "kPa") if unit == "Pa" else Unit(1e6, "mL")
    if unit == "m":
        return length_unit(most)
    if unit != "1":
        return si_unit(most, unit)
    power = math.floor(math.log10(most)) if 0.0 < most < _SMALL else 0
    return Unit(10.0**-power, f"{power_of_ten(power)} of share" if power else "share")
