"""From the description of an arm to the arrays that move it. All units become SI and radians."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

import jax
import numpy as np
from jaxtyping import Array

from crinoid.assembly.flow import build_flow
from crinoid.assembly.numbers import Numbers, array
from crinoid.assembly.obstacle import body_numbers, build_obstacles, contact_numbers
from crinoid.base import Base, BaseMotion, Servo, SineMotion, TableMotion, VelocityMotion
from crinoid.dynamics import Forces, Integrator, Settings, System
from crinoid.elements import (
    AddedMass,
    Bend,
    BendTwist,
    Body,
    Contact,
    DistributedLoad,
    Drag,
    Element,
    Inertia,
    Stretch,
    TipLoad,
    Weight,
)
from crinoid.flow import Water
from crinoid.onset import Onset
from crinoid.programs import ONCE, compiled
from crinoid.rod import Rod
from crinoid.scenario import Arm, Load, Scenario
from crinoid.scenario import motion as motions
from crinoid.scenario.load import TipLoad as TipTable
from crinoid.space import CHANNELS
from crinoid.spline import PiecewisePolynomial, between, shape_preserving

if TYPE_CHECKING:
    from crinoid.recording import Recording, Series  # xarray, slow to load

_LoadElement = DistributedLoad | TipLoad
_INTEGRATORS: dict[str, Callable[..., Integrator]] = {
    "newmark": Integrator.newmark,
    "generalized-alpha": Integrator.generalized_alpha,
    "implicit-euler": Integrator.implicit_euler,
}


def build_system(
    scenario: Scenario, recordings: Mapping[int, Recording], series: Mapping[str, Series]
) -> System:
    """Assemble the arm, its base and the water of a scenario."""
    simulation, water = scenario.simulation, scenario.water
    rod, elements, settings, contact, bodies = _assemble(
        scenario.arm.nodes,
        scenario.arm.dimension,
        _rod(scenario.arm),
        scenario.base.mount == "pinned",
        {
            name: array(getattr(water, name))
            for name in (
                "density",
                "gravity",
                "drag_normal",
                "drag_tangential",
                "linear_drag",
                "added_mass_normal",
                "added_mass_tangential",
            )
        },
        tuple(_load(load, scenario) for load in scenario.load),
        contact_numbers(scenario),
        body_numbers(scenario),
        array(simulation.tolerance),
        jax.device_put(np.asarray(simulation.max_iterations)),
    )
    return System(
        reference=rod.reference,
        forces=Forces(
            elements,
            Water(
                tuple(
                    build_flow(scenario, index, flow, recordings.get(index))
                    for index, flow in enumerate(scenario.flow)
                )
            ),
            array(scenario.base.position),
            build_obstacles(scenario, contact, bodies),
        ),
        base=_base(scenario, rod, series),
        integrator=_INTEGRATORS[simulation.integrator](**simulation.integrator_options),
        settings=settings,
        time_step=array(simulation.time_step),
        max_error=array((simulation.error or np.inf) * scenario.arm.length),
        max_halvings=simulation.max_halvings,
    )


@compiled(**ONCE)  # one small program instead of many, and none of its own for each value
def _assemble(
    nodes: int,
    axes: int,
    sections: Numbers,
    pinned: bool,
    water: Numbers,
    loads: tuple[tuple[type[_LoadElement], Numbers], ...],
    contact: Numbers | None,
    bodies: Numbers | None,
    tolerance: Array,
    max_iterations: Array,
) -> tuple[Rod, tuple[Element, ...], Settings, Contact | None, Body | None]:
    rod = Rod.round(nodes=nodes, axes=axes, **sections)
    density = water["density"]
    elements = (
        Stretch.of(rod),
        (Bend if axes == 2 else BendTwist).of(rod, pinned=pinned),
        Inertia.of(rod),
        Weight.of(rod, density=density, gravity=water["gravity"]),
        Drag.of(
            rod,
            density=density,
            normal=water["drag_normal"],
            tangential=water["drag_tangential"],
            linear=water["linear_drag"],
        ),
        AddedMass.of(
            rod,
            density=density,
            normal=water["added_mass_normal"],
            tangential=water["added_mass_tangential"],
        ),
        *(kind.of(rod, **numbers) for kind, numbers in loads),
    )
    return (
        rod,
        elements,
        Settings.for_rod(rod, tolerance, max_iterations),
        None if contact is None else Contact.of(rod, **contact),
        None if bodies is None else Body.of(**bodies, density=density, gravity=water["gravity"]),
    )


def _rod(arm: Arm) -> Numbers:
    made_of = ("length", "radius", "density", "youngs_modulus", "poisson_ratio", "damping_time")
    numbers = {name: getattr(arm, name) for name in (*made_of, "rest_curvature")}
    numbers |= dict(arm.section)
    return {name: array(number) for name, number in numbers.items() if number is not None}


def _load(load: Load, scenario: Scenario) -> tuple[type[_LoadElement], Numbers]:
    stop = np.inf if load.stop is None else load.stop
    onset = {"onset": Onset(*map(array, (load.start, load.ramp_time, stop)))}
    if isinstance(load, TipTable):
        force, moment = array(load.force), array(load.moment)
        if load.follower:
            return TipLoad, onset | {"follower_force": force, "follower_moment": moment}
        return TipLoad, onset | {"dead_force": force, "moment": moment}
    fixed = np.zeros(scenario.arm.dimension)
    if not isinstance(load.direction, str):
        fixed = np.asarray(load.direction) / np.linalg.norm(load.direction)
    return DistributedLoad, onset | {
        "tangential": array(load.magnitude * (load.direction == "tangential")),
        "normal": array(load.magnitude * (load.direction == "normal")),
        "fixed": array(load.magnitude * fixed),
    }


def _base(scenario: Scenario, rod: Rod, series: Mapping[str, Series]) -> Base:
    # a channel that nobody drives has no room to move and any limits
    axes, duration = scenario.arm.dimension, scenario.simulation.duration
    channels = CHANNELS[axes]
    lower, upper, speed, acceleration, bandwidth = np.array(
        [[number] * len(channels) for number in (0.0, 0.0, 1.0, 1.0, 1.0)]
    )
    for name, channel in scenario.base.channels.present.items():
        index = channels.index(name)
        limits = channel.limits
        lower[index], upper[index] = limits.low, limits.high
        speed[index], acceleration[index] = limits.speed, limits.acceleration
        bandwidth[index] = limits.bandwidth_hz
    return Base(
        angles=array(scenario.base.angles if axes == 3 else [np.deg2rad(scenario.base.tilt_deg)]),
        ghost_length=array(np.asarray(rod.rest_length)[0]),
        servo=Servo(*map(array, (lower, upper, speed, acceleration, bandwidth))),
        motions=tuple(
            _motion(motion, channels, series.get(f"base.motion.{index}"), duration)
            for index, motion in enumerate(scenario.base.motion)
        ),
    )


def _motion(
    motion: motions.Motion, channels: tuple[str, ...], series: Series | None, duration: float
) -> BaseMotion:
    channel = channels.index(motion.channel)
    if isinstance(motion, motions.SineMotion):
        return SineMotion(
            channel,
            array(motion.amplitude_si),
            array(motion.frequency_hz),
            array(np.deg2rad(motion.phase_deg)),
        )
    if isinstance(motion, motions.VelocityMotion):
        onset = Onset(*map(array, (motion.start, motion.ramp_time, np.inf)))
        return VelocityMotion(channel, onset, array(motion.velocity_si))
    if series is not None:
        times, values = series.time, series.values[:, 0]
    else:
        assert isinstance(motion, motions.TableMotion)
        times, values = np.asarray(motion.time), np.asarray(motion.value_si)
    if motion.interpolation == "monotone":
        curve = shape_preserving(times, values)
    else:
        from scipy.interpolate import CubicSpline  # slow to load, and few scenarios need it

        curve = CubicSpline(times, values)
    if series is not None:
        curve = between(curve, 0.0, duration)  # of a long record
    return TableMotion(channel, PiecewisePolynomial(curve))
