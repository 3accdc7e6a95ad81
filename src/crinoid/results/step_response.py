"""Response of the tip to a step of its target or a load, by definitions of python-control."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from crinoid.foundation.axes import AXES
from crinoid.foundation.status import Status
from crinoid.results.errors import steady_from
from crinoid.results.result import Result

_BAND = 0.02
"""Share of the final value within which a response is settled, and of the step that it covers."""
_RETURNS = 2.0
"""Largest deflection by a load over the final one, which no second-order system exceeds."""
_AWAY = 0.01
"""Distance over the arm's length, or angle (rad), beyond which a tip is away from its target."""
_NOTHING, _ROUND = 1e-6, 1e-9
"""Deflection over the arm's length that is none; round-off of it, of times (s) and angles (rad)."""
_LEAST = 10  # saved instants of the shortest response

Times = Float[np.ndarray, " time"]
Motion = Float[np.ndarray, "time coordinate"]


class StepResponse(NamedTuple):
    """Rise time (s), overshoot over the final value, and settling time (s); None if unknown."""

    rise_time: float | None = None
    overshoot: float | None = None
    settling_time: float | None = None


class _Change(NamedTuple):
    """A change (s), whether it is a step, motion of the tip (m, rad or 1) and way of the target."""

    begin: float
    end: float
    steps: bool
    motion: Motion | None = None
    way: Float[np.ndarray, " coordinate"] | None = None

    def meets(self, other: "_Change") -> bool:
        """Return whether it goes on after the other begins; a load or a flow, if it was first."""
        first = self.begin + _ROUND < other.begin or self.way is not None
        return first and self.begin - _ROUND <= other.begin < self.end - _ROUND


def step_response(result: Result) -> StepResponse | None:
    """Return the response to the last step of a run that reached its end; None without a step.

    The target steps where it moves, and then holds still for at least as long, or where the
    controller switches on with the tip away from it. A load steps where it starts for good, or
    where one that the arm is in equilibrium with stops. The response ends where the target, a load
    or a flow changes next. The target has no steps before ``target.judged_from``.
    """
    time, scenario = result.dataset["time"].values, result.scenario
    if result.ended is not Status.OK or time.size < _LEAST:
        return None
    flows = (_Change(each.start, each.start + each.ramp_time, False) for each in scenario.flow)
    changes = [*_of_target(result), *_of_loads(result), *flows]
    for step in sorted(changes, key=lambda each: each.begin, reverse=True):
        end = min((x.begin for x in changes if x.begin > step.begin + _ROUND), default=time[-1])
        met = any(each.meets(step) for each in changes if each is not step)
        if not step.steps or met or step.end - step.begin > (end - step.begin) / 2:
            continue
        first, last = np.searchsorted(time, np.array([step.begin, end]) + _ROUND, "right")
        during = slice(max(0, first - 1), last)
        if time[during].size < _LEAST or step.motion is None:
            continue
        since, moved = time[during] - step.begin, step.motion[during] - step.motion[during.start]
        if step.way is None:
            return load_response(since, moved, _NOTHING * scenario.arm.length)
        acts = scenario.control.acts  # else the tip does not follow
        return target_response(since, moved @ step.way / (step.way @ step.way)) if acts else None
    return None


def target_response(time: Times, covered: Times) -> StepResponse | None:
    """Return the response to a step of the target, from times since the step (s).

    ``covered`` is the share of it that the tip has covered. None if in the end that is below 2 %.
    """
    final = float(np.mean(covered[time >= steady_from(time)]))
    if final < _BAND:
        return None
    return _numbers(time, covered / final, np.abs(covered / final - 1.0))


def load_response(time: Times, moved: Motion, least: float) -> StepResponse | None:
    """Return the response to a step of a load, from times since the step (s).

    ``moved`` is the deflection of the tip, the response that along the final one. Where control
    brings it back, only the settling time remains, into 2 % of the largest deflection. None if that
    is below ``least`` (m).
    """
    final = np.mean(moved[time >= steady_from(time)], axis=0)
    size, most = float(np.linalg.norm(final)), float(np.max(np.linalg.norm(moved, axis=1)))
    if most < least:
        return None
    off = np.linalg.norm(moved - final, axis=1)
    if most > _RETURNS * size:
        return StepResponse(settling_time=_numbers(time, off, off / most).settling_time)
    return _numbers(time, moved @ final / size**2, off / size)


def _numbers(time: Times, share: Times, off: Times) -> StepResponse:
    """Return the numbers of a response over its final value, ``off`` from which it is."""

    def first(level: float) -> float:
        at = max(1, int(np.argmax(share >= level)))
        return float(np.interp(level, share[at - 1 : at + 1], time[at - 1 : at + 1]))

    outside = int(np.max(np.flatnonzero(off > _BAND), initial=-1))
    near = slice(max(0, outside), outside + 2)  # between these it comes into the band
    settled = float(np.interp(-_BAND, -off[near], time[near]))
    over = max(0.0, float(np.max(share)) - 1.0)
    late = outside >= 0 and time[outside] >= steady_from(time)
    return StepResponse(first(0.9) - first(0.1), over, None if late else settled)


def _of_target(result: Result) -> list[_Change]:
    """Return the changes of the position of the target, or else of its direction."""
    data, scenario = result.dataset, result.scenario
    if "tip_target" not in data:
        return []
    named, dimension = scenario.control.controlled, scenario.arm.dimension
    axes = [index for index, axis in enumerate(AXES[dimension]) if axis in named]
    seen, aim = (data[f"tip_{each}"].values[:, axes] for each in ("position", "target"))
    found = list(_moves(result, seen, aim, scenario.arm.length))
    pointing = "angle" if dimension == 2 else "direction"
    wanted = f"tip_{pointing}_target"
    if found or pointing not in named or wanted not in data:
        return found
    seen, aim = (data[name].values.reshape(len(data["time"]), -1) for name in (wanted[:-7], wanted))
    turns = np.round((aim[0] - seen[0]) / (2 * np.pi)) if dimension == 2 else 0.0
    return list(_moves(result, seen, aim - 2 * np.pi * turns, 1.0))


def _moves(result: Result, seen: Motion, wanted: Motion, size: float) -> Iterator[_Change]:
    """Yield where the controller switches on away from the target, and motions of the target."""
    time, scenario = result.dataset["time"].values, result.scenario
    on = scenario.control.start - _ROUND
    counted = max(on, (scenario.target.judged_from or 0.0) - _ROUND)
    moving = np.any(np.abs(np.diff(wanted, axis=0)) > _ROUND * size, axis=1)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], moving, [False]]))).reshape(-1, 2)
    found = [(start, stop, wanted[stop] - wanted[start]) for start, stop in edges]
    first = min(int(np.searchsorted(time, on)), time.size - 1)
    away = wanted[first] - seen[first]
    if np.linalg.norm(away) > _AWAY * size:
        found.append((first, first, away))
    for start, stop, way in found:
        begin, end = float(time[start]), float(time[stop])
        yield _Change(begin, end, begin >= counted and bool(way.any()), seen, way)


def _of_loads(result: Result) -> Iterator[_Change]:
    tip, scenario = result.dataset["tip_position"].values, result.scenario
    still = scenario.simulation.start == "equilibrium"
    for load in scenario.load:
        stop, balanced = load.stop, still and load.start == load.ramp_time == 0.0
        stops = stop is not None and stop < scenario.simulation.duration
        yield _Change(load.start, load.start + load.ramp_time, not (balanced or stops), tip)
        if stop is not None and stops:
            yield _Change(stop, stop, balanced, tip)
