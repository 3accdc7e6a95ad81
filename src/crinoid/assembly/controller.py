"""From the description of a controller to what commands the inputs."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.assembly.numbers import array
from crinoid.assembly.plan import Plan
from crinoid.control import Controller, FeedForward, Idle, Pid
from crinoid.scenario import Mistake, ScenarioError

_TAKE_UP = 1.0
"""How long a controller takes to answer in full to what is there when it is switched on (s)."""


def build_controller(plan: Plan) -> Controller:
    """Return the controller of a scenario.

    Raises
    ------
    ScenarioError
        If an input that is to be driven does not move what is controlled.
    """
    match plan.scenario.control.kind:
        case "none":
            return Idle()
        case "pid":
            return _pid(plan)
        case "custom":
            text = 'got "custom", which takes a controller passed to crinoid.simulate'
            raise ScenarioError([Mistake("control.kind", text)])
        case _:
            return plan.scenario.control.settings.build(plan)


def build_feed_forward(plan: Plan) -> FeedForward | None:
    """Return what the base does beforehand where the target moves, if the scenario asks for it.

    Raises
    ------
    ScenarioError
        As `build_controller` does.
    """
    scenario = plan.scenario
    if scenario.control.kind == "none" or not scenario.target.feeds_forward:
        return None
    lead = plan.system.base.servo.lag + 0.5 * plan.period
    return FeedForward(
        array(plan.mapping(scenario.driven)),
        padded(lead, len(plan.inputs)),
        array(scenario.control.start),
    )


def padded(values: Float[Array, " channel"], count: int) -> Float[Array, " input"]:
    """Return numbers of the base's channels as those of all inputs, 0 for the others."""
    return jnp.pad(values, (0, count - values.shape[0]))


def _pid(plan: Plan) -> Pid:
    scenario, count = plan.scenario, len(plan.inputs)
    # at t = 0 the arm has been left alone for no time yet: there an error is acted on at once
    bumps = scenario.control.start > 0 or scenario.target.feeds_forward
    gains = plan.parameters.pid.gains()
    return Pid(
        **{name: padded(values, count) for name, values in gains.items()},
        mapping=array(plan.mapping(scenario.driven)),
        period=array(plan.period),
        take_up=array(_TAKE_UP if bumps else 0.0),
    )
