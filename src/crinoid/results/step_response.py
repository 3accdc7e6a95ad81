"""Step response of the tip, to its target or a load: rise time, overshoot and settling time.

The definitions are those of ``step_info`` of python-control.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from crinoid.foundation.axes import AXES
from crinoid.foundation.status import Status
from crinoid.results.errors import steady_from
from crinoid.results.result import Result

_RISE = (0.1, 0.9)
"""Shares of the final value between which a response rises."""
_BAND = 0.02
"""Share of the final value within which a response is settled, and of the step that it covers."""
_RETURNS = 2.0
"""Largest deflection by a load over the final one, beyond which control brings the tip back.

A second-order system overshoots by its final deflection at most."""
_AWAY = 0.01
"""Distance over the arm's length, or angle (rad), beyond which a tip is away from its target."""
_NOTHING = 1e-6
"""Deflection over the arm's length that is none."""
_ROUND = 1e-9
"""Round-off of times (s), of distances over the arm's length and of angles (rad)."""
_LEAST = 10
"""Saved instants of the shortest response."""

Times = Float[np.ndarray, " time"]
Motion = Float[np.ndarray, "time coordinate"]


class StepResponse(NamedTuple):
    """Numbers of a step response; None where it has no such number."""

    rise_time: float | None = None
    """Time between 10 % and 90 % of the final value (s)."""
    overshoot: float | None = None
    """Largest value less the final one, over the final one."""
    settling_time: float | None = None
    """Time from the step until it stays within 2 % of the final value (s)."""


class _Change(NamedTuple):
    """A change of the target, a load or a flow, with its times (s)."""

    begin: float
    end: float
    steps: bool
    """Whether it may be a step; any other one ends the response before it."""
    motion: Motion | None = None
    """Motion of the tip over the run (m, rad or 1)."""
    way: Float[np.ndarray, " coordinate"] | None = None
    """Change of the target in the same coordinates; None of a load or a flow."""

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

    ``covered`` is the share of the step that the tip has covered. None if in the end that is less
    than 2 %.
    """
    final = float(np.mean(covered[time >= steady_from(time)]))
    if final < _BAND:
        return None
    share = covered / final
    settled = _settled(time, np.abs(share - 1.0))
    return StepResponse(_rise(time, share), _overshoot(share), settled)


def load_response(time: Times, moved: Motion, least: float) -> StepResponse | None:
    """Return the response to a step of a load, from times since the step (s).

    ``moved`` is the deflection of the tip from where it was. The response is its share along the
    final deflection. Where control brings the tip back, only the settling time remains, into 2 % of
    the largest deflection. None if that is less than ``least`` (m).
    """
    final = np.mean(moved[time >= steady_from(time)], axis=0)
    size, most = float(np.linalg.norm(final)), float(np.max(np.linalg.norm(moved, axis=1)))
    if most < least:
        return None
    off = np.linalg.norm(moved - final, axis=1)
    if most > _RETURNS * size:
        return StepResponse(settling_time=_settled(time, off / most))
    share = moved @ final / size**2
    return StepResponse(_rise(time, share), _overshoot(share), _settled(time, off / size))


def _of_target(result: Result) -> list[_Change]:
    """Return the changes of the position of the target, or else of its direction."""
    data, scenario = result.dataset, result.scenario
    named, dimension = scenario.control.controlled, scenario.arm.dimension
    axes = [index for index, axis in enumerate(AXES[dimension]) if axis in named]
    position = (data[f"tip_{each}"].values[:, axes] for each in ("position", "target"))
    found = list(_moves(result, *position, scenario.arm.length))
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

    def change(start: int, stop: int, way: Float[np.ndarray, " coordinate"]) -> _Change:
        begin, end = float(time[start]), float(time[stop])
        return _Change(begin, end, begin >= counted and bool(way.any()), seen, way)

    if on < time[-1]:
        first = int(np.searchsorted(time, on))
        way = wanted[first] - seen[first]
        if np.linalg.norm(way) > _AWAY * size:
            yield change(first, first, way)
    moving = np.any(np.abs(np.diff(wanted, axis=0)) > _ROUND * size, axis=1)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], moving, [False]])))
    for start, stop in edges.reshape(-1, 2).tolist():
        yield change(start, stop, wanted[stop] - wanted[start])


def _of_loads(result: Result) -> Iterator[_Change]:
    tip, scenario = result.dataset["tip_position"].values, result.scenario
    still = scenario.simulation.start == "equilibrium"
    for load in scenario.load:
        stop, balanced = load.stop, still and load.start == load.ramp_time == 0.0
        stops = stop is not None and stop < scenario.simulation.duration
        yield _Change(load.start, load.start + load.ramp_time, not (balanced or stops), tip)
        if stop is not None and stops:
            yield _Change(stop, stop, balanced, tip)


def _rise(time: Times, share: Times) -> float:
    begin, end = (_first(time, share, level) for level in _RISE)
    return end - begin


def _first(time: Times, share: Times, level: float) -> float:
    """Return when a response first reaches a level, between instants linearly."""
    at = max(1, int(np.argmax(share >= level)))
    return float(np.interp(level, share[at - 1 : at + 1], time[at - 1 : at + 1]))


def _overshoot(share: Times) -> float:
    return max(0.0, float(np.max(share)) - 1.0)


def _settled(time: Times, off: Times) -> float | None:
    """Return when a deviation last comes into the band; None if it is outside in the last tenth."""
    outside = np.flatnonzero(off > _BAND)
    if outside.size == 0:
        return float(time[0])
    last = outside[-1]
    if time[last] >= steady_from(time):
        return None
    return float(np.interp(-_BAND, -off[last : last + 2], time[last : last + 2]))
