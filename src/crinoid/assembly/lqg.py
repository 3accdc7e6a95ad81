"""From the description of an LQG controller to its gains."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from crinoid.assembly.fluctuation import fluctuations
from crinoid.assembly.linear import LinearModel, linear_model
from crinoid.assembly.numbers import array
from crinoid.assembly.observer import Arrivals, Augmented, Water, augmented, build_observer
from crinoid.control import Lqg, Shape
from crinoid.control.measurand import Inclination
from crinoid.scenario.lqg import ModelBased

if TYPE_CHECKING:
    from crinoid.assembly.plan import Plan

Matrix = Float[np.ndarray, "m n"]

_MOST_SHAPES = 3
_EFFORT = 0.02
"""Cost of an input at the end of its range over that of one at its greatest speed."""


def build_lqg(plan: Plan) -> Lqg:
    settings = plan.scenario.control.lqg
    driven = settings.inputs or plan.scenario.driven
    model, parts, arrivals = known_arm(plan, driven)
    observer = build_observer(plan, model, parts, arrivals)
    columns, scale = plan.controlled
    pose = plan.sensors[0].noise.shape[0]
    integrating = np.zeros((len(columns), pose))
    integrating[np.arange(len(columns)), columns] = scale
    design = _Design(plan, model, parts, settings, integrating)
    steady, jacobian = design.steady()
    full = np.vstack([steady, np.zeros((len(columns), steady.shape[1]))])
    from crinoid.control import damped_inverse

    mapping = damped_inverse(integrating @ jacobian) @ integrating
    return Lqg(
        observer=observer,
        gain=array(design.gain()),
        integrating=array(integrating),
        period=array(plan.period),
        steady=array(full),
        mapping=array(mapping),
        rows=tuple(model.rows),
    )


def known_arm(plan: Plan, driven: tuple[str, ...]) -> tuple[LinearModel, Augmented, Arrivals]:
    """Return what model-based controllers know of the arm, its water and its sensors."""
    shapes = 1 + sum(
        each.measurand.stations.shape[0]
        for each in plan.sensors
        if isinstance(each.measurand, (Shape, Inclination))
    )
    shapes = min(shapes, _MOST_SHAPES)
    expected = fluctuations(plan.scenario, plan.recordings)
    deviation = np.sqrt(sum(each.deviation**2 for each in expected))
    model = linear_model(plan, driven, shapes, deviation)
    water = Water.of(expected, shapes, plan.period)
    step = float(plan.system.time_step)
    arrivals = Arrivals.of(plan.sensors, plan.period, step)
    return model, augmented(model, water, arrivals, plan), arrivals


class _Design:
    """The regulator of a linear model."""

    def __init__(
        self,
        plan: Plan,
        model: LinearModel,
        parts: Augmented,
        settings: ModelBased,
        integrating: Matrix,
    ) -> None:
        self.plan, self.model, self.parts = plan, model, parts
        self.settings, self.integrating = settings, integrating
        self.tip = integrating @ model.observed[: integrating.shape[1]]

    def steady(self) -> tuple[Matrix, Matrix]:
        """Return estimate, actuators and commands of commands that stand still, and the pose."""
        model, parts = self.model, self.parts
        followed = np.linalg.solve(
            np.eye(model.actuators.shape[0]) - model.actuators, model.commanded
        )
        estimate = np.linalg.solve(
            np.eye(parts.move.shape[0]) - parts.move, (parts.held + parts.driven) @ followed
        )
        pose = self.integrating.shape[1]
        jacobian = model.observed[:pose] @ estimate[: parts.arm]
        jacobian += model.observed_actuators[:pose] @ followed
        return np.vstack([estimate, followed, np.eye(followed.shape[1])]), jacobian

    def gain(self) -> Matrix:
        """Return the gain of the least quadratic cost (discrete Riccati equation)."""
        from scipy.linalg import solve_discrete_are  # slow to load

        model, parts, plan = self.model, self.parts, self.plan
        known = parts.arm + parts.water
        states, inputs = model.actuators.shape[0], model.commanded.shape[1]
        controlled = self.tip.shape[0]
        size = known + states + inputs + controlled
        x, s = slice(0, known), slice(known, known + states)
        u = slice(known + states, known + states + inputs)
        q = slice(size - controlled, size)
        A, B = np.zeros((size, size)), np.zeros((size, inputs))
        A[x, x] = parts.move[:known, :known]
        A[x, s] = parts.held[:known] + parts.driven[:known] @ model.actuators
        A[x, u] = B[x] = parts.driven[:known] @ model.commanded
        A[s, s] = model.actuators
        A[s, u] = B[s] = model.commanded
        A[u, u] = B[u] = np.eye(inputs)
        A[q, : parts.arm] = plan.period * self.tip
        A[q, q] = np.eye(controlled)
        cost = np.zeros((size, size))
        cost[: parts.arm, : parts.arm] = self.tip.T @ self.tip
        cost[q, q] = np.eye(controlled) / self.settings.integral_time**2
        worth = self.settings.smoothness or 0.01 * plan.scenario.arm.length
        speed, reach = _most(plan, model.rows)
        cost[u, u] = np.diag((_EFFORT * worth / reach) ** 2)
        rate = np.diag((worth / (plan.period * speed)) ** 2)
        found = solve_discrete_are(A, B, cost, rate)
        gain = np.linalg.solve(rate + B.T @ found @ B, B.T @ found @ A)
        # readings under way tell nothing more of what is to come
        under_way = np.zeros((inputs, parts.move.shape[0] - known))
        return np.hstack([gain[:, :known], under_way, gain[:, known:]])


def _most(plan: Plan, rows: list[int] | tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Return the greatest speed of each driven input, and half of its range."""
    servo = plan.system.base.servo
    speeds = list(np.asarray(servo.max_speed))
    lower = np.array([float(each.lower) for each in plan.inputs])
    upper = np.array([float(each.upper) for each in plan.inputs])
    reach = 0.5 * (upper - lower)
    # of the others, what they pass in a second
    speeds += list(2 * reach[len(speeds) :])
    return np.array(speeds)[list(rows)], reach[list(rows)]
