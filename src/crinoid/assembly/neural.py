"""From the file of a policy to the controller that it stands in for."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from crinoid.assembly.description import KEY
from crinoid.assembly.observables import Observables, named
from crinoid.assembly.weights import read_policy
from crinoid.control import Neural
from crinoid.scenario import Mistake, ScenarioError

if TYPE_CHECKING:
    from crinoid.assembly.plan import Plan

_SAME = 1e-6
"""Difference of two rates, over one of them, that is none."""


def build_neural(plan: Plan) -> Neural:
    """Return the neural controller of a plan."""
    weights = plan.scenario.control.neural.weights
    assert weights is not None, "a scenario without is refused"
    policy, told = read_policy(Path(weights))
    observables = Observables(plan)
    for words, wanted, there in (
        ("observes", told.observations, named(observables.entries)),
        ("commands", told.actions, named(observables.actions)),
    ):
        if wanted != there:
            text = f"{weights}: it {words} {_listed(wanted)}; here there are {_listed(there)}"
            raise ScenarioError([Mistake(KEY, text)])
    here = plan.scenario.control_rate_hz
    if abs(told.rate_hz - here) > _SAME * here:
        text = f"got {here:g}, takes {told.rate_hz:g}: {weights} was trained for that"
        raise ScenarioError([Mistake("control.rate_hz", text)])
    return Neural(observables.observation, policy)


def _listed(names: list[list[str]]) -> str:
    return ", ".join(f"{name} ({unit})" for name, unit in names)
