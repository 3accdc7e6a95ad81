"""All that controllers know that are designed on a linear model: arm, water, sensors, limits."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from jaxtyping import Float

from crinoid.assembly.fluctuation import fluctuations
from crinoid.assembly.linear import LinearModel, linear_model
from crinoid.assembly.observer import Arrivals, Augmented, Water, augmented, build_observer
from crinoid.control import Inclination, Observer, Shape, damped_inverse
from crinoid.scenario import Mistake, ScenarioError, one_of
from crinoid.scenario.errors import shown
from crinoid.scenario.lqg import ModelBased

if TYPE_CHECKING:
    from crinoid.assembly.plan import Plan

PerInput = Float[np.ndarray, " u"]

_MOST_SHAPES = 3
"""Most shapes along the arm that the water's velocity is made of."""
_RANK = 1e-2
"""Movement of the tip, over the largest that the inputs make, that is none."""
_PASSED, _BRISK = 0.6, 0.06
"""Times over the arm's first period in which inputs without such limits pass their range, and in
which they reach their greatest speed."""


class Known(NamedTuple):
    """All that controllers know that are designed on a linear model."""

    model: LinearModel
    parts: Augmented
    observer: Observer
    reach: PerInput
    """Half the range of each driven input."""
    speed: PerInput
    """Its greatest speed (1/s)."""
    acceleration: PerInput
    """Its greatest acceleration (1/s2)."""
    worth: float
    """Error of the tip that counts as much as an input at its greatest speed (m)."""
    integrating: Float[np.ndarray, "controlled pose"]
    """Error of what is controlled and can be, in metres, by the error of the pose."""
    mapping: Float[np.ndarray, "u pose"]
    """Commands that move the tip at rest."""
    spare: Float[np.ndarray, "u u"]
    """Part of commands, over half their ranges, that moves nothing of the tip at rest."""

    @property
    def tip(self) -> Float[np.ndarray, "controlled known"]:
        """How what is controlled follows the estimate (m)."""
        return self.integrating @ self.parts.tip

    @staticmethod
    def of(plan: Plan, settings: ModelBased, *, foreseen: int = 0) -> Known:
        """Linearise the arm of a plan, and design its observer.

        The model is of water with at least ``foreseen`` shapes along the arm.
        """
        scenario = plan.scenario
        there = (*scenario.base.channels.present, *scenario.thread_names)
        if missing := [name for name in settings.inputs or () if name not in there]:
            text = f"got {shown(missing[0])}, takes {one_of(there, 'and')}"
            raise ScenarioError([Mistake(f"control.{scenario.control.kind}.inputs", text)])
        stations = [
            each.measurand.stations.shape[0]
            for each in plan.sensors
            if isinstance(each.measurand, (Shape, Inclination))
        ]
        shapes = min(1 + sum(stations), _MOST_SHAPES)
        expected = fluctuations(scenario, plan.recordings, plan.first_period)
        deviation = np.sqrt(np.sum([each.deviation**2 for each in expected], axis=0))
        model = linear_model(plan, scenario.driven, max(shapes, foreseen), deviation)
        water, most = Water.of(expected, shapes, plan.period), shapes * deviation.size
        observed = model._replace(
            stirred=model.steeper * model.stirred[:, :most],
            hastened=model.hastened[:, :most],
            observed_water=model.observed_water[:, :most],
        )
        arrivals = Arrivals.of(plan.sensors, plan.period, float(plan.system.time_step))
        parts = augmented(observed, water, arrivals, plan)
        columns, scale = plan.controlled
        integrating = np.zeros((len(columns), plan.sensors[0].noise.shape[0]))
        integrating[np.arange(len(columns)), columns] = scale
        jacobian = integrating @ _jacobian(model)[: integrating.shape[1]] * model.usual
        # of what inputs do not move an integral would never end
        ways, moved, _ = np.linalg.svd(jacobian, full_matrices=False)
        moves = moved > _RANK * moved.max(initial=0.0)
        integrating, jacobian = (ways[:, moves].T @ each for each in (integrating, jacobian))
        if not moves.any():
            text = "nothing of the tip that is controlled follows what is driven"
            raise ScenarioError([Mistake(f"control.{scenario.control.kind}", text)])
        spare = np.linalg.svd(jacobian)[2][len(jacobian) :]
        return Known(
            model,
            parts,
            build_observer(plan, model, parts, arrivals),
            *_most(plan, model.rows),
            settings.smoothness_on(scenario.arm.length),
            integrating,
            model.usual[:, None] * damped_inverse(jacobian) @ integrating,
            spare.T @ spare,
        )


def _jacobian(model: LinearModel) -> Float[np.ndarray, "y u"]:
    """Return how readings follow commands that move slowly."""
    followed = np.linalg.solve(np.eye(model.actuators.shape[0]) - model.actuators, model.commanded)
    arm = np.linalg.solve(np.eye(model.arm.shape[0]) - model.arm, model.held + model.driven)
    return (model.observed @ arm + model.observed_actuators) @ followed


def fastest(plan: Plan) -> PerInput:
    """Return the greatest speed of each input (1/s).

    One that has no limit of its own may pass its range in most of the arm's first period.
    """
    servo = plan.system.base.servo
    speed = np.array([float(each.upper) - float(each.lower) for each in plan.inputs])
    speed /= _PASSED * plan.first_period
    speed[: servo.max_speed.shape[0]] = servo.max_speed
    return speed


def _most(plan: Plan, rows: tuple[int, ...]) -> tuple[PerInput, PerInput, PerInput]:
    """Return half the range, and greatest speed and acceleration, of each driven input."""
    servo, speed = plan.system.base.servo, fastest(plan)
    reach = np.array([0.5 * (float(each.upper) - float(each.lower)) for each in plan.inputs])
    acceleration = speed / (_BRISK * plan.first_period)
    acceleration[: servo.max_speed.shape[0]] = servo.max_acceleration
    chosen = list(rows)
    return reach[chosen], speed[chosen], acceleration[chosen]
