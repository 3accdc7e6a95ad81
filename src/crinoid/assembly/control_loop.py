"""Sensors, target and controller of a scenario."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from crinoid.actuation import Actuator
from crinoid.assembly.arrays import array
from crinoid.assembly.door import build_part
from crinoid.assembly.plan import AssembledScenario, Parts
from crinoid.control import (
    Clock,
    Controller,
    FeedForward,
    Line,
    Measurand,
    Orbit,
    Pid,
    Sensor,
    SubmarineFrame,
    Target,
    TipPose,
)
from crinoid.dynamics import System
from crinoid.foundation.axes import POSE
from crinoid.numerics.piecewise import PiecewisePolynomial, between, shape_preserving
from crinoid.numerics.ramp import Onset
from crinoid.scenario import Mistake, Scenario, ScenarioError
from crinoid.scenario import Target as TargetTable
from crinoid.scenario.quantity import unit_vector
from crinoid.scenario.sensor import Sampling

if TYPE_CHECKING:
    from crinoid.recording import Series

Numbers = float | Sequence[float]  # one for each value, or one for all


def build_sensors(scenario: Scenario) -> tuple[Sensor, ...]:
    """Return the sensors of a scenario, that of the tip first."""
    tip, axes = scenario.sensor, scenario.arm.dimension
    turns = len(POSE[axes]) - axes
    noise, resolution = (
        [position] * axes + [np.deg2rad(angle)] * turns
        for position, angle in (
            (tip.noise_position, tip.noise_angle_deg),
            (tip.resolution_position, tip.resolution_angle_deg),
        )
    )
    sensors = [build_sensor(scenario, 0, tip, "tip", TipPose(), noise, resolution)]
    for index, table in enumerate(scenario.sensors, start=1):
        place = f"sensor {table.called}"
        measured = build_part(place, 3, table.build, scenario)
        given = scenario, index, table, table.called, *measured
        sensors.append(build_part(place, Sensor, build_sensor, *given))
    return tuple(sensors)


def build_sensor(
    scenario: Scenario,
    index: int,
    table: Sampling,
    name: str,
    measurand: Measurand,
    noise: Numbers,
    resolution: Numbers,
) -> Sensor:
    """Return sensor number ``index``; noise and resolution (SI) of each value, or one for all."""
    rate, axes = scenario.rate_hz(table.rate_hz), scenario.arm.dimension
    size = len(measurand.names(axes))
    # as `jax.random.key` makes it, for which nothing need be compiled
    words = jax.device_put(np.array(divmod(scenario.seed, 1 << 32), np.uint32))
    key = jax.random.wrap_key_data(words, impl="threefry2x32")
    return Sensor(
        name=name,
        measurand=measurand,
        clock=Clock(array(1.0 / rate)),
        delay=array(table.delay),
        noise=array(np.broadcast_to(noise, size)),
        resolution=array(np.broadcast_to(resolution, size)),
        key=jax.random.fold_in(key, index) if index else key,
        # where the rate does not divide the time step samples may bunch: one more is under way
        kept=int(np.ceil(table.delay * rate)) + 2,
    )


_RAMP_TIME = 1.0
_ALONG = 1e-6  # sine of an angle below which two directions are one


def build_target(
    scenario: Scenario, path: Series | None, system: System, tip: Float[Array, " pose"]
) -> Target:
    """Return the target of a scenario, for an arm whose tip has the pose ``tip`` at t = 0.

    ``path`` is the series of its file, if it names one.
    """
    target, axes = scenario.target, scenario.arm.dimension
    carrier = None
    if target.frame == "base":
        carrier = SubmarineFrame(system.base, system.forces.origin)
        tip = carrier.to_frame(tip, jnp.zeros(()))
    fixed = np.array(tip)
    if isinstance(target.tip, tuple) and target.tip_path is None:
        fixed[:axes] = target.tip
    turns, steady = _pointing(target, axes)
    if steady is not None:
        fixed[axes:] = steady
    places, pointing = tuple(range(axes)), tuple(range(axes, fixed.size))
    if target.path in ("circle", "sine", "line"):
        return Target(array(fixed), _formula(target, fixed[:axes]), places, carrier)
    if path is not None:
        times, points = path.time, path.values
        moving = (places + pointing)[: points.shape[1]]
    else:
        given = [(places, target.tip_path), (pointing, turns)]
        listed = [(where, points) for where, points in given if points is not None]
        if not listed:
            return Target(array(fixed), None, (), carrier)
        moving = tuple(index for where, _ in listed for index in where)
        times = np.asarray(target.time)
        points = np.concatenate([points for _, points in listed], axis=1)
    # whole at its end: the feed-forward looks ahead
    curve = between(shape_preserving(times, points), 0.0, np.inf)
    return Target(array(fixed), PiecewisePolynomial(curve), moving, carrier)


def _pointing(
    target: TargetTable, axes: int
) -> tuple[Float[np.ndarray, "time angle"] | None, Float[np.ndarray, " angle"] | None]:
    """Return the directions of the target along its path, and its fixed direction, if given."""
    if axes == 2:
        if target.angle_path_deg is not None:
            return np.deg2rad(target.angle_path_deg)[:, None], None
        if isinstance(target.angle_deg, str):
            return None, None
        return None, np.deg2rad([target.angle_deg])
    if target.direction_path is not None:
        return np.asarray(target.direction_path), None
    steady = target.steady_direction
    return None, None if steady is None else np.asarray(steady)


def _formula(
    target: TargetTable, begin: Float[np.ndarray, " d"]
) -> PiecewisePolynomial | Orbit | Line:
    start = target.start or 0.0
    if target.to is not None:
        from scipy.interpolate import BPoly, PPoly  # slow to load, and often not needed

        # the least jerk from rest to rest (Flash and Hogan, J. Neurosci. 5 (1985) 1688-1703)
        still = np.zeros_like(begin)
        ends = [[begin, still, still], [np.asarray(target.to), still, still]]
        times = [start, start + (target.travel_time or 0.0)]
        return PiecewisePolynomial(PPoly.from_bernstein_basis(BPoly.from_derivatives(times, ends)))
    onset = Onset.of(start, _RAMP_TIME if target.ramp_time is None else target.ramp_time)
    if target.velocity is not None:
        return Line(array(begin), array(target.velocity), onset)
    if target.amplitude is not None:
        cosine, sine = np.zeros_like(begin), np.asarray(target.amplitude)
        rate = 2 * np.pi * (target.frequency_hz or 0.0)
    else:
        cosine, sine = (target.radius or 0.0) * _plane_of(target, begin.size)
        rate = 2 * np.pi / (target.period or np.inf)
    phase = np.deg2rad(target.phase_deg or 0.0)
    centre = begin - np.cos(phase) * cosine - np.sin(phase) * sine
    if target.centre is not None:
        centre = np.asarray(target.centre)
    return Orbit(array(centre), array(cosine), array(sine), array(rate), array(phase), onset)


def _plane_of(target: TargetTable, axes: int) -> Float[np.ndarray, "2 d"]:
    """Return unit vectors from a circle's centre to its start, and to a quarter turn on."""
    if axes == 2:
        return np.eye(2)
    normal = np.asarray(unit_vector(target.normal or (0.0, -1.0, 0.0)))
    for axis in np.eye(3):  # x, or y where the normal is along x
        first = axis - (axis @ normal) * normal
        length = np.linalg.norm(first)
        if length > _ALONG:
            return np.stack([first / length, np.cross(normal, first / length)])
    raise AssertionError("no vector is along both x and y")


def build_controller(plan: AssembledScenario, parts: Parts | None = None) -> Controller:
    """Return the controller of a scenario, or that among the parts in its place."""
    given = None if parts is None else parts.controller
    if isinstance(given, Controller):
        return given
    build = given or plan.scenario.control.settings.build
    return build_part("controller", Controller, build, plan)


def build_feed_forward(plan: AssembledScenario) -> FeedForward | None:
    """Return the feed-forward of a moving target, if the scenario asks for it."""
    scenario = plan.scenario
    if not (scenario.control.settings.feeds_forward and scenario.target.feeds_forward):
        return None
    return FeedForward(
        array(plan.mapping(scenario.driven, _weights(scenario))),
        array(lags(plan.system.followers) + 0.5 * plan.period),
        array(scenario.control.start),
    )


def build_pid(plan: AssembledScenario) -> Pid:
    """Return the PID controller of a scenario."""
    scenario, weights = plan.scenario, _weights(plan.scenario)
    mapping = plan.mapping(scenario.driven, weights)
    # of what goes back between two commands, the rate that makes it exact for any time
    release = {
        name: -np.expm1(-plan.period / gains.return_time) / plan.period
        for name, gains in scenario.control.gains.items()
        if gains.return_time is not None
    }
    allocation = plan.allocation(scenario.driven, weights, release)
    if allocation is None:
        _check_alone(scenario)
    # at t = 0 the arm has been left alone for no time yet: there an error is acted on immediately
    bumps = scenario.control.start > 0 or scenario.target.feeds_forward
    return Pid(
        **plan.parameters.pid.gains(plan.inputs),
        mapping=array(mapping),
        period=array(plan.period),
        take_up=array(plan.first_period if bumps else 0.0),
        allocation=allocation,
    )


def _check_alone(scenario: Scenario) -> None:
    """Refuse settings of shared work where inputs are no more than needed."""
    text = "got {}; must be left out unless more inputs are driven "
    text += "than the controlled coordinates need"
    mistakes = [
        Mistake(f"control.pid.{name}.{key}", text.format(value))
        for name, gains in scenario.control.gains.items()
        for key, value, none in (
            ("weight", gains.weight, 1.0),
            ("return_time", gains.return_time, None),
        )
        if value != none
    ]
    if mistakes:
        raise ScenarioError(mistakes)


def _weights(scenario: Scenario) -> dict[str, float]:
    return {name: gains.weight for name, gains in scenario.control.gains.items()}


_SLOW = 1e-6  # frequency of a slow command (Hz)


def lags(followers: Iterable[Actuator]) -> Float[np.ndarray, " input"]:
    """Return the lag of each input behind a slow command (s)."""
    slow = np.array([_SLOW])
    found = np.concatenate([each.response(slow)[0] for each in followers])
    return -found.imag / (2 * np.pi * _SLOW)
