"""From the description of a controller to what commands the base: gains, limits and mapping."""

import numpy as np
from jaxtyping import Array, Float

from crinoid.assembly.numbers import array
from crinoid.assembly.parameters import Parameters
from crinoid.control import Controller, FeedForward, Idle, Pid, damped_inverse
from crinoid.dynamics import System
from crinoid.scenario import Mistake, Scenario, ScenarioError
from crinoid.space import CHANNELS, POSE

_ROUND_OFF = 1e-9
"""Movement of the tip over that of a channel, turns at the arm's length, that is none."""
_UNUSED = 1e-6
"""Answer of a channel to an error, over that of the channel that answers most: none at all."""
_TAKE_UP = 1.0
"""How long a controller takes to answer in full to what is there when it is switched on (s)."""


def build_controller(
    scenario: Scenario, parameters: Parameters, jacobian: Array | None
) -> Controller:
    """Return the controller of a scenario.

    Parameters
    ----------
    scenario
        What to control, and how.
    parameters
        Its numbers.
    jacobian
        Of the tip's pose by the channels, where the scenario maps errors by it.

    Raises
    ------
    ScenarioError
        If a channel that is to be driven does not move what is controlled.
    """
    match scenario.control.kind:
        case "none":
            return Idle(len(CHANNELS[scenario.arm.dimension]))
        case "pid":
            return _pid(scenario, parameters, jacobian)


def build_feed_forward(
    scenario: Scenario, system: System, jacobian: Array | None
) -> FeedForward | None:
    """Return what the base does beforehand where the target moves, if the scenario asks for it.

    Raises
    ------
    ScenarioError
        As `build_controller` does.
    """
    control = scenario.control
    if control.kind == "none" or not scenario.target.feeds_forward:
        return None
    mapping = _mapping(scenario, jacobian, list(control.pid.present))
    held = 0.5 / scenario.control_rate_hz
    return FeedForward(array(mapping), system.base.servo.lag + held, array(control.start))


def _pid(scenario: Scenario, parameters: Parameters, jacobian: Array | None) -> Pid:
    servo = parameters.base.servo
    # at t = 0 the arm has been left alone for no time yet: there an error is acted on at once
    bumps = scenario.control.start > 0 or scenario.target.feeds_forward
    return Pid(
        **parameters.pid.gains(),
        mapping=array(_mapping(scenario, jacobian, list(scenario.control.pid.present))),
        lower=servo.lower,
        upper=servo.upper,
        period=array(1.0 / scenario.control_rate_hz),
        take_up=array(_TAKE_UP if bumps else 0.0),
    )


def _mapping(
    scenario: Scenario, jacobian: Array | None, driven: list[str]
) -> Float[np.ndarray, "channel pose"]:
    """Return the errors of the driven channels per error of the tip's pose."""
    control, axes = scenario.control, scenario.arm.dimension
    channels, coordinates = CHANNELS[axes], POSE[axes]
    mapping = np.zeros((len(channels), len(coordinates)))
    rows = [channels.index(name) for name in driven]
    if jacobian is None:
        # x with slide, z with heave, angle with tilt; in space x, y, z with slide, sway, heave
        mapping[rows, rows] = 1.0
        return mapping
    # a direction in space has three coordinates
    columns = [
        column
        for name in control.controlled
        for column, coordinate in enumerate(coordinates)
        if coordinate == name or coordinate.startswith(f"{name}_")
    ]
    needed = np.asarray(jacobian)[np.ix_(columns, rows)]
    if not np.isfinite(needed).all():
        text = (
            'got "static-jacobian", but nothing brings this arm back to where it is at rest, so '
            'its tip does not follow the base; takes "identity", or an arm with a clamp or a weight'
        )
        raise ScenarioError([Mistake("control.mapping", text)])
    weights = np.where(np.asarray(columns) < axes, 1.0, scenario.arm.length)
    weighed = weights[:, None] * needed
    weighed[np.abs(weighed) < _ROUND_OFF] = 0.0
    inverse = damped_inverse(weighed) * weights
    _check_use(driven, inverse)
    mapping[np.ix_(rows, columns)] = inverse
    return mapping


def _check_use(names: list[str], inverse: Float[np.ndarray, "channel coordinate"]) -> None:
    """Refuse gains of channels that do nothing for what is controlled."""
    most = np.abs(inverse).max(axis=1)
    mistakes = [
        Mistake(
            f"control.pid.{name}",
            f"does nothing: nothing of the tip that is controlled follows {name} from the start; "
            "takes a channel that moves it",
        )
        for name, share in zip(names, most, strict=True)
        if share <= _UNUSED * most.max()
    ]
    if mistakes:
        raise ScenarioError(mistakes)
