"""Effort of a run: motion of the inputs and work, from the time that counts; pressure, thrust."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import xarray as xr
from jaxtyping import Float

from crinoid.foundation.axes import ANGLES, POSE
from crinoid.results.drives import actuator_drives
from crinoid.results.errors import judged, rms, short_way
from crinoid.results.result import Result
from crinoid.scenario import Scenario

EFFORT_TIME = 0.01
"""Time constant that weighs the speed of inputs against the error of the tip (s)."""
_AT_LIMIT = 1 - 1e-6  # share of the largest thrust that counts as its limit


class InputUse(NamedTuple):
    """Use of an input: motion of a servo (m or rad), or drive of an actuator in its unit."""

    rms: float
    low: float
    high: float
    lower: float
    upper: float

    @property
    def share(self) -> float:
        """Largest part of the way from 0 to a limit."""
        ways = ((self.low, self.lower), (self.high, self.upper))
        return max(0.0, *(value / limit for value, limit in ways if limit))


class VehicleUse(NamedTuple):
    """Motion of a floating vehicle, and the use of its thrusters."""

    excursion: float  # largest distance of its centre of mass from the start (m)
    turn: float  # largest pan, tilt or roll from the start (rad)
    max_thrust: float  # N
    rms_thrust: float  # N
    limit_share: float | None
    """Share of the time with a force or moment at its limit; None without a limit."""


class SolverUse(NamedTuple):
    """Use of the time integration."""

    simulated: float  # time that was simulated (s)
    steps: int
    iterations_a_step: float  # Newton iterations a time step
    wall_time: float  # computing time (s)


def solver_use(result: Result) -> SolverUse:
    """Return the use of the time integration."""
    data = result.dataset
    steps, iterations = (int(data[name].sum()) for name in ("steps", "newton_iterations"))
    times = float(data["time"][-1]), float(data.attrs["wall_time"])
    return SolverUse(times[0], steps, iterations / max(1, steps), times[1])


def input_use(result: Result) -> dict[str, InputUse]:
    """Return the use of each input that a controller drives; empty without a controller."""
    data, counted = result.dataset, judged(result)
    if not counted.any():
        return {}
    found = {}
    for name in result.scenario.driven:
        values, of = driven(data, name)[counted], "channel" if name in data["channel"] else "input"
        limits = (float(data[f"{of}_{end}"].sel({of: name})) for end in ("lower", "upper"))
        found[name] = InputUse(rms(values), float(values.min()), float(values.max()), *limits)
    return found


def input_units(data: xr.Dataset) -> dict[str, str]:
    """Return the units of channels and other inputs by their names."""
    pairs = [("channel", "channel_unit"), *([("input", "input_unit")] if "input" in data else [])]
    return {
        str(name): str(unit)
        for names, units in pairs
        for name, unit in zip(data[names].values, data[units].values, strict=True)
    }


def speed_unit(unit: str) -> str:
    """Return the unit of the speed of an input."""
    return "s-1" if unit == "1" else f"{unit} s-1"


def driven(data: xr.Dataset, name: str) -> Float[np.ndarray, " time"]:
    """Return the displacement of a channel's servo, or the drive of an actuator."""
    if name in data["channel"]:
        return np.asarray(data["base_servo"].sel(channel=name).values)
    return np.asarray(data["actuator_state"].sel(input=name).values)


def input_speed(result: Result) -> dict[str, float]:
    """Return the RMS speed of each input that can move, a controller or not.

    Speeds are means between saved instants: of a servo's displacement (m/s or rad/s), or of the
    drive of an actuator in its unit per s.
    """
    data, counted = result.dataset, judged(result)
    span = np.diff(data["time"].values[counted])
    moves = data["channel_lower"].values < data["channel_upper"].values
    names = [*data["channel"].values[moves], *(data["input"].values if "input" in data else ())]
    if not span.size:
        return {str(name): float("nan") for name in names}
    found = {str(name): np.diff(driven(data, name)[counted]) for name in names}
    return {
        name: float(np.sqrt(np.sum(move**2 / span) / span.sum())) for name, move in found.items()
    }


class CostWeights(NamedTuple):
    """Weights that turn errors and inputs into metres: the arm's length for angles and shares."""

    pose: tuple[float, ...]
    """Weights of the errors of the tip's pose; 0 for coordinates that are not controlled."""
    inputs: tuple[float, ...]  # weights of the commands

    @staticmethod
    def of(scenario: Scenario, units: Sequence[str]) -> "CostWeights":
        """Return the weights of a scenario with inputs in some units."""
        length, axes = scenario.arm.length, scenario.arm.dimension
        controlled = scenario.control.controlled
        pose = [
            (1.0 if index < axes else length) * (name.partition("_")[0] in controlled)
            for index, name in enumerate(POSE[axes])
        ]
        return CostWeights(tuple(pose), tuple(1.0 if unit == "m" else length for unit in units))


def control_cost(result: Result) -> float | None:
    """Return the cost of a controller (m): error and input speeds, root mean square.

    It is the root of ``mean |W e|^2 + tau^2 mean |L du/dt|^2`` with the error ``e`` of the
    controlled coordinates of the tip, the commands ``u``, the time constant `EFFORT_TIME` and
    `CostWeights`. Speeds are means between saved instants.
    """
    data, counted = result.dataset, judged(result)
    turning = "tip_angle" if data.sizes["axis"] == 2 else "tip_direction"
    if counted.sum() < 2 or not {f"{turning}_target", "tip_target", "base_command"} <= set(data):
        return None
    turn = (data[turning] - data[f"{turning}_target"]).values.reshape(counted.size, -1)
    if turning == "tip_angle":
        turn = short_way(turn)
    error = np.hstack([(data["tip_position"] - data["tip_target"]).values, turn])
    command = data["base_command"].values
    if "actuator_command" in data:
        command = np.hstack([command, data["actuator_command"].values])
    weights = CostWeights.of(result.scenario, list(input_units(data).values()))
    moves = np.diff(weights.inputs * command[counted], axis=0)
    speeds = EFFORT_TIME * moves / np.diff(data["time"].values[counted])[:, None]
    squares = [np.mean(np.sum(x**2, axis=1)) for x in (weights.pose * error[counted], speeds)]
    return float(np.sqrt(sum(squares)))


def spent_work(result: Result) -> float:
    """Return the work of base and actuators on the arm (J), without the work that it returned.

    The sum of the increases from one saved instant to the next.
    """
    work = result.dataset["energy"].sel(kind="actuation").values[judged(result)]
    if not work.size:
        return float("nan")
    return float(np.sum(np.maximum(np.diff(work), 0.0)))


def largest_pressure(result: Result) -> float | None:
    """Return the largest pressure in a chamber over the saved instants (Pa); None without any.

    Shares give it where the pressure is set, and ``line_load`` where the volume is.
    """
    data = result.dataset
    drives = [each for each in actuator_drives(result) if each.thread is not None]
    found = [np.abs(each.state).max() for each in drives if each.unit == "Pa"]
    if "line_load" in data:
        fluid = data["line_unit"].values == "Pa"
        found += [load.max() for load in data["line_load"].values[:, fluid].T]
    return float(max(found)) if found else None


def vehicle_use(result: Result) -> VehicleUse | None:
    """Return the use of a floating vehicle, from the start; None without one."""
    data, vehicle = result.dataset, result.scenario.vehicle
    if vehicle is None or "vehicle_pose" not in data:
        return None
    pose = data["vehicle_pose"].values
    turns = np.isin(data["channel"].values, list(ANGLES))
    force = data["thruster_force"].values
    moment = data["thruster_moment"].values.reshape(len(force), -1)
    thrust = np.linalg.norm(force, axis=1)
    limits = {"max_force": force, "max_moment": moment}
    reached = [
        np.any(np.abs(values) >= _AT_LIMIT * limit, axis=1)
        for name, values in limits.items()
        if vehicle.hold == "thrusters" and (limit := getattr(vehicle, name)) is not None
    ]
    return VehicleUse(
        float(np.linalg.norm(pose[:, ~turns], axis=1).max()),
        float(np.abs(pose[:, turns]).max()),
        float(thrust.max()),
        rms(thrust),
        float(np.mean(np.any(reached, axis=0))) if reached else None,
    )
