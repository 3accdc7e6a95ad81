"""From a scenario to a closed loop that is ready to run."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from crinoid.control import (
    Clock,
    Controller,
    FeedForward,
    Idle,
    Pid,
    Sensor,
    damped_inverse,
)
from crinoid.dynamics import Modes, ModesError, Outcome, SmallMotions, State, System, find_modes
from crinoid.plausibility import Facts, doubts
from crinoid.scenario import Mistake, Scenario, ScenarioError
from crinoid.simulation.build_target import build_target
from crinoid.simulation.loop import Loop
from crinoid.simulation.margin import OpenLoop, loop_doubts
from crinoid.simulation.response import Plant
from crinoid.space import CHANNELS, POSE

_ROUND_OFF = 1e-9
"""Movement of the tip over that of a channel, turns at the arm's length, that is none."""
_UNUSED = 1e-6
"""Answer of a channel to an error, over that of the channel that answers most: none at all."""
_TAKE_UP = 1.0
"""How long a controller takes to answer in full to what is there when it is switched on (s)."""


class Setup(NamedTuple):
    """A loop and the state that it starts from."""

    loop: Loop
    state: State
    outcome: Outcome
    """Of the static solve; that of nothing to solve where the arm starts undeformed."""
    modes: Modes | None
    """Small vibrations about the state; none where no equilibrium was found."""
    doubts: list[str]
    """Notes on odd numbers of the scenario, a sentence each."""
    open_loop: OpenLoop | None
    """The loop, cut open, in the mean current; none without a PID."""
    loop_doubts: list[str]
    """Notes on the closed loop."""


def set_up(scenario: Scenario) -> Setup:
    """Assemble the loop of a scenario and find the arm's state at the start."""
    system = scenario.system()
    control = scenario.control
    mapped = control.kind != "none" and control.mapping == "static-jacobian"
    loaded = scenario.simulation.start == "equilibrium"
    _check_room(system)
    current = jnp.asarray(Facts(scenario).mean_current)
    state, outcome, tip, small, jacobian, ends = _start(system, current, loaded, mapped)
    modes, told = None, doubts(scenario)
    if not outcome.converged:  # nothing will be run, and the shape that is left means nothing
        jacobian = None
    else:
        try:
            modes = find_modes(small.stiffness, small.mass)
        except ModesError as error:  # a run does without
            told = [*told, f"{error}; the result has neither them nor what follows from them"]
    swings_free = modes is not None and scenario.base.mount == "pinned" and not modes.frequency[0]
    if jacobian is not None and swings_free:
        # the stiffness is singular: what its inverse says is round-off
        jacobian = jnp.full_like(jacobian, jnp.nan)
    loop = Loop(
        system=system,
        sensor=_sensor(scenario),
        controller=_controller(scenario, jacobian),
        clock=Clock(jnp.asarray(1.0 / scenario.control_rate_hz)),
        switched_on=jnp.asarray(scenario.control.start),
        target=build_target(scenario, system, tip),
        feed_forward=_feed_forward(scenario, system, jacobian),
        enabled=jnp.asarray(True),
    )
    open_loop = None
    # an arm that does not swing back by itself has no response to speak of
    if control.kind == "pid" and modes is not None and np.all(modes.frequency > 0):
        open_loop = _open_loop(loop, small, ends, modes)
    found = loop_doubts(open_loop, control.pid.present) if open_loop is not None else []
    return Setup(loop, state, outcome, modes, told, open_loop, found)


def _open_loop(
    loop: Loop, small: SmallMotions, ends: tuple[Array, Array], modes: Modes
) -> OpenLoop:
    """Return the loop, cut open, in the mean current."""
    assert isinstance(loop.controller, Pid)
    return OpenLoop.of(
        Plant(
            stiffness=np.asarray(small.stiffness_in_current),
            damping=np.asarray(small.damping_in_current),
            mass=np.asarray(small.mass),
            held=np.asarray(ends[0]),
            tip=np.asarray(ends[1]),
        ),
        loop.system.base.servo,
        loop.sensor,
        loop.controller,
        time_step=float(loop.system.time_step),
        resonances=modes.frequency,
    )


def _find_start(
    system: System, current: Float[Array, " d"], loaded: bool, mapped: bool
) -> tuple[
    State,
    Outcome,
    Float[Array, " pose"],
    SmallMotions,
    Float[Array, "pose channel"] | None,
    tuple[Float[Array, "2 b channel"], Float[Array, "pose 3 d"]],
]:
    state, outcome = (
        system.find_equilibrium() if loaded else (system.rest(), Outcome.of_nothing(converged=True))
    )
    small = system.small_motions(state, current)
    return (
        state,
        outcome,
        system.tip(state),
        small,
        system.static_jacobian(state, small.stiffness) if mapped else None,
        (system.held(state), system.tip_follows(state)),
    )


# Runs once: less time to compile is worth more than milliseconds of running. (The type of
# `filter_jit` leaves out the options that it hands on to JAX.)
_start = eqx.filter_jit(
    _find_start,
    compiler_options={"xla_backend_optimization_level": 0},  # type: ignore[call-overload]
)


_clearance = eqx.filter_jit(System.clearance)


def check_room(scenario: Scenario) -> None:
    """Refuse obstacles that lie within the arm as it is without load.

    Raises
    ------
    ScenarioError
        If there are any; or if a file that the scenario names is not what it takes.
    """
    if scenario.obstacle:
        _check_room(scenario.system())


def _check_room(system: System) -> None:
    if system.forces.obstacles is None:
        return
    mistakes = [
        Mistake(
            f"obstacle.{index}.position",
            f"lies {-1e3 * gap:.3g} mm inside the arm without load, takes a place clear of it",
        )
        for index, gap in enumerate(np.asarray(_clearance(system)))
        if gap < 0
    ]
    if mistakes:
        raise ScenarioError(mistakes)


def _sensor(scenario: Scenario) -> Sensor:
    sensor = scenario.sensor
    rate = scenario.sensor_rate_hz
    axes = scenario.arm.dimension
    turns = len(POSE[axes]) - axes
    noise = [sensor.noise_position] * axes + [np.deg2rad(sensor.noise_angle_deg)] * turns
    return Sensor(
        clock=Clock(jnp.asarray(1.0 / rate)),
        delay=jnp.asarray(sensor.delay),
        noise=jnp.asarray(noise),
        key=jax.random.key(scenario.seed),
        # where the rate does not divide the time step samples may bunch: one more is under way
        kept=int(np.ceil(sensor.delay * rate)) + 2,
    )


def _feed_forward(scenario: Scenario, system: System, jacobian: Array | None) -> FeedForward | None:
    control = scenario.control
    if control.kind == "none" or not scenario.target.feeds_forward:
        return None
    mapping = _mapping(scenario, jacobian, list(control.pid.present))
    held = 0.5 / scenario.control_rate_hz
    return FeedForward(
        jnp.asarray(mapping), system.base.servo.lag + held, jnp.asarray(control.start)
    )


def _controller(scenario: Scenario, jacobian: Array | None) -> Controller:
    match scenario.control.kind:
        case "none":
            return Idle(len(CHANNELS[scenario.arm.dimension]))
        case "pid":
            return _pid(scenario, jacobian)


def _pid(scenario: Scenario, jacobian: Array | None) -> Pid:
    channels, driven = CHANNELS[scenario.arm.dimension], scenario.control.pid.present
    limits = {name: channel.limits for name, channel in scenario.base.channels.present.items()}

    def per_channel(values: dict[str, float]) -> Float[Array, " channel"]:
        return jnp.asarray([values.get(name, 0.0) for name in channels])

    # at t = 0 the arm has been left alone for no time yet: there an error is acted on at once
    bumps = scenario.control.start > 0 or scenario.target.feeds_forward
    filter_time = {name: 0.5 / (np.pi * g.derivative_filter_hz) for name, g in driven.items()}
    return Pid(
        kp=per_channel({name: gains.kp for name, gains in driven.items()}),
        ki=per_channel({name: gains.ki for name, gains in driven.items()}),
        kd=per_channel({name: gains.kd for name, gains in driven.items()}),
        filter_time=per_channel(filter_time),
        mapping=jnp.asarray(_mapping(scenario, jacobian, list(driven))),
        lower=per_channel({name: limit.low for name, limit in limits.items()}),
        upper=per_channel({name: limit.high for name, limit in limits.items()}),
        period=jnp.asarray(1.0 / scenario.control_rate_hz),
        take_up=jnp.asarray(_TAKE_UP if bumps else 0.0),
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
