"""From the description of an arm to the arrays that move it. All units become SI and radians."""

from __future__ import annotations

from typing import TYPE_CHECKING

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from scipy.interpolate import CubicSpline

from crinoid.base import CHANNELS, Base, BaseMotion, Servo, SineMotion, TableMotion
from crinoid.dynamics import Forces, Integrator, Settings, System
from crinoid.elements import (
    AddedMass,
    Bend,
    DistributedLoad,
    Drag,
    Element,
    Inertia,
    Stretch,
    TipLoad,
    Weight,
)
from crinoid.flow import Flow, Gust, LogarithmicShear, PowerShear, Sine, Uniform, Water
from crinoid.onset import Onset
from crinoid.rod import Rod
from crinoid.scenario import flow as flows
from crinoid.scenario import load as loads
from crinoid.scenario import motion as motions
from crinoid.spline import PiecewiseCubic

if TYPE_CHECKING:
    from crinoid.scenario.scenario import Scenario

_INTEGRATORS = {
    "newmark": Integrator.newmark,
    "generalized-alpha": Integrator.generalized_alpha,
    "implicit-euler": Integrator.implicit_euler,
}


def build_system(scenario: Scenario) -> System:
    """Assemble the arm, its base and the water of a scenario."""
    simulation = scenario.simulation
    rod = _rod(scenario)
    return System(
        rod=rod,
        forces=Forces(
            tuple(_elements(scenario, rod)),
            Water(tuple(_flow(scenario, flow) for flow in scenario.flow)),
            _array(scenario.base.position),
        ),
        base=_base(scenario, rod),
        integrator=_INTEGRATORS[simulation.integrator](**simulation.integrator_options),
        settings=Settings.for_rod(rod, simulation.tolerance, simulation.max_iterations),
        time_step=_array(simulation.time_step),
        max_halvings=simulation.max_halvings,
    )


def _array(value: object) -> Array:
    return jnp.asarray(value, float)


def _rod(scenario: Scenario) -> Rod:
    arm = scenario.arm
    section = arm.section
    return Rod.round(
        length=arm.length,
        nodes=arm.nodes,
        radius=arm.radii,
        density=arm.density,
        youngs_modulus=arm.youngs_modulus,
        rest_curvature=arm.rest_curvature,
        damping_time=arm.damping_time,
        EA=section.EA,
        EI=section.EI,
        mass_per_length=section.mass_per_length,
        diameter=section.diameter,
        displaced_area=section.displaced_area,
    )


def _elements(scenario: Scenario, rod: Rod) -> list[Element]:
    water = scenario.water
    elements: list[Element] = [
        Stretch.of(rod),
        Bend.of(rod, pinned=scenario.base.mount == "pinned"),
        Inertia.of(rod),
        Weight.of(rod, density=water.density, gravity=water.gravity),
        Drag.of(
            rod,
            density=water.density,
            normal=water.drag_normal,
            tangential=water.drag_tangential,
            linear=water.linear_drag,
        ),
        AddedMass.of(
            rod,
            density=water.density,
            normal=water.added_mass_normal,
            tangential=water.added_mass_tangential,
        ),
    ]
    return elements + [_load(rod, load) for load in scenario.load]


def _load(rod: Rod, load: loads.DistributedLoad | loads.TipLoad) -> Element:
    if isinstance(load, loads.TipLoad):
        dead, following = (0.0, load.force) if load.follower else (load.force, 0.0)
        return TipLoad.of(
            rod,
            dead_force=np.broadcast_to(dead, 2),
            follower_force=np.broadcast_to(following, 2),
            moment=load.moment,
            start=load.start,
            ramp_time=load.ramp_time,
        )
    fixed = np.zeros(2)
    if not isinstance(load.direction, str):
        fixed = np.asarray(load.direction) / np.hypot(*load.direction)
    return DistributedLoad.of(
        rod,
        tangential=load.magnitude * (load.direction == "tangential"),
        normal=load.magnitude * (load.direction == "normal"),
        fixed=load.magnitude * fixed,
        start=load.start,
        ramp_time=load.ramp_time,
    )


def _flow(scenario: Scenario, flow: flows.Flow) -> Flow:
    onset = Onset(_array(flow.start), _array(flow.ramp_time))
    match flow:
        case flows.UniformFlow():
            return Uniform(onset, _array(flow.velocity))
        case flows.GustFlow():
            return Gust(onset, _array(flow.velocity), _array(flow.duration))
        case flows.SineFlow():
            return Sine(
                onset,
                _array(flow.amplitude),
                _array(flow.frequency_hz),
                _array(np.deg2rad(flow.phase_deg)),
            )
        case flows.ShearFlow():
            depth = scenario.water.depth
            assert depth is not None  # the scenario refuses a shear flow without one
            profile = (
                onset,
                _array(flow.velocity),
                _array(depth - flow.reference_depth),
                _array(-depth),
            )
            if flow.power_exponent is None:
                return LogarithmicShear(*profile, _array(flow.roughness_length))
            return PowerShear(*profile, _array(flow.power_exponent))


def _base(scenario: Scenario, rod: Rod) -> Base:
    # a channel that nobody drives has no room to move and any limits
    lower, upper, speed, acceleration, bandwidth = np.array(
        [[0.0] * 3, [0.0] * 3, [1.0] * 3, [1.0] * 3, [1.0] * 3]
    )
    for name, channel in scenario.base.channels.present.items():
        index = CHANNELS.index(name)
        limits = channel.limits
        lower[index], upper[index] = limits.low, limits.high
        speed[index], acceleration[index] = limits.speed, limits.acceleration
        bandwidth[index] = limits.bandwidth_hz
    return Base(
        tilt=_array(np.deg2rad(scenario.base.tilt_deg)),
        ghost_length=rod.rest_length[0],
        servo=Servo(*map(_array, (lower, upper, speed, acceleration, bandwidth))),
        motions=tuple(_motion(motion) for motion in scenario.base.motion),
    )


def _motion(motion: motions.SineMotion | motions.TableMotion) -> BaseMotion:
    channel = CHANNELS.index(motion.channel)
    if isinstance(motion, motions.SineMotion):
        return SineMotion(
            channel,
            _array(motion.amplitude_si),
            _array(motion.frequency_hz),
            _array(np.deg2rad(motion.phase_deg)),
        )
    return TableMotion(channel, PiecewiseCubic(CubicSpline(motion.time, motion.value_si)))
