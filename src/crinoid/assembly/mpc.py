"""From the description of a predictive controller to its quadratic program."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from jaxtyping import Float

from crinoid.assembly.forecast import SHAPES, carried_water, known_water
from crinoid.assembly.known import Known
from crinoid.assembly.numbers import array
from crinoid.assembly.regulator import Regulator, straight
from crinoid.control import Forecast, HorizonQp, Mpc, WaterVelocity
from crinoid.scenario import Mistake, ScenarioError

if TYPE_CHECKING:
    from crinoid.assembly.plan import Plan

Matrix = Float[np.ndarray, "_ _"]
Lengths = Float[np.ndarray, " move"]

_SINGLE = 4
"""Moves of one period at the start of the horizon."""
_LONGEST = 8
"""Share of the horizon of the longest move."""
_LOOKS = 12
"""Times at which water is foreseen."""


def build_mpc(plan: Plan) -> Mpc:
    """Return the predictive controller of a scenario, on one model."""
    return designed(plan)[0]


def designed(plan: Plan) -> tuple[Mpc, Known]:
    """Return the controller of `build_mpc`, and what it was designed on."""
    settings = plan.scenario.control.mpc
    ticks = max(1, round(settings.horizon / plan.period))
    lengths = blocks(ticks)
    looks = np.unique(np.round(np.linspace(0, ticks, _LOOKS)).astype(int))
    aimed = np.arange(ticks + 1 if plan.scenario.target.feeds_forward else 1)
    foreseen, sensors = settings.current != "unknown", plan.sensors
    if foreseen:  # what measures the current tells the observer nothing more
        sensors = tuple(x for x in sensors if not isinstance(x.measurand, WaterVelocity))
    shapes = SHAPES if foreseen else 0
    known = Known.of(replace(plan, sensors=sensors), settings, foreseen=shapes)
    regulator = Regulator.of(known, settings.integral_time, plan.period)
    pushed = np.hstack([known.model.stirred, known.model.hastened])  # as `Along` has the water
    program = condensed(regulator, lengths, pushed)
    forecast: Forecast | None = None
    if settings.current == "known":
        forecast = known_water(plan, known.model.current, looks * plan.period)
    elif settings.current == "measured":
        forecast = carried_water(plan, known.model.current, looks * plan.period, _meter(plan))
    size = known.parts.move.shape[0]
    under_way = size - known.parts.known
    controller = Mpc(
        observer=known.observer,
        qp=HorizonQp.of(
            program.hessian,
            rate=known.speed * plan.period,
            acceleration=known.acceleration * plan.period**2,
            lengths=lengths,
        ),
        # readings under way tell nothing more of what is to come
        by_state=array(np.insert(program.by_state, [known.parts.known] * under_way, 0.0, axis=2)),
        by_aim=array(straight(aimed, ticks) @ program.by_aim),
        by_water=array(straight(looks, ticks) @ program.by_water),
        pushed=array(np.pad(pushed, ((0, size - pushed.shape[0]), (0, 0)))),
        integrating=array(known.integrating),
        mapping=array(known.mapping),
        lead=array(aimed * plan.period),
        period=array(plan.period),
        forecast=forecast,
        rows=known.model.rows,
    )
    return controller, known


def blocks(ticks: int) -> Lengths:
    """Return how many periods each move of a horizon lasts: longer ones come later."""
    lengths: list[int] = []
    while sum(lengths) < ticks:
        left = ticks - sum(lengths)
        length = 1 if len(lengths) < _SINGLE else min(2 * lengths[-2], max(1, ticks // _LONGEST))
        lengths.append(min(length, left))
    return np.array(lengths, float)


class Condensed(NamedTuple):
    """Quadratic cost of the moves, all else eliminated: ``m H m / 2 + (sum of gradients) m``."""

    hessian: Float[np.ndarray, "driven move driven move"]
    by_state: Float[np.ndarray, "driven move z"]
    by_aim: Float[np.ndarray, "driven move tick aim"]
    by_water: Float[np.ndarray, "driven move tick w"]


def condensed(regulator: Regulator, lengths: Lengths, pushed: Matrix) -> Condensed:
    """Eliminate the states from the horizon, with the cost of all that follows at its end.

    ``pushed`` is what water at the end of a period does to the arm.
    """
    A, B, cost, rate, steady, shift = regulator
    last = regulator.to_come()
    count, ticks = lengths.size, int(lengths.sum())
    block = np.repeat(np.arange(count), lengths.astype(int))
    inputs, size = B.shape[1], A.shape[0]
    moved = np.zeros((size, inputs, count))
    hessian = np.zeros((inputs, count, inputs, count))
    weighed = []  # cost times what moves do to the states
    for tick in range(ticks):
        moved = np.einsum("ab,bik->aik", A, moved)
        moved[:, :, block[tick]] += B
        weight = last if tick == ticks - 1 else cost
        weighed.append(np.einsum("ab,bik->ika", weight, moved))
        hessian += np.einsum("ika,ajl->ikjl", weighed[-1], moved)
    for move, length in enumerate(lengths):
        hessian[:, move, :, move] += length * rate
    # what enters at a tick costs by all states after it
    later, behind = np.zeros_like(weighed[0]), [np.zeros(0)] * ticks
    for tick in reversed(range(ticks)):
        later = weighed[tick] + later @ A
        behind[tick] = later
    by_state = behind[0] @ A
    by_aim = np.zeros((inputs, count, ticks + 1, steady.shape[1]))
    for tick in range(ticks):
        by_aim[:, :, tick + 1] -= weighed[tick] @ steady
        by_aim[:, :, tick] += behind[tick] @ shift
    by_water = np.zeros((inputs, count, ticks + 1, pushed.shape[1]))
    for tick in range(ticks):
        by_water[:, :, tick + 1] = behind[tick][:, :, : pushed.shape[0]] @ pushed
    return Condensed(hessian, by_state, by_aim, by_water)


def _meter(plan: Plan) -> str:
    """Return the name of the first sensor that measures the current."""
    for each in plan.sensors:
        if isinstance(each.measurand, WaterVelocity):
            return each.name
    text = 'got "measured", takes a sensor of the current with it: [[sensors]], kind = "current"'
    raise ScenarioError([Mistake("control.mpc.current", text)])
