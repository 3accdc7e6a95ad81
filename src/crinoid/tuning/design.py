"""The numbers of a scenario that are tuned, and the controllers that follow from them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, NamedTuple

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Float

from crinoid.assembly.controller import build_controller
from crinoid.assembly.parameters import PidParameters
from crinoid.assembly.plan import Plan
from crinoid.control import Controller
from crinoid.scenario import Mistake, Scenario, ScenarioError

GAINS = ("kp", "ki", "kd")
KINDS = ("pid", "lqg", "mpc")
_STEP = 3e-3
"""Change of a logarithm over which the design is differenced."""

Logs = Float[np.ndarray, " number"]


def tuned_numbers(scenario: Scenario) -> dict[str, float]:
    """Return the tuned numbers of a controller by key; none is 0."""
    if scenario.vary:
        text = "tuning is of one case; give its values with --set and leave out vary"
        raise ScenarioError([Mistake("vary", text)])
    kind = scenario.control.kind
    if kind not in KINDS:
        text = f'got "{kind}", which has nothing to tune, takes "pid", "lqg" or "mpc"'
        raise ScenarioError([Mistake("control.kind", text)])
    if kind == "pid":
        found = dict(_gains(scenario))
        if not found:
            text = "has no gains to tune, takes some that are not 0 to begin with"
            raise ScenarioError([Mistake("control.pid", text)])
        return found
    settings = scenario.control.settings
    return {
        f"control.{kind}.smoothness": settings.smoothness_on(scenario.arm.length),
        f"control.{kind}.integral_time": settings.integral_time,
    }


def _gains(scenario: Scenario) -> Iterator[tuple[str, float]]:
    present = scenario.control.pid.present
    for name in scenario.driven:
        for gain in GAINS:
            if value := getattr(present[name], gain):
                yield f"control.pid.{name}.{gain}", value


class Around(NamedTuple):
    """The controller of some numbers, and those of numbers close by."""

    here: Controller
    more: list[Controller]
    """Each with one of the numbers a little larger."""
    less: list[Controller]

    @property
    def slopes(self) -> Any:
        """Derivatives of the controller's numbers by the logarithms of those that are tuned.

        A tree like the controller's, with the tuned numbers in front; None for what does not
        follow them.
        """

        def slope(here: Any, *others: Any) -> Float[Array, "number ..."] | None:
            if not eqx.is_inexact_array(here):
                return None
            more, less = np.split(np.stack(others), 2)
            found = difference(more, less)
            return jax.device_put(found) if found.any() else None

        return jax.tree.map(slope, self.here, *self.more, *self.less)


def difference(more: np.ndarray, less: np.ndarray) -> np.ndarray:
    """Return the derivative by a logarithm of what was found for more and for less."""
    same = more == less  # limits that are not there are infinite
    return np.subtract(more, less, where=~same, out=np.zeros_like(more)) / (2 * _STEP)


class Design:
    """From the logarithms of the tuned numbers, over those given, to the controller.

    Derivatives of the design are central differences: a gain of a Riccati equation is as smooth as
    one of a PID, and nothing is simulated for it.
    """

    def __init__(self, plan: Plan) -> None:
        self._plan = plan
        self.given = tuned_numbers(plan.scenario)

    def scenario(self, logs: Logs) -> Scenario:
        """Return the scenario with other numbers."""
        factors = np.exp(logs)
        return self._plan.scenario.with_values(
            {
                key: float(f"{value * factor:.12g}")
                for (key, value), factor in zip(self.given.items(), factors, strict=True)
            }
        )

    def controller(self, logs: Logs) -> Controller:
        """Return the controller."""
        scenario = self.scenario(logs)
        pid = PidParameters.of(scenario)
        parameters = eqx.tree_at(lambda x: x.pid, self._plan.parameters, pid)
        return build_controller(replace(self._plan, scenario=scenario, parameters=parameters))

    def around(self, logs: Logs) -> Around:
        """Return the controller, and those close by."""
        steps = _STEP * np.eye(len(logs))
        more, less = ([self.controller(logs + s * step) for step in steps] for s in (1, -1))
        return Around(self.controller(logs), more, less)
