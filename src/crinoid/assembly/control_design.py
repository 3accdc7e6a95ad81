"""Linear model for the design of a controller: arm, water, sensors and limits of inputs."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from crinoid.assembly.arrays import array
from crinoid.assembly.forecast import fluctuations, vortex_shedding
from crinoid.assembly.linear import LinearModel, linear_model
from crinoid.assembly.observer import (
    AugmentedModel,
    ReadingSchedule,
    WaterProcess,
    augmented,
    build_observer,
)
from crinoid.assembly.observer_outputs import tangent
from crinoid.assembly.plan import AssembledScenario
from crinoid.control import Inclination, Observer, Shape, damped_inverse
from crinoid.scenario import Scenario, one_of, refusal, shown
from crinoid.scenario.controller import ModelBased

PerInput = Float[np.ndarray, " u"]

_MAX_SHAPES = 3  # most shapes along the arm that the water's velocity is made of
_RANK = 1e-2  # movement of the tip, over the largest by the inputs, that counts as zero
_RANGE_TIME, _SPEED_TIME = 0.6, 0.06
"""Times over the arm's first period in which inputs without such limits pass their range, and in
which they reach their greatest speed."""


def observer_model(
    plan: AssembledScenario,
    driven: tuple[str, ...],
    arrivals: ReadingSchedule,
    *,
    foreseen: int = 0,
) -> tuple[LinearModel, AugmentedModel]:
    """Linearise the arm of a plan, and add the states of water and readings for an observer.

    ``driven`` are the inputs that move, ``arrivals`` when readings are known. The linear model is
    of water with at least ``foreseen`` shapes along the arm.
    """
    scenario = plan.scenario
    stations = [
        each.measurand.stations.shape[0]
        for each in plan.sensors
        if isinstance(each.measurand, (Shape, Inclination))
    ]
    shapes = min(1 + sum(stations), _MAX_SHAPES)
    expected = fluctuations(
        scenario, plan.recordings, plan.system.forces.water.flows, plan.first_period
    )
    deviation = np.sqrt(np.sum([each.deviation**2 for each in expected], axis=0))
    model = linear_model(plan, driven, max(shapes, foreseen), deviation)
    nodes = np.asarray(plan.state.position)
    shed = vortex_shedding(scenario, plan.recordings, tangent(nodes))
    unshed = WaterProcess.of(expected, shapes, plan.period).move.shape[0]
    expected += () if shed is None else (shed,)
    water, most = WaterProcess.of(expected, shapes, plan.period), shapes * deviation.size
    observed = model._replace(
        stirred=model.steeper * model.stirred[:, :most],
        hastened=model.hastened[:, :most],
        observed_water=model.observed_water[:, :most],
    )
    return model, augmented(observed, water, arrivals, plan, unshed)


def inputs_of(scenario: Scenario, settings: ModelBased, kind: str) -> tuple[str, ...]:
    """Return the inputs of a controller of a kind, or refuse one that the arm does not have."""
    there = scenario.inputs
    if missing := [name for name in settings.inputs or () if name not in there]:
        text = f"got {shown(missing[0])}; must be among {one_of(there, 'and')}"
        raise refusal(f"control.{kind}.inputs", text)
    return settings.inputs or there


class ControlDesignModel(NamedTuple):
    """Linear model, observer and limits from which LQG and MPC are designed."""

    model: LinearModel
    parts: AugmentedModel
    observer: Observer
    half_range: PerInput  # half the range of each driven input
    speed: PerInput  # its greatest speed (1/s)
    acceleration: PerInput  # its greatest acceleration (1/s2)
    error_scale: float  # error of the tip that counts as much as an input at its greatest speed (m)
    integrating: Float[np.ndarray, "controlled pose"]
    """Error of the controllable coordinates, in metres, by the error of the pose."""
    mapping: Float[np.ndarray, "u pose"]  # commands that move the tip at rest
    spare: Float[np.ndarray, "u u"]
    """Part of commands, over half their ranges, that moves nothing of the tip at rest."""

    @property
    def tip(self) -> Float[np.ndarray, "controlled estimated"]:
        """Controlled coordinates by the estimate (m)."""
        return self.integrating @ self.parts.outputs.tip

    def fields(self, plan: AssembledScenario, looks: Int[np.ndarray, " look"]) -> dict[str, Any]:
        """Return the fields of `crinoid.control.lqg.ModelBased`; ``looks`` in control periods."""
        return {
            "observer": self.observer,
            "integrating": array(self.integrating),
            "mapping": array(self.mapping),
            "lead": array(looks * plan.period),
            "period": array(plan.period),
            "rows": self.model.rows,
        }

    @staticmethod
    def of(
        plan: AssembledScenario, settings: ModelBased, *, foreseen: int = 0
    ) -> ControlDesignModel:
        """Linearise the arm of a plan, and design its observer.

        The model is of water with at least ``foreseen`` shapes along the arm.
        """
        scenario = plan.scenario
        inputs_of(scenario, settings, scenario.control.kind)
        arrivals = ReadingSchedule.of(plan.sensors, plan.period, float(plan.system.time_step))
        model, parts = observer_model(plan, scenario.driven, arrivals, foreseen=foreseen)
        columns, scale = plan.controlled
        integrating = np.zeros((len(columns), plan.sensors[0].noise.shape[0]))
        integrating[np.arange(len(columns)), columns] = scale
        # how readings follow commands that move slowly
        still = np.eye(model.actuators.shape[0]) - model.actuators
        followed = np.linalg.solve(still, model.commanded)
        arm = np.linalg.solve(np.eye(model.arm.shape[0]) - model.arm, model.held + model.driven)
        slow = (model.observed @ arm + model.observed_actuators) @ followed
        jacobian = integrating @ slow[: integrating.shape[1]] * model.usual
        # of what inputs do not move an integral would never end
        ways, moved, _ = np.linalg.svd(jacobian, full_matrices=False)
        moves = moved > _RANK * moved.max(initial=0.0)
        integrating, jacobian = (ways[:, moves].T @ each for each in (integrating, jacobian))
        if not moves.any():
            text = "the driven inputs move no controlled coordinate of the tip"
            raise refusal(f"control.{scenario.control.kind}", text)
        spare = np.linalg.svd(jacobian)[2][len(jacobian) :]
        servo, speed, rows = plan.system.base.servo, max_speeds(plan), list(model.rows)
        half_range = 0.5 * np.diff(plan.limits, axis=0)[0]
        acceleration = speed / (_SPEED_TIME * plan.first_period)
        acceleration[: servo.max_speed.shape[0]] = servo.max_acceleration
        return ControlDesignModel(
            model,
            parts,
            build_observer(plan, model, parts, arrivals),
            half_range[rows],
            speed[rows],
            acceleration[rows],
            settings.smoothness_in(scenario),
            integrating,
            model.usual[:, None] * damped_inverse(jacobian) @ integrating,
            spare.T @ spare,
        )


def max_speeds(plan: AssembledScenario) -> PerInput:
    """Return the greatest speed of each input (1/s).

    An input without a limit may pass its range in most of the arm's first period.
    """
    servo = plan.system.base.servo
    speed = np.diff(plan.limits, axis=0)[0] / (_RANGE_TIME * plan.first_period)
    speed[: servo.max_speed.shape[0]] = servo.max_speed
    return speed
