"""Errors of the tip over a run, from the time on that its scenario judges it."""

from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from jaxtyping import Bool, Float

from crinoid.results.result import Result
from crinoid.scenario import Scenario

_LAST = 0.1  # share of a run, at its end, that counts as steady
_ROUND = 1e-9  # round-off of times (s)

Instants = Bool[np.ndarray, " time"]


class TipError(NamedTuple):
    """Errors of the tip's position (m) or direction (rad) over the judged instants of a run.

    NaN where a run ended before them.
    """

    rms: float
    maximum: float
    steady: float  # mean over the last tenth of the run
    fluctuation: float
    """RMS distance of the tip from its own mean position, or angle from its own mean direction."""
    p95: float  # 95th percentile: the error that is exceeded 5 % of the time


_UNKNOWN = TipError(*[float("nan")] * len(TipError._fields))


def error_word(scenario: Scenario) -> str:
    """Return the noun for the distance of the tip from where it should be, or starts."""
    return "tip error" if scenario.aims else "tip displacement"


def judged(result: Result) -> Instants:
    """Return the saved instants from which errors count (``target.judged_from``)."""
    return judged_at(result.dataset["time"].values, result.scenario)


def judged_at(time: Float[np.ndarray, " time"], scenario: Scenario) -> Instants:
    """Return which times (s) count."""
    return np.asarray(time >= scenario.judged_from - _ROUND)


def judged_or_all(result: Result) -> Instants:
    """Return the instants that count in a chart: those judged, or all of a run that ended before.

    A scenario that this version cannot read judges all.
    """
    found = judged_at(result.dataset["time"].values, result.known_scenario)
    return found if found.any() else ~found


def steady_from(time: Any) -> Any:
    """Return the time (s) from which on a run with these instants counts as steady."""
    return time[-1] - _LAST * (time[-1] - time[0])


def tip_error(result: Result) -> TipError:
    """Return the errors of the tip's position."""
    data, counted = result.dataset, judged(result)
    if not counted.any():
        return _UNKNOWN
    tip = data["tip_position"].values
    wander = np.linalg.norm(tip - tip[counted].mean(axis=0), axis=1)
    return _sum_up(result, data["tip_error"].values, wander)


def uncontrolled_error(result: Result) -> TipError | None:
    """Return the errors of the tip's position without control; None where that was not run."""
    return None if result.uncontrolled is None else tip_error(result.uncontrolled)


def angle_error(result: Result) -> TipError | None:
    """Return the errors of the tip's direction (rad); None in a result without its target."""
    data, counted, error = result.dataset, judged(result), off_direction(result.dataset)
    if error is None:
        return None
    if not counted.any():
        return _UNKNOWN
    if "tip_direction" in data:
        direction = data["tip_direction"].values
        return _sum_up(result, error, angle_between(direction, direction[counted].mean(axis=0)))
    angle = data["tip_angle"].values
    return _sum_up(result, error, np.abs(angle - angle[counted].mean()))


def off_direction(data: xr.Dataset) -> Float[np.ndarray, " time"] | None:
    """Return the angle (rad) between the tip's direction and its target; None without one."""
    if {"tip_direction", "tip_direction_target"} <= set(data):
        return angle_between(data["tip_direction"].values, data["tip_direction_target"].values)
    if {"tip_angle", "tip_angle_target"} <= set(data):
        return np.abs(short_way(data["tip_angle"].values - data["tip_angle_target"].values))
    return None


def angle_between(
    one: Float[np.ndarray, "time axis=3"], other: Float[np.ndarray, "*time axis=3"]
) -> Float[np.ndarray, " time"]:
    """Return the angle between directions (rad), exact also where it is small."""
    sine = np.linalg.norm(np.cross(one, other), axis=-1)
    return np.asarray(np.arctan2(sine, np.sum(one * other, axis=-1)))


def short_way(turn: Float[np.ndarray, "*time"]) -> Float[np.ndarray, "*time"]:
    """Return turns (rad) the short way round, from -pi to pi."""
    return np.asarray(turn - 2 * np.pi * np.round(turn / (2 * np.pi)))


def within_tolerance(result: Result) -> float | None:
    """Return the share of the judged instants with a tip error within ``target.tolerance``."""
    tolerance, counted = result.scenario.target.tolerance, judged(result)
    if tolerance is None or not counted.any():
        return None
    return float(np.mean(result.dataset["tip_error"].values[counted] <= tolerance))


def deflection(result: Result) -> float | None:
    """Return the mean distance of the tip from its target without control, when steady (m).

    From the run without control, or from this run if it has no controller; else None.
    """
    if result.uncontrolled is not None:
        return tip_error(result.uncontrolled).steady
    return None if result.scenario.control.acts else tip_error(result).steady


def rms(values: Float[np.ndarray, " time"]) -> float:
    """Return the root mean square."""
    return float(np.sqrt(np.mean(values**2)))


def p95(values: Float[np.ndarray, " time"]) -> float:
    """Return the 95th percentile."""
    return float(np.quantile(values, 0.95))


def _sum_up(
    result: Result, error: Float[np.ndarray, " time"], wander: Float[np.ndarray, " time"]
) -> TipError:
    time, counted = result.dataset["time"].values, judged(result)
    steady = counted & (time >= steady_from(time))
    error_then, found = error[counted], float(np.mean(error[steady]))
    return TipError(
        rms(error_then), float(np.max(error_then)), found, rms(wander[counted]), p95(error_then)
    )
