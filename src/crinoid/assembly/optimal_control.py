"""Design of LQG and predictive controllers: regulator, gains, and quadratic program."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Float, Int

from crinoid.assembly.arrays import array
from crinoid.assembly.control_design import ControlDesignModel
from crinoid.assembly.forecast import SHAPES, carried_water, known_water
from crinoid.assembly.plan import AssembledScenario
from crinoid.control import Braking, Forecast, HorizonQp, Lqg, Mpc, WaterVelocity
from crinoid.scenario import refusal

Matrix = Float[np.ndarray, "_ _"]

EFFORT = 0.02  # cost of an input at the end of its range over that of one at its greatest speed
SPARE = 1.0  # the same for joint commands of inputs that do not move the tip at rest


def straight(looks: Int[np.ndarray, " look"], ticks: int) -> Float[np.ndarray, "look tick"]:
    """Return weights of linear interpolation: of each look at each tick."""
    every = np.arange(ticks + 1)
    return np.stack([np.interp(every, looks, row) for row in np.eye(looks.size)])


class Regulator(NamedTuple):
    """``z' = A z + B du`` for estimate, actuators, commands and integrals, and its cost."""

    A: Matrix
    B: Matrix
    cost: Matrix  # cost of a state ``z``
    rate: Matrix  # cost of changes ``du`` of the commands in a period
    steady: Matrix  # state at rest by the commands that keep it there
    shift: Matrix
    """Change of a state in a period by the commands at which the tip would stand still where it is
    wanted: the integrals count from there."""

    @staticmethod
    def of(design: ControlDesignModel, integral_time: float, period: float) -> Regulator:
        """Build it for a control period (s)."""
        model, parts, size = design.model, design.parts, design.parts.estimated
        states, inputs = model.commanded.shape
        controlled = design.tip.shape[0]
        ends = list(np.cumsum([size, states, inputs, controlled]))
        x, s, u, q = (slice(*pair) for pair in pairwise([0, *ends]))
        A, B = np.zeros((ends[-1], ends[-1])), np.zeros((ends[-1], inputs))
        A[x, x] = parts.move[:size, :size]
        A[x, s] = parts.held[:size] + parts.driven[:size] @ model.actuators
        A[x, u] = B[x] = parts.driven[:size] @ model.commanded
        A[s, s] = model.actuators
        A[s, u] = B[s] = model.commanded
        A[u, u] = B[u] = np.eye(inputs)
        A[q, x] = period * design.tip
        A[q, q] = np.eye(controlled)
        cost = np.zeros_like(A)
        cost[x, x] = design.tip.T @ design.tip
        cost[q, q] = np.eye(controlled) / integral_time**2
        pull = EFFORT**2 * np.eye(inputs) + SPARE**2 * design.spare
        cost[u, u] = design.error_scale**2 * pull / np.outer(design.half_range, design.half_range)
        rate = np.diag((design.error_scale / (period * design.speed)) ** 2)
        # only the arm, first of the estimate, and the actuators answer to commands
        moving = np.r_[np.arange(parts.arm), np.arange(size, u.start)]
        still = np.eye(moving.size) - A[np.ix_(moving, moving)]
        steady, shift = np.zeros_like(B), np.zeros_like(B)
        steady[moving] = np.linalg.solve(still, A[moving, u])
        steady[u] = np.eye(inputs)
        shift[q] = -A[q, x] @ steady[x]
        return Regulator(A, B, cost, rate, steady, shift)

    def by_aim(self, later: Matrix, ticks: int) -> Float[np.ndarray, "tick u aim"]:
        """Return the best next move by the commands ``aim`` for where the tip is wanted at ticks.

        The first one is now; the target stays where it is at the last one. ``later`` is the cost of
        all that follows (`to_come`). The cost to go has a part that is linear in the state, which
        follows backward from the aims (Katayama, Ohki, Inoue and Kato 1985).
        """
        A, B, cost, rate, steady, shift = self
        gain = np.linalg.solve(rate + B.T @ later @ B, B.T)
        closed = (A - B @ gain @ later @ A).T
        pull = cost @ steady - closed @ later @ shift
        found = [-gain @ later @ shift]
        for _ in range(ticks - 1):
            found.append(gain @ pull)
            pull = closed @ pull
        lasting = np.linalg.solve(np.eye(A.shape[0]) - closed, pull)
        return np.stack([*found, gain @ lasting])

    def to_come(self) -> Matrix:
        """Return the infinite-horizon cost of a state, by the Riccati equation."""
        from scipy.linalg import solve_discrete_are  # slow to load

        return solve_discrete_are(self.A, self.B, self.cost, self.rate)


_GENTLER = 2.0 ** np.arange(0, 4.1, 0.25)
"""Smoothness of each gain over the first: weight of speeds against errors."""
_PREVIEW = 1.5  # preview of the target, over the arm's first period
_LOOKS_LQG = 24  # number of times of the preview


def build_lqg(plan: AssembledScenario) -> Lqg:
    """Return the LQG controller of an assembled scenario."""
    settings, looks = plan.scenario.control.lqg, np.zeros(1, int)
    if plan.scenario.target.feeds_forward:
        ticks = max(_LOOKS_LQG, round(_PREVIEW * plan.first_period / plan.period))
        looks = np.unique(np.round(np.geomspace(1, 1 + ticks, _LOOKS_LQG)).astype(int)) - 1
    try:
        design = ControlDesignModel.of(plan, settings)
        gentler = (design._replace(error_scale=f * design.error_scale) for f in _GENTLER)
        found = [_gains(each, settings.integral_time, plan.period, looks) for each in gentler]
    except np.linalg.LinAlgError as error:  # of the Riccati equations
        text = f'got "lqg", but no gain exists for this arm ({error}). Choose another kind.'
        raise refusal("control.kind", text) from error
    gains, by_aim, curved = map(np.stack, zip(*found, strict=True))
    return Lqg(
        **design.fields(plan, looks),
        gains=array(gains),
        by_aim=array(by_aim),
        curved=array(curved),
        braking=Braking.of(
            design.speed * plan.period, design.acceleration * plan.period**2, np.ones(1)
        ),
    )


def _gains(
    design: ControlDesignModel, integral_time: float, period: float, looks: Int[np.ndarray, " look"]
) -> tuple[Matrix, Float[np.ndarray, "u look aim"], Matrix]:
    """Return the best gains by state and by aims, and the second derivative of the cost by a move.

    Aims are given at ``looks`` and interpolated in between.
    """
    regulator = Regulator.of(design, integral_time, period)
    A, B, _, rate, _, _ = regulator
    later = regulator.to_come()
    curved = rate + B.T @ later @ B
    gain = np.linalg.solve(curved, B.T @ later @ A)
    # readings under way have no effect on what follows
    under_way = [design.parts.estimated] * (design.parts.move.shape[0] - design.parts.estimated)
    ticks = max(1, int(looks[-1]))
    by_aim = straight(looks, ticks) @ regulator.by_aim(later, ticks).swapaxes(0, 1)
    return np.insert(gain, under_way, 0.0, axis=1), by_aim, curved


Lengths = Float[np.ndarray, " move"]

_SINGLE = 4  # moves of one period at the start of the horizon
_LONGEST = 8  # share of the horizon of the longest move
_LOOKS_MPC = 12  # number of times at which water is predicted


def design_mpc(plan: AssembledScenario) -> tuple[Mpc, ControlDesignModel]:
    """Return the predictive controller of a scenario on one model, and the model of its design."""
    settings = plan.scenario.control.mpc
    ticks = max(1, round(settings.horizon / plan.period))
    lengths = blocks(ticks)
    looks = np.unique(np.round(np.linspace(0, ticks, _LOOKS_MPC)).astype(int))
    aimed = np.arange(ticks + 1 if plan.scenario.target.feeds_forward else 1)
    foreseen, sensors = settings.current != "unknown", plan.sensors
    if foreseen:  # a current sensor adds nothing to the observer here
        sensors = tuple(x for x in sensors if not isinstance(x.measurand, WaterVelocity))
    shapes = SHAPES if foreseen else 0
    design = ControlDesignModel.of(replace(plan, sensors=sensors), settings, foreseen=shapes)
    regulator = Regulator.of(design, settings.integral_time, plan.period)
    pushed = np.hstack([design.model.stirred, design.model.hastened])  # as `Along` has the water
    program = condensed(regulator, lengths, pushed)
    forecast: Forecast | None = None
    if settings.current == "known":
        forecast = known_water(plan, design.model.current, looks * plan.period)
    elif settings.current == "measured":
        meters = [x.name for x in plan.sensors if isinstance(x.measurand, WaterVelocity)]
        if not meters:
            text = 'got "measured"; must come with a sensor of the current: '
            text += '[[sensors]], kind = "current"'
            raise refusal("control.mpc.current", text)
        forecast = carried_water(plan, design.model.current, looks * plan.period, meters[0])
    fields = design.fields(plan, aimed)
    if forecast is not None:  # the states of the water are its errors
        fields["observer"] = eqx.tree_at(
            lambda observer: observer.outputs.flow_velocity, fields["observer"], None
        )
    size = design.parts.move.shape[0]
    under_way = size - design.parts.estimated
    controller = Mpc(
        **fields,
        qp=HorizonQp.of(
            program.hessian,
            rate=design.speed * plan.period,
            acceleration=design.acceleration * plan.period**2,
            lengths=lengths,
        ),
        # readings under way have no effect on what follows
        by_state=array(
            np.insert(program.by_state, [design.parts.estimated] * under_way, 0.0, axis=2)
        ),
        by_aim=array(straight(aimed, ticks) @ program.by_aim),
        by_water=array(straight(looks, ticks) @ program.by_water),
        pushed=array(np.pad(pushed, ((0, size - pushed.shape[0]), (0, 0)))),
        forecast=forecast,
    )
    return controller, design


def blocks(ticks: int) -> Lengths:
    """Return how many periods each move of a horizon lasts: longer ones come later."""
    lengths: list[int] = []
    while sum(lengths) < ticks:
        left = ticks - sum(lengths)
        length = 1 if len(lengths) < _SINGLE else min(2 * lengths[-2], max(1, ticks // _LONGEST))
        lengths.append(min(length, left))
    return np.array(lengths, float)


class CondensedCost(NamedTuple):
    """Quadratic cost of the moves, all else eliminated: ``m H m / 2 + (sum of gradients) m``."""

    hessian: Float[np.ndarray, "driven move driven move"]
    by_state: Float[np.ndarray, "driven move z"]
    by_aim: Float[np.ndarray, "driven move tick aim"]
    by_water: Float[np.ndarray, "driven move tick w"]


def condensed(regulator: Regulator, lengths: Lengths, pushed: Matrix) -> CondensedCost:
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
    return CondensedCost(hessian, by_state, by_aim, by_water)
