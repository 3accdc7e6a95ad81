"""Measured current in a run: components along the axes of the arm, over the time of the run."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from crinoid.foundation.axes import ANGLES, CHANNELS
from crinoid.recording.response import VesselResponse
from crinoid.recording.selection import read_selection
from crinoid.recording.series import Series
from crinoid.scenario import Scenario, got, refusal
from crinoid.scenario.base_motion import InFile, ResponseMotion
from crinoid.scenario.flow import MeasuredFlow

_STRETCH = 1.1
"""Factor on the length of an arm; no current stretches one so far."""


def base_travel(scenario: Scenario, series: Mapping[str, Series | VesselResponse]) -> float:
    """Return how far channels and prescribed motions may shift the base (m).

    ``series`` are the motions from the files of the scenario, by key of their table.
    """
    base, dimension = scenario.base, scenario.arm.dimension
    travel, ridden = dict.fromkeys(CHANNELS[dimension], 0.0), 0.0
    for name, channel in base.channels.present.items():
        travel[name] += max(-channel.limits.low, channel.limits.high)
    for index, motion in enumerate(base.motion):
        read: Any = series.get(f"base.motion.{index}")
        if isinstance(motion, ResponseMotion):
            ridden += read.farthest
        elif isinstance(motion, InFile):
            ways = np.abs(read.values).max(axis=0)
            for name, way in zip(motion.moved(dimension), ways, strict=True):
                travel[name] += float(way)
        else:
            travel[motion.channel] += motion.farthest(scenario.simulation.duration)
    ways = [way for name, way in travel.items() if name not in ANGLES]
    return float(np.hypot.reduce(ways)) + ridden


_MEAN_OVER = 600.0
"""Time (s) of the mean current that carries a record past the arm."""
_FROZEN_BELOW = 0.5
"""Largest ratio of fluctuation to mean of a frozen pattern (Taylor's hypothesis)."""
_EVEN = 0.1
"""Largest deviation of an even interval, over the interval."""


@dataclass(frozen=True)
class Recording:
    """A measured current, ready for a run."""

    name: str
    """Name of the file."""
    time: Float[np.ndarray, " time"]
    """Time of the record (s) from its first sample."""
    levels: Float[np.ndarray, " level"] | None
    """Heights z (m), increasing, two or more; None for a record at one point."""
    velocity: Float[np.ndarray, "time level axis"]
    """Velocity (m/s) along the axes of the arm, as large as in the run."""
    filled: Bool[np.ndarray, "time level"]
    """Whether a value is missing in the file and interpolated."""
    slowness: Float[np.ndarray, " axis"]
    """Delay of the record in the time of the run, over distance (s/m)."""
    carried: bool
    """Whether the water carries it past the arm."""
    start: float
    """Time of the record (s) at the start of the run."""
    time_scale: float
    """Time of the run over time of the record."""
    delay: float
    """Longest delay, or lead, at the arm, in the time of the run (s)."""
    notes: tuple[str, ...]
    """Assumptions, filled gaps and omitted levels, a sentence each."""

    @property
    def run_time(self) -> Float[np.ndarray, " time"]:
        """Times of the run (s) at which the record passes the root of the arm."""
        return (self.time - self.start) * self.time_scale

    def holes(
        self, times: Float[np.ndarray, " run"], low: float, high: float
    ) -> Bool[np.ndarray, " run"]:
        """Return whether values are missing between two heights, at times of the run (s)."""
        near = slice(None)
        if self.levels is not None:
            last = self.levels.size - 1
            first = int(np.clip(np.searchsorted(self.levels, low, side="right") - 1, 0, last))
            end = int(np.clip(np.searchsorted(self.levels, high), first, last))
            near = slice(first, end + 1)
        lacking: np.ndarray = np.any(self.filled[:, near], axis=1)
        after = np.clip(np.searchsorted(self.run_time, times), 1, lacking.size - 1)
        return np.asarray(lacking[after] | lacking[after - 1])

    @property
    def length(self) -> float:
        """Duration of the record (s)."""
        return float(self.time[-1])

    @property
    def interval(self) -> float:
        """Usual time between two samples (s)."""
        return float(np.median(np.diff(self.time)))


def read_recording(
    flow: MeasuredFlow, scenario: Scenario, series: Mapping[str, Series | VesselResponse]
) -> Recording:
    """Read the current of a flow, fill its gaps, and place it in the time of a run.

    ``series`` are as in `base_travel`.
    """
    planar, depth = scenario.arm.dimension == 2, scenario.water.depth
    whole = read_selection(flow, None if depth is None else -depth)
    notes, levels, velocity = whole.remarks, whole.levels, flow.velocity_scale * whole.velocity
    filled = np.asarray(whole.filled)
    if levels is not None:
        order = np.argsort(levels)
        levels, velocity, filled = levels[order], velocity[:, order], filled[:, order]
        root, tilt = scenario.base.position[-1], math.radians(scenario.base.tilt_deg)
        low, high = sorted((root, root + scenario.arm.length * math.sin(tilt)))
        if not (levels[0] <= low and high <= levels[-1]):
            arm = f"{low:.4g}" if high - low < 1e-9 else f"{low:.4g} to {high:.4g}"
            notes.append(
                f"the arm at rest is at z = {arm} m and the levels at {levels[0]:.4g} to "
                f"{levels[-1]:.4g} m: outside, the current of the nearest level is taken"
            )
    if flow.low_pass_hz is not None:
        velocity = _low_pass(whole.time, velocity, flow.low_pass_hz)
    if flow.heading_deg is not None:  # x has a compass heading, y is to port
        sine, cosine = np.sin(np.deg2rad(flow.heading_deg)), np.cos(np.deg2rad(flow.heading_deg))
        velocity = velocity @ np.array([[sine, -cosine, 0.0], [cosine, sine, 0.0], [0.0, 0.0, 1.0]])
    if flow.skip >= whole.time[-1]:
        must = f"be below {whole.time[-1]:.6g} (s), the duration of the record"
        raise refusal("skip", got(flow.skip, must))
    axes = [0, -1] if planar else [0, 1, 2]
    if planar and velocity.shape[-1] == 3:
        across = float(np.sqrt(np.mean(velocity[..., 1] ** 2)))
        speed = float(np.sqrt(np.mean(np.sum(velocity**2, axis=-1))))
        if across > 0.1 * speed:
            notes.append(
                f"{across:.3g} m/s RMS of {speed:.3g} m/s cross the plane that the arm moves in "
                "and are left out: see heading_deg"
            )
    profile = levels is not None and levels.size > 1
    slowness = np.zeros(velocity.shape[-1])
    if flow.phase_speed is not None:
        slowness[0] = 1 / flow.phase_speed
    elif not profile:
        slowness = _frozen(whole.time, velocity[:, 0], flow.skip, notes)
    velocity, slowness = velocity[..., axes], slowness[axes]
    reach = _STRETCH * scenario.arm.length + base_travel(scenario, series)
    delay = reach * float(np.linalg.norm(slowness))
    start = max(flow.skip, delay / flow.time_scale)
    run = scenario.simulation.duration / flow.time_scale
    _check_length(flow, run, whole.time[-1], start, delay / flow.time_scale)
    return Recording(
        name=Path(flow.file).name,
        time=whole.time,
        levels=levels if profile else None,
        velocity=velocity,
        filled=filled,
        slowness=slowness,
        carried=flow.phase_speed is None and bool(np.any(slowness)),
        start=start,
        time_scale=flow.time_scale,
        delay=delay,
        notes=tuple(notes),
    )


def _frozen(
    time: Float[np.ndarray, " time"],
    velocity: Float[np.ndarray, "time axis"],
    skip: float,
    notes: list[str],
) -> Float[np.ndarray, " axis"]:
    """Return the slowness of a frozen pattern (s/m), 0 where fluctuations are too large for one."""
    # over ten minutes or at least two samples: it does not depend on the duration of the run
    first = min(int(np.searchsorted(time, skip)), time.size - 2)
    end = int(np.searchsorted(time, skip + _MEAN_OVER, side="right"))
    sample = velocity[first : max(end, first + 2)]
    mean, fluctuation = sample.mean(axis=0), float(np.sqrt(sample.var(axis=0).mean()))
    size = np.linalg.norm(mean)
    if 0 < fluctuation <= _FROZEN_BELOW * size:
        return mean / (mean @ mean)
    if fluctuation > 0:
        notes.append(
            f"fluctuations of {fluctuation:.3g} m/s about a mean of {size:.3g} m/s are no frozen "
            "pattern that drifts past the arm: the water moves as one"
        )
    return np.zeros_like(mean)


def _low_pass(
    time: Float[np.ndarray, " time"], velocity: Float[np.ndarray, "time level axis"], cut: float
) -> Float[np.ndarray, "time level axis"]:
    """Filter forward and backward, without delay (Butterworth, order 4 each way)."""
    from scipy.signal import butter, sosfiltfilt  # slow to load, and few scenarios need it

    steps = np.diff(time)
    rate = 1 / float(np.mean(steps))
    if np.abs(steps * rate - 1).max() > _EVEN:
        text = f"samples are {steps.min():.4g} to {steps.max():.4g} s apart"
        raise refusal("low_pass_hz", text, "be at even intervals for a filter")
    if cut >= rate / 2:
        must = f"be below {rate / 2:.6g} (Hz), half the rate of the record"
        raise refusal("low_pass_hz", got(cut, must))
    sections = butter(4, cut, output="sos", fs=rate)
    # reflected at its ends for as long as the filter rings
    padding = min(time.size - 1, int(3 * rate / cut))
    return sosfiltfilt(sections, velocity, axis=0, padlen=padding)


def _check_length(
    flow: MeasuredFlow, run: float, length: float, start: float, delay: float
) -> None:
    """Refuse a record that is too short for a ``run``; all times are those of the record (s)."""
    needed = start + run + delay
    if needed <= length * (1 + 1e-9):
        return
    parts = [f"simulation.duration / time_scale = {run:.6g} s"]
    if flow.skip > 0:
        parts.append(f"skip = {flow.skip:.6g} s")
    if delay > 0:
        parts.append(f"{needed - run - flow.skip:.4g} s to drift past the arm")
    text = f"{Path(flow.file).name} lasts {length:.6g} s"
    raise refusal("file", text, f"last at least {needed:.6g} s: {', '.join(parts)}")
