"""From the description of a controller to what commands the inputs."""

import numpy as np

from crinoid.assembly.door import made
from crinoid.assembly.hybrid import build_hybrid
from crinoid.assembly.lags import lags
from crinoid.assembly.lqg import build_lqg
from crinoid.assembly.mpc import build_mpc
from crinoid.assembly.neural import build_neural
from crinoid.assembly.numbers import array
from crinoid.assembly.plan import Plan
from crinoid.assembly.scheduled import build_scheduled
from crinoid.control import Controller, FeedForward, Idle, Pid
from crinoid.scenario import Mistake, Scenario, ScenarioError


def build_controller(plan: Plan) -> Controller:
    """Return the controller of a scenario."""
    match plan.scenario.control.kind:
        case "none":
            return Idle()
        case "pid":
            return _pid(plan)
        case "lqg":
            return build_lqg(plan)
        case "hybrid":
            return build_hybrid(plan)
        case "mpc" if plan.scenario.control.mpc.model == "scheduled":
            return build_scheduled(plan)
        case "mpc":
            return build_mpc(plan)
        case "neural":
            return build_neural(plan)
        case "custom":
            text = 'got "custom", which takes a controller passed to crinoid.simulate'
            raise ScenarioError([Mistake("control.kind", text)])
        case _:
            return made("controller", Controller, plan.scenario.control.settings.build, plan)


def build_feed_forward(plan: Plan) -> FeedForward | None:
    """Return what the base does beforehand where the target moves, if the scenario asks for it."""
    scenario = plan.scenario
    # a network is told of a target by what it observes
    if scenario.control.kind in ("none", "neural") or not scenario.target.feeds_forward:
        return None
    return FeedForward(
        array(plan.mapping(scenario.driven, _weights(scenario))),
        array(lags(plan.system.followers) + 0.5 * plan.period),
        array(scenario.control.start),
    )


def _pid(plan: Plan) -> Pid:
    scenario, weights = plan.scenario, _weights(plan.scenario)
    mapping = plan.mapping(scenario.driven, weights)
    times = {name: gains.return_time for name, gains in scenario.control.pid.present.items()}
    # of what goes back between two commands, the rate that makes it exact for any time
    release = {
        name: -np.expm1(-plan.period / time) / plan.period
        for name, time in times.items()
        if time is not None
    }
    allocation = plan.allocation(scenario.driven, weights, release)
    if allocation is None:
        _check_alone(scenario)
    # at t = 0 the arm has been left alone for no time yet: there an error is acted on at once
    bumps = scenario.control.start > 0 or scenario.target.feeds_forward
    return Pid(
        **plan.parameters.pid.gains(plan.inputs),
        mapping=array(mapping),
        period=array(plan.period),
        take_up=array(plan.first_period if bumps else 0.0),
        allocation=allocation,
    )


def _check_alone(scenario: Scenario) -> None:
    """Refuse what tells inputs how to share, where there are none to share with."""
    text = "got {}, goes with more inputs than it takes for what is controlled"
    mistakes = [
        Mistake(f"control.pid.{name}.{key}", text.format(value))
        for name, gains in scenario.control.pid.present.items()
        for key, value, none in (
            ("weight", gains.weight, 1.0),
            ("return_time", gains.return_time, None),
        )
        if value != none
    ]
    if mistakes:
        raise ScenarioError(mistakes)


def _weights(scenario: Scenario) -> dict[str, float]:
    if scenario.control.kind != "pid":
        return {}
    return {name: gains.weight for name, gains in scenario.control.pid.present.items()}
