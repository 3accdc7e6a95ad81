"""Figures that sum up a run: how far the tip was off, what the base did and what it had to bear."""

from typing import NamedTuple

import numpy as np
import xarray as xr
from jaxtyping import Float

from crinoid.result import Result

_LAST = 0.1
"""The part of a run, at its end, that counts as steady."""
_BAND = 0.05
"""A tip has settled when its error stays within this part of the largest one without control."""


class TipError(NamedTuple):
    """Errors of the tip of one run over its saved instants: of its position (m) or angle (rad)."""

    rms: float
    maximum: float
    steady: float
    """Mean over the last tenth of the run."""
    fluctuation: float
    """RMS distance of the tip from its own mean position, or angle from its own mean direction."""


class Use(NamedTuple):
    """Use of an input: motion of a servo (m or rad), or drive of an actuator in its unit."""

    rms: float
    low: float
    high: float


class Load(NamedTuple):
    """Largest load of the arm on the submarine over the saved instants of a run."""

    force: float
    """N."""
    moment: float
    """N m."""


def tip_error(result: Result) -> TipError:
    """Sum up the error of the tip's position."""
    data = result.dataset
    tip = data["tip_position"].values
    wander = np.linalg.norm(tip - tip.mean(axis=0), axis=1)
    return _sum_up(data["tip_error"].values, wander, _steady(result))


def angle_error(result: Result) -> TipError:
    """Sum up the angle (rad) between where the tip points and where it should."""
    data = result.dataset
    if "tip_direction" in data:
        direction = data["tip_direction"].values
        error = angle_between(direction, data["tip_direction_target"].values)
        wander = angle_between(direction, direction.mean(axis=0))
    else:
        angle = data["tip_angle"].values
        error = np.abs(short_way(angle - data["tip_angle_target"].values))
        wander = np.abs(angle - angle.mean())
    return _sum_up(error, wander, _steady(result))


def angle_between(
    one: Float[np.ndarray, "time axis=3"], other: Float[np.ndarray, "*time axis=3"]
) -> Float[np.ndarray, " time"]:
    """Return the angle between directions (rad), exact also where it is small."""
    sine = np.linalg.norm(np.cross(one, other), axis=-1)
    return np.asarray(np.arctan2(sine, np.sum(one * other, axis=-1)))


def short_way(turn: Float[np.ndarray, " time"]) -> Float[np.ndarray, " time"]:
    """Return turns (rad) the short way round, from -pi to pi."""
    return np.asarray(turn - 2 * np.pi * np.round(turn / (2 * np.pi)))


def input_use(result: Result) -> dict[str, Use]:
    """Sum up what each input did that a controller drives; empty without a controller."""
    found = {name: driven(result.dataset, name) for name in result.scenario.driven}
    return {
        name: Use(_rms(values), float(values.min()), float(values.max()))
        for name, values in found.items()
    }


def driven(data: xr.Dataset, name: str) -> Float[np.ndarray, " time"]:
    """Return what an input did: the servo's part of a channel, or the drive of an actuator."""
    if name in data["channel"]:
        return np.asarray(data["base_servo"].sel(channel=name).values)
    return np.asarray(data["actuator_state"].sel(input=name).values)


def input_speed(result: Result) -> dict[str, float]:
    """Return the RMS speed of each input that can move, a controller or not.

    Speeds are means between saved instants: of a servo's displacement (m/s or rad/s), or of the
    drive of an actuator in its unit per s.
    """
    data = result.dataset
    span = np.diff(data["time"].values)
    moves = data["channel_lower"].values < data["channel_upper"].values
    names = [*data["channel"].values[moves], *(data["input"].values if "input" in data else ())]
    found = {str(name): np.diff(driven(data, name)) for name in names}
    return {
        name: float(np.sqrt(np.sum(move**2 / span) / span.sum())) for name, move in found.items()
    }


def spent_work(result: Result) -> float:
    """Return the work that base and actuators did on the arm (J), less none that it gave back.

    The sum of what it rises by from one saved instant to the next.
    """
    work = result.dataset["energy"].sel(kind="actuation").values
    return float(np.sum(np.maximum(np.diff(work), 0.0)))


def peak_load(result: Result) -> Load:
    """Return the largest force and the largest moment of the arm on the submarine."""
    data = result.dataset

    def peak(variable: xr.DataArray) -> float:
        values = variable.values
        return float(np.max(np.linalg.norm(values, axis=1) if values.ndim == 2 else abs(values)))

    return Load(peak(data["base_force"]), peak(data["base_moment"]))


def settling_time(result: Result) -> float | None:
    """Return when the tip error last came into its band (s), or none if it ended outside.

    The band is 5 % of the largest error of the run without control, or of this run if there is
    none.
    """
    reference = result.uncontrolled if result.uncontrolled is not None else result
    band = _BAND * float(np.max(reference.dataset["tip_error"].values))
    time = result.dataset["time"].values
    outside = np.flatnonzero(result.dataset["tip_error"].values > band)
    if outside.size == 0:
        return float(time[0])
    if outside[-1] == time.size - 1:
        return None
    return float(time[outside[-1] + 1])


def deflection(result: Result) -> float | None:
    """Return how far the tip ends from its target without control, in the steady part (m).

    That is known from the run without control, or from this one if it has no controller; none
    where a controller ran and was not compared.
    """
    if result.uncontrolled is not None:
        return tip_error(result.uncontrolled).steady
    return tip_error(result).steady if result.scenario.control.kind == "none" else None


def _sum_up(
    error: Float[np.ndarray, " time"],
    wander: Float[np.ndarray, " time"],
    steady: np.ndarray,
) -> TipError:
    return TipError(_rms(error), float(np.max(error)), float(np.mean(error[steady])), _rms(wander))


def _rms(values: Float[np.ndarray, " time"]) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _steady(result: Result) -> np.ndarray:
    time = result.dataset["time"].values
    return time >= time[-1] - _LAST * (time[-1] - time[0])
