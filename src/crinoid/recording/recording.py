"""A current as a run plays it: components along the arm's axes, laid over the run's time."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

from crinoid.recording.file import cut_out
from crinoid.recording.gaps import fill
from crinoid.recording.refusal import refusal
from crinoid.recording.stage import Stage
from crinoid.scenario.measured import MeasuredFlow

_MEAN_OVER = 600.0
"""Time (s) over which the current that carries a record past the arm is the mean."""
_FROZEN_BELOW = 0.5
"""Fluctuation over mean up to which the pattern of a current drifts along as if it were frozen."""
_EVEN = 0.1
"""Part of an interval by which samples that a filter takes for even may be off."""


@dataclass(frozen=True)
class Recording:
    """A measured current, ready to be played."""

    name: str
    """Name of the file."""
    time: Float[np.ndarray, " time"]
    """Time of the record (s) from its first sample."""
    levels: Float[np.ndarray, " level"] | None
    """Heights z (m), increasing, two or more; None for a record at one point."""
    velocity: Float[np.ndarray, "time level axis"]
    """Velocity (m/s) along the axes of the arm, as large as in the run."""
    filled: Bool[np.ndarray, "time level"]
    """Whether the file lacks something, which was filled by straight lines."""
    slowness: Float[np.ndarray, " axis"]
    """By how much the record comes later, in the time of the run, over distance (s/m)."""
    begins: float
    """Time of the record (s) when the run begins."""
    time_scale: float
    """Time of the run over time of the record."""
    stage: Stage
    """The run that it is laid over."""
    notes: tuple[str, ...]
    """Assumptions, filled gaps and levels left out, a sentence each."""

    @property
    def run_time(self) -> Float[np.ndarray, " time"]:
        """Times of the run (s) at which the record is met at the arm's root."""
        return (self.time - self.begins) * self.time_scale

    def holes(
        self, times: Float[np.ndarray, " run"], low: float, high: float
    ) -> Bool[np.ndarray, " run"]:
        """Return at which times of the run (s) the record lacks something between two heights."""
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
        """How long the record is (s)."""
        return float(self.time[-1])

    @property
    def interval(self) -> float:
        """Usual time between two samples (s)."""
        return float(np.median(np.diff(self.time)))


def read_recording(flow: MeasuredFlow, stage: Stage) -> Recording:
    """Read the current of a flow, mend it, and lay it over a run."""
    found = cut_out(flow, stage.bed)
    whole = fill(found.time, found.levels, found.velocity, list(flow.velocity))
    notes = [*found.remarks, *whole.remarks]
    levels, velocity = whole.levels, flow.velocity_scale * whole.velocity
    filled = np.asarray(whole.filled)
    if levels is not None:
        order = np.argsort(levels)
        levels, velocity, filled = levels[order], velocity[:, order], filled[:, order]
    if flow.low_pass_hz is not None:
        velocity = _low_pass(whole.time, velocity, flow.low_pass_hz)
    if flow.heading_deg is not None:
        velocity = _turn(velocity, np.deg2rad(flow.heading_deg))
    profile = levels is not None and levels.size > 1
    if levels is not None:
        notes += _outside(levels, stage)
    if flow.skip >= whole.time[-1]:
        text = f"got {flow.skip}, takes less than {whole.time[-1]:.6g} (s), the record's length"
        raise refusal("skip", text)
    mean, fluctuation = _carrier(whole.time, velocity[:, 0], flow.skip)
    kept = [0, 1, 2]
    if stage.dimension == 2:
        notes += _crossing(velocity)
        kept = [0, -1]
    slowness = np.zeros_like(mean)
    if not profile:
        if 0 < fluctuation <= _FROZEN_BELOW * np.linalg.norm(mean):
            slowness = mean / (mean @ mean)
        elif fluctuation > 0:
            notes.append(
                f"fluctuations of {fluctuation:.3g} m/s about a mean of {np.linalg.norm(mean):.3g} "
                "m/s are no frozen pattern that drifts past the arm: the water moves as one"
            )
    velocity, slowness = velocity[..., kept], slowness[kept]
    delay = stage.reach * float(np.linalg.norm(slowness)) / flow.time_scale
    begins = max(flow.skip, delay)
    _check_length(flow, stage, whole.time[-1], begins, delay)
    return Recording(
        name=Path(flow.file).name,
        time=whole.time,
        levels=levels if profile else None,
        velocity=velocity,
        filled=filled,
        slowness=slowness,
        begins=begins,
        time_scale=flow.time_scale,
        stage=stage,
        notes=tuple(notes),
    )


def _turn(
    velocity: Float[np.ndarray, "time level enu=3"], heading: float
) -> Float[np.ndarray, "time level xyz=3"]:
    """Turn east, north and up into x, y and z, where x points along a compass heading (rad).

    y is to port.
    """
    east, north, up = np.moveaxis(velocity, -1, 0)
    sine, cosine = np.sin(heading), np.cos(heading)
    return np.stack([sine * east + cosine * north, sine * north - cosine * east, up], axis=-1)


def _low_pass(
    time: Float[np.ndarray, " time"], velocity: Float[np.ndarray, "time level axis"], cut: float
) -> Float[np.ndarray, "time level axis"]:
    """Filter forth and back, so that nothing is delayed (Butterworth, order 4 each way)."""
    from scipy.signal import butter, sosfiltfilt  # slow to load, and few scenarios need it

    steps = np.diff(time)
    rate = 1 / float(np.mean(steps))
    if np.abs(steps * rate - 1).max() > _EVEN:
        text = f"takes samples at even intervals; they lie {steps.min():.4g} to {steps.max():.4g} s"
        raise refusal("low_pass_hz", f"{text} apart")
    if cut >= rate / 2:
        text = f"got {cut}, takes a number below {rate / 2:.6g} (Hz), half the record's rate"
        raise refusal("low_pass_hz", text)
    sections = butter(4, cut, output="sos", fs=rate)
    # reflected at its ends for as long as the filter rings
    padding = min(time.size - 1, int(3 * rate / cut))
    return sosfiltfilt(sections, velocity, axis=0, padlen=padding)


def _carrier(
    time: Float[np.ndarray, " time"], velocity: Float[np.ndarray, "time axis"], skip: float
) -> tuple[Float[np.ndarray, " axis"], float]:
    """Return the mean velocity where the run begins, and the RMS of a component about it (m/s).

    Over ten minutes of the record, or the least that has two samples: the same for a run that is
    prolonged.
    """
    first = min(int(np.searchsorted(time, skip)), time.size - 2)
    last = max(int(np.searchsorted(time, skip + _MEAN_OVER, side="right")), first + 2)
    window = velocity[first:last]
    return window.mean(axis=0), float(np.sqrt(window.var(axis=0).mean()))


def _crossing(velocity: Float[np.ndarray, "time level axis"]) -> list[str]:
    """Say how much of a current does not lie in the arm's plane."""
    if velocity.shape[-1] == 2:
        return []
    across = float(np.sqrt(np.mean(velocity[..., 1] ** 2)))
    whole = float(np.sqrt(np.mean(np.sum(velocity**2, axis=-1))))
    if across <= 0.1 * whole:
        return []
    return [
        f"{across:.3g} m/s RMS of {whole:.3g} m/s cross the plane that the arm moves in and are "
        "left out: see heading_deg"
    ]


def _outside(levels: Float[np.ndarray, " level"], stage: Stage) -> list[str]:
    low, high = stage.heights
    if levels[0] <= low and high <= levels[-1]:
        return []
    arm = f"{low:.4g}" if high - low < 1e-9 else f"{low:.4g} to {high:.4g}"
    return [
        f"the arm at rest lies at z = {arm} m and the levels at {levels[0]:.4g} to "
        f"{levels[-1]:.4g} m: outside, the current of the nearest level is taken"
    ]


def _check_length(
    flow: MeasuredFlow, stage: Stage, length: float, begins: float, delay: float
) -> None:
    needed = begins + stage.duration / flow.time_scale + delay
    if needed <= length * (1 + 1e-9):
        return
    parts = [f"simulation.duration / time_scale = {stage.duration / flow.time_scale:.6g} s"]
    if flow.skip > 0:
        parts.append(f"skip = {flow.skip:.6g} s")
    if delay > 0:
        carried = needed - stage.duration / flow.time_scale - flow.skip
        parts.append(f"{carried:.4g} s for being carried past the arm")
    text = f"{Path(flow.file).name} lasts {length:.6g} s, takes {needed:.6g} s: {', '.join(parts)}"
    raise refusal("file", text)
