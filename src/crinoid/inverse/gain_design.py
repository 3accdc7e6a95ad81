"""Design of a controller from its tuned parameters, and the cost of a run with its gradient."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from crinoid.assembly.control_loop import build_controller
from crinoid.assembly.parameters import PidParameters
from crinoid.assembly.plan import AssembledScenario
from crinoid.compilation import OFTEN, compiled
from crinoid.control import Controller
from crinoid.dynamics import State
from crinoid.foundation.axes import POSE
from crinoid.results.errors import judged_at
from crinoid.scenario import Scenario, ScenarioError, one_of
from crinoid.scenario.errors import got
from crinoid.simulation import Loop, rollout

_EFFORT_TIME = 0.01
"""Time constant that weighs the speed of inputs against the error of the tip (s)."""
_FEW = 3
"""Number of parameters up to which forward mode is faster: it costs half a run for each parameter,
reverse mode two runs for all."""


class CostWeights(NamedTuple):
    """Weights that turn errors and inputs into metres, and the time steps that count."""

    pose: Float[np.ndarray, " pose"]
    """Weights of the errors of the tip's pose; 0 for coordinates that are not controlled."""
    inputs: Float[np.ndarray, " input"]
    """Weights of the inputs."""
    counted: Float[np.ndarray, " step"]
    """1 at time steps that end after `crinoid.Scenario.judged_from`, else 0."""

    @staticmethod
    def of(scenario: Scenario, loop: Loop) -> CostWeights:
        """Return the weights of a scenario: the arm's length for angles and shares."""
        length, axes = scenario.arm.length, scenario.arm.dimension
        controlled = scenario.control.controlled
        pose = [
            (1.0 if index < axes else length) * (name.partition("_")[0] in controlled)
            for index, name in enumerate(POSE[axes])
        ]
        inputs = [1.0 if each.unit == "m" else length for each in loop.system.inputs]
        ends = scenario.simulation.time_step * np.arange(1, scenario.simulation.steps + 1)
        counted = judged_at(ends, scenario).astype(float)
        return CostWeights(np.array(pose), np.array(inputs), counted)


class Cost(eqx.Module):
    """Cost of a controller in one run."""

    total: Float[Array, ""]
    """Mean squared error of the controlled coordinates, plus the penalty on input speeds (m2)."""
    gradient: Float[Array, " number"]
    """Derivative of the total by the logarithm of each tuned parameter (m2)."""
    error: Float[Array, ""]
    """Mean squared distance of the tip from its target (m2)."""
    converged: Bool[Array, ""]
    """Whether all time steps succeeded."""
    reason: Int[Array, ""]
    """Why the first time step that failed did so (`crinoid.dynamics.Reason`)."""
    steps: Int[Array, ""]
    """Number of time steps that succeeded."""


@compiled(**OFTEN)
def cost(
    controller: Controller, slopes: Any, loop: Loop, state: State, weights: CostWeights, steps: int
) -> Cost:
    """Run a loop with another controller, and return its cost.

    ``slopes`` are the derivatives of the controller by the logarithms of the tuned parameters
    (`GainPerturbations.slopes`).
    """
    count = jax.tree.leaves(slopes)[0].shape[0]

    def of(logs: Array) -> tuple[Array, Cost]:
        moved = jax.tree.map(lambda each: jnp.tensordot(logs, each, 1), slopes)
        changed = eqx.apply_updates(controller, moved)
        run = rollout(eqx.tree_at(lambda x: x.controller, loop, changed), state, steps)
        record, axes = run.kept, loop.system.forces.axes
        share = jnp.asarray(weights.counted) / jnp.sum(weights.counted)
        error = share @ jnp.sum((weights.pose * record.error) ** 2, axis=1)
        moves = jnp.diff(record.command, axis=0, prepend=0.0) * weights.inputs
        # a command lasts for a period of the controller
        speed = share @ jnp.sum(moves**2, axis=1) / (loop.clock.period * loop.system.time_step)
        total = error + _EFFORT_TIME**2 * speed
        distance = share @ jnp.sum(record.error[:, :axes] ** 2, axis=1)
        outcome = run.outcome
        return total, Cost(total, logs, distance, outcome.converged, outcome.reason, run.end.steps)

    derivative = jax.jacfwd if count <= _FEW else jax.grad
    gradient, found = derivative(of, has_aux=True)(jnp.zeros(count))
    return eqx.tree_at(lambda x: x.gradient, found, gradient)


GAINS = ("kp", "ki", "kd")
KINDS = ("pid", "lqg", "mpc")
_STEP = 3e-3
"""Step of a logarithm in central differences of the design."""

Logs = Float[np.ndarray, " number"]


def tunable_numbers(scenario: Scenario) -> dict[str, float]:
    """Return the parameters that tuning varies, by key, at their present values."""
    if scenario.vary:
        text = "tuning needs a single case. Omit vary, and set the values by --set."
        raise ScenarioError.of("vary", text)
    kind = scenario.control.kind
    if kind not in KINDS:
        text = got(kind, f"be {one_of(KINDS)}", "Other controllers have nothing to tune.")
        raise ScenarioError.of("control.kind", text)
    if kind == "pid":
        found = {
            f"control.pid.{name}.{gain}": value
            for name in scenario.driven
            for gain in GAINS
            if (value := getattr(scenario.control.pid.present[name], gain))
        }
        if not found:
            text = "has no gains to tune. Set initial gains other than 0."
            raise ScenarioError.of("control.pid", text)
        return found
    settings = scenario.control.settings
    return {
        f"control.{kind}.smoothness": scenario.smoothness_of(settings),
        f"control.{kind}.integral_time": settings.integral_time,
    }


class GainPerturbations(NamedTuple):
    """A controller, and the controllers for perturbed parameters."""

    nominal: Controller
    plus: list[Controller]
    """One controller for each parameter, which is slightly larger."""
    minus: list[Controller]

    @property
    def slopes(self) -> Any:
        """Derivatives of the controller by the logarithms of the tuned parameters.

        A tree like the controller's, with the parameters as first axis; None for constant leaves.
        """

        def slope(nominal: Any, *others: Any) -> Float[Array, "number ..."] | None:
            if not eqx.is_inexact_array(nominal):
                return None
            found = central_difference(*np.split(np.stack(others), 2))
            return jax.device_put(found) if found.any() else None

        return jax.tree.map(slope, self.nominal, *self.plus, *self.minus)


def central_difference(plus: np.ndarray, minus: np.ndarray) -> np.ndarray:
    """Return the derivative by a logarithm, from the values for perturbed parameters."""
    same = plus == minus  # absent limits are infinite
    return np.subtract(plus, minus, where=~same, out=np.zeros_like(plus)) / (2 * _STEP)


class GainDesign:
    """Design of a controller for the logarithms of its parameters, over their initial values.

    Its derivatives are central differences: gains of a Riccati equation are smooth as well, and
    need no simulation.
    """

    def __init__(self, plan: AssembledScenario) -> None:
        self._plan = plan
        self.initial = tunable_numbers(plan.scenario)

    def values(self, logs: Logs, *, digits: int = 12) -> dict[str, float]:
        """Return the parameters by key, rounded."""
        pairs = zip(self.initial.items(), np.exp(logs), strict=True)
        return {key: float(f"{value * factor:.{digits}g}") for (key, value), factor in pairs}

    def controller(self, logs: Logs) -> Controller:
        """Return the controller."""
        scenario = self._plan.scenario.with_values(self.values(logs))
        pid = PidParameters.of(scenario)
        parameters = eqx.tree_at(lambda x: x.pid, self._plan.parameters, pid)
        return build_controller(replace(self._plan, scenario=scenario, parameters=parameters))

    def perturbations(self, logs: Logs) -> GainPerturbations:
        """Return the controller, and those for perturbed parameters."""
        steps = _STEP * np.eye(len(logs))
        plus, minus = ([self.controller(logs + s * step) for step in steps] for s in (1, -1))
        return GainPerturbations(self.controller(logs), plus, minus)
