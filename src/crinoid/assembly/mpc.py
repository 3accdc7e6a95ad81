"""From the description of a predictive controller to its quadratic program."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from crinoid.assembly.forecast import SHAPES, carried_water, known_water
from crinoid.assembly.known import Known
from crinoid.assembly.linear import LinearModel
from crinoid.assembly.numbers import array
from crinoid.assembly.regulator import Regulator
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
    """Return the predictive controller of a scenario.

    Raises
    ------
    ScenarioError
        If the inputs that are to be driven do not move what is controlled, or there is no sensor
        of a current that is to be measured.
    """
    settings = plan.scenario.control.mpc
    ticks = max(1, round(settings.horizon / plan.period))
    lengths = blocks(ticks)
    looks = np.unique(np.round(np.linspace(0, ticks, _LOOKS)).astype(int))
    foreseen, sensors = settings.current != "unknown", plan.sensors
    if foreseen:  # what measures the current tells the observer nothing more
        sensors = tuple(x for x in sensors if not isinstance(x.measurand, WaterVelocity))
    shapes = SHAPES if foreseen else 0
    known = Known.of(replace(plan, sensors=sensors), settings, foreseen=shapes)
    problem = Problem.of(known, settings.integral_time, plan.period)
    pushes = _pushes(known.model, plan.period)
    program = condensed(problem, lengths, pushes, looks)
    forecast: Forecast | None = None
    if settings.current == "known":
        forecast = known_water(plan, known.model.current, looks * plan.period)
    elif settings.current == "measured":
        forecast = carried_water(plan, known.model.current, looks * plan.period, _meter(plan))
    size = known.parts.move.shape[0]
    under_way = size - known.parts.known
    return Mpc(
        observer=known.observer,
        qp=HorizonQp.of(
            program.hessian,
            rate=known.speed * plan.period,
            acceleration=known.acceleration * plan.period**2,
            lengths=lengths,
        ),
        # readings under way tell nothing more of what is to come
        by_state=array(np.insert(program.by_state, [known.parts.known] * under_way, 0.0, axis=2)),
        by_aim=array(program.by_aim),
        by_water=array(program.by_water),
        pushed=array(_padded(pushes[0], size)),
        hastened=array(_padded(pushes[1], size)),
        integrating=array(known.integrating),
        mapping=array(known.mapping),
        period=array(plan.period),
        forecast=forecast,
        rows=known.model.rows,
    )


class Problem(NamedTuple):
    """The regulator over a horizon, and what comes after it."""

    regulator: Regulator
    last: Matrix
    """Cost of all that follows a state."""
    steady: Matrix
    """State at rest by the commands that keep it there."""

    @staticmethod
    def of(known: Known, integral_time: float, period: float) -> Problem:
        """Build it, with the cost to go of the discrete Riccati equation."""
        from scipy.linalg import solve_discrete_are  # slow to load

        regulator = Regulator.of(known, integral_time, period)
        A, B, cost, rate, controlled = regulator
        # only the arm, first of the estimate, and the actuators answer to commands
        size, inputs = known.parts.known, B.shape[1]
        commands = A.shape[0] - controlled - inputs + np.arange(inputs)
        moving = np.r_[np.arange(known.parts.arm), np.arange(size, commands[0])]
        still = np.eye(moving.size) - A[np.ix_(moving, moving)]
        steady = np.zeros_like(B)
        steady[moving] = np.linalg.solve(still, A[np.ix_(moving, commands)])
        steady[commands] = np.eye(inputs)
        return Problem(regulator, solve_discrete_are(A, B, cost, rate), steady)


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
    by_water: Float[np.ndarray, "driven move look w"]


def condensed(
    problem: Problem,
    lengths: Lengths,
    pushes: tuple[Matrix, Matrix],
    looks: Int[np.ndarray, " look"],
) -> Condensed:
    """Eliminate the states from the horizon, with the cost of all that follows at its end.

    ``pushes`` are what water at the end of a period and its change do to the arm; the water is
    given at the ticks ``looks``, and between them by straight lines.
    """
    (A, B, cost, rate, controlled), last, steady = problem
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
    shift = np.zeros((size, size))  # the integral counts from where the tip should be
    shift[-controlled:] = -(A[-controlled:] - np.eye(size)[-controlled:])
    shift[:, -controlled:] = 0.0
    by_aim = np.zeros((inputs, count, ticks + 1, steady.shape[1]))
    for tick in range(ticks):
        by_aim[:, :, tick + 1] -= weighed[tick] @ steady
        by_aim[:, :, tick] += behind[tick] @ shift @ steady
    stirred, hastened = pushes
    by_water = np.zeros((inputs, count, ticks + 1, stirred.shape[1]))
    for tick in range(ticks):
        into = behind[tick][:, :, : stirred.shape[0]]
        by_water[:, :, tick + 1] += into @ (stirred + hastened)
        by_water[:, :, tick] -= into @ hastened
    between = np.stack([np.interp(np.arange(ticks + 1), looks, row) for row in np.eye(looks.size)])
    return Condensed(hessian, by_state, by_aim, np.einsum("iktw,lt->iklw", by_water, between))


def _pushes(model: LinearModel, period: float) -> tuple[Matrix, Matrix]:
    """Return what the water at the end of a period does to the arm, and what its change does.

    Water as `crinoid.control.Along` has it: velocities of the same drag, then true ones.
    """
    none = np.zeros_like(model.stirred)
    return np.hstack([model.stirred, none]), np.hstack([none, model.hastened / period])


def _padded(rows: Matrix, size: int) -> Matrix:
    return np.pad(rows, ((0, size - rows.shape[0]), (0, 0)))


def _meter(plan: Plan) -> str:
    """Return the name of the first sensor that measures the current."""
    for each in plan.sensors:
        if isinstance(each.measurand, WaterVelocity):
            return each.name
    text = 'got "measured", takes a sensor of the current with it: [[sensors]], kind = "current"'
    raise ScenarioError([Mistake("control.mpc.current", text)])
