"""How a control loop did: limits that it met, swings of its own, whether it helped."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import xarray as xr
from jaxtyping import Bool, Float

from crinoid.result import Result
from crinoid.scenario import Scenario, SineFlow, WavesFlow
from crinoid.space import CHANNELS

_AT_END = 1e-3
"""Share of a channel's travel within which it is at the end of it."""
_AT_SPEED, _AT_ACCELERATION = 0.99, 0.95
"""Share of a limit that differences between saved instants reach when it is met."""
_OFTEN = {"range": 0.02, "speed": 0.1, "acceleration": 0.1}
"""Share of the time at a limit from which on it is worth a note."""

_OF_LIMITS = (
    *("base_servo", "channel_lower", "channel_upper", "channel_max_speed"),
    *("channel_max_acceleration", "actuator_command"),
)
"""Variables that tell whether an input is at a limit."""

_WINDOWS = 6
_RISE, _GROWN = 1.25, 3.0
"""By how much the error rises from one window to the next, and over the last four."""

_NARROW = 0.6
"""Share of the variance in one narrow band that makes it one oscillation."""
_LOBE = 2
"""Half-width of a line in a spectrum through a Hann window, in lines."""
_CYCLES = 8
_LASTING = 0.7
_OWN = 2.0
"""By how much it is larger than without control."""
_SEEN = 1e-3
"""Amplitude over the length of the arm from which on an oscillation is one."""
_WORSE = 1.05
"""Error over that without control from which on control makes it worse."""
_NOTHING = 1e-4
"""Error over the length of the arm below which there is nothing to compare."""


class AtLimit(NamedTuple):
    """Share of the time that an input spends at each of its limits while it is controlled."""

    range: float
    speed: float
    acceleration: float


class Cycle(NamedTuple):
    """An oscillation that the loop keeps up by itself."""

    frequency: float
    """Hz."""
    amplitude: float
    """RMS of the tip's error (m)."""


def limits_met(result: Result) -> dict[str, AtLimit]:
    """Return how much of the time each driven input is at its limits, by saved instants.

    The ends of a channel's travel count once it has left the position that it begins in. Of other
    inputs the ends of their commands count, but that they are at rest.
    """
    scenario, data = result.scenario, result.dataset
    if scenario.control.kind == "none" or "channel_lower" not in data:  # of an earlier version
        return {}
    data = data[[name for name in _OF_LIMITS if name in data]].isel(time=_controlled(result))
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
    return AtLimit(
        float(np.mean(ends)),
        _share(np.abs(speed) >= _AT_SPEED * float(data["channel_max_speed"])),
        _share(np.abs(acceleration) >= _AT_ACCELERATION * float(data["channel_max_acceleration"])),
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


def growth(result: Result) -> float | None:
    """Return by how much the tip's error grows from the middle of a run to its end; none if not.

    It counts as growing where the RMS over sixths of the controlled time rises three times in a
    row, each time by a quarter or more, and at least twice as much as without control.
    """
    windows = _windows(result, _controlled(result))
    if windows is None:
        return None
    late = windows[-4:]
    rise = float(late[-1] / max(late[0], np.finfo(float).tiny))
    small = late[-1] < _NOTHING * result.scenario.arm.length
    if small or rise < _GROWN or np.any(late[1:] < _RISE * late[:-1]):
        return None
    if result.uncontrolled is not None:
        other = _windows(result.uncontrolled, _controlled(result))
        if other is not None and other[-1] > 0.5 * rise * other[-4]:
            return None
    return rise


def limit_cycle(result: Result) -> Cycle | None:
    """Return the oscillation that the loop keeps up by itself; none if there is none.

    It is a narrow band that holds most of the variance of the tip's error in the last half of the
    controlled time, does not die down, and is not there without control. With nothing to compare
    with there must be nothing else that swings.
    """
    scenario = result.scenario
    which = np.flatnonzero(_controlled(result))
    which = which[which.size // 2 :]
    if scenario.control.kind == "none" or which.size < 4 * _CYCLES:
        return None
    if result.uncontrolled is None and _driven(scenario):
        return None
    error, interval = _evenly(result.dataset, which)
    power = _spectrum(error)
    total = power[1:].sum()
    line = int(np.argmax(power[1:])) + 1
    band = slice(max(1, line - _LOBE), line + _LOBE + 1)
    own = power[band].sum()
    amplitude = float(np.sqrt(own))
    half = error.shape[0] // 2
    first, second = (
        _spectrum(part)[max(1, line // 2 - _LOBE) : line // 2 + _LOBE + 1].sum()
        for part in (error[:half], error[half:])
    )
    if (
        line < _CYCLES
        or own < _NARROW * total
        or amplitude < _SEEN * scenario.arm.length
        or second < _LASTING**2 * first
    ):
        return None
    if result.uncontrolled is not None:
        data = result.uncontrolled.dataset
        if data.sizes["time"] <= which[-1]:
            return None
        other = _spectrum(_evenly(data, which)[0])[band].sum()
        if own < _OWN**2 * other:
            return None
    return Cycle(line / (error.shape[0] * interval), amplitude)


def comparison(result: Result) -> tuple[float, float] | None:
    """Return the RMS tip error with control and without (m), while it is on.

    None without both, and where control is on for less than the arm's first period.
    """
    if result.uncontrolled is None:
        return None
    which = _controlled(result)
    on = float(np.ptp(result.dataset["time"].values[which])) if which.any() else 0.0
    if "natural_frequency" in result.dataset:
        first = float(result.dataset["natural_frequency"][0])
        if on * first < 1 and first > 0:
            return None
    runs = (result.dataset, result.uncontrolled.dataset)
    count = min(which.size, *(data.sizes["time"] for data in runs))
    which = which[:count]
    if not which.any():
        return None
    with_, without = (
        float(np.sqrt(np.mean(data["tip_error"].values[:count][which] ** 2))) for data in runs
    )
    return with_, without


def loop_notes(result: Result) -> list[str]:
    """Return sentences about how the loop did; none where all was well or nothing controlled."""
    scenario = result.scenario
    if scenario.control.kind == "none":
        return []
    found = []
    for name, met in limits_met(result).items():
        shares = {kind: share for kind, share in met._asdict().items() if share >= _OFTEN[kind]}
        if shares:
            told = " and ".join(f"{kind} for {share:.1%}" for kind, share in shares.items())
            key, noun = name, "input"
            if name in CHANNELS[3]:
                key, noun = f"base.channels.{name}", "channel"
            found.append(
                f"{key}: at its limit of {told} of the time: the loop asks for more than the "
                f"{noun} has"
            )
    grown, cycle, compared = growth(result), limit_cycle(result), comparison(result)
    if grown is not None:
        alone = ", and not so without control" * (result.uncontrolled is not None)
        found.append(
            f"the tip's error grows, {grown:.3g} times from the middle of the run to its end{alone}"
            ": the loop may be unstable, or a channel at its limit"
        )
    elif cycle is not None:
        found.append(
            f"the tip swings at {cycle.frequency:.2g} Hz with {1e3 * cycle.amplitude:.2g} mm RMS, "
            "which nothing but the loop does: it is in a limit cycle; try lower gains"
        )
    if compared is not None and compared[0] > max(
        _WORSE * compared[1], _NOTHING * scenario.arm.length
    ):
        found.append(
            f"control makes it worse: the tip's error is {1e3 * compared[0]:.3g} mm RMS with it "
            f"and {1e3 * compared[1]:.3g} mm without"
        )
    return found


def _controlled(result: Result) -> Bool[np.ndarray, " time"]:
    time = result.dataset["time"].values
    return time >= result.scenario.control.start - 1e-9


def _windows(
    result: Result, which: Bool[np.ndarray, " time"]
) -> Float[np.ndarray, " window"] | None:
    """Return the RMS tip error over equal parts of a run; none where it is too short for them."""
    error = result.dataset["tip_error"].values
    error = error[which[: error.size]] if which.size >= error.size else error[: which.size][which]
    if error.size < 4 * _WINDOWS:
        return None
    return np.array([np.sqrt(np.mean(part**2)) for part in np.array_split(error, _WINDOWS)])


def _evenly(data: xr.Dataset, which: np.ndarray) -> tuple[Float[np.ndarray, "time axis"], float]:
    """Return the tip's error as vectors, at even times, and the time between two (s)."""
    error = (data["tip_position"] - data["tip_target"]).values[which]
    time = data["time"].values[which]
    even = np.linspace(time[0], time[-1], time.size)
    columns = [np.interp(even, time, column) for column in error.T]
    return np.stack(columns, axis=1), float(even[1] - even[0])


def _spectrum(error: Float[np.ndarray, "time axis"]) -> Float[np.ndarray, " line"]:
    """Return the variance in each line, through a Hann window and without the trend (m2)."""
    along = np.linspace(-1.0, 1.0, error.shape[0])[:, None]
    error = error - error.mean(axis=0)
    error = error - along * np.sum(along * error, axis=0) / np.sum(along**2)
    window = np.hanning(error.shape[0])
    lines = np.fft.rfft(error * window[:, None], axis=0)
    return 2 * np.sum(np.abs(lines) ** 2, axis=1) / (error.shape[0] * np.sum(window**2))


def _driven(scenario: Scenario) -> bool:
    """Return whether anything but the loop makes the tip swing, or its target."""
    waves = any(isinstance(flow, SineFlow | WavesFlow) for flow in scenario.flow)
    return waves or bool(scenario.base.motion) or scenario.target.moves


def _share(true: np.ndarray) -> float:
    return float(np.mean(true)) if true.size else 0.0
