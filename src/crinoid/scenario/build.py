"""From the description of an arm to the arrays that move it. All units become SI and radians."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from crinoid.base import CHANNELS, Base, BaseMotion, Servo, SineMotion, TableMotion
from crinoid.dynamics import Forces, Integrator, Obstacles, Settings, System
from crinoid.elements import (
    AddedMass,
    Bend,
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
from crinoid.flow import (
    Flow,
    GaussMarkov,
    Gust,
    LogarithmicShear,
    PowerShear,
    Sine,
    Turbulence,
    Uniform,
    Water,
    Waves,
)
from crinoid.onset import Onset
from crinoid.rod import Rod
from crinoid.scenario import flow as flows
from crinoid.scenario import motion as motions
from crinoid.scenario.load import DistributedLoad as DistributedTable
from crinoid.scenario.load import TipLoad as TipTable
from crinoid.scenario.obstacle import Sphere
from crinoid.spline import PiecewiseCubic

if TYPE_CHECKING:
    from crinoid.scenario.arm import Arm
    from crinoid.scenario.scenario import Scenario

_INTEGRATORS: dict[str, Callable[..., Integrator]] = {
    "newmark": Integrator.newmark,
    "generalized-alpha": Integrator.generalized_alpha,
    "implicit-euler": Integrator.implicit_euler,
}


def build_system(scenario: Scenario) -> System:
    """Assemble the arm, its base and the water of a scenario."""
    simulation, water = scenario.simulation, scenario.water
    rod, elements, settings, contact, bodies = _assemble(
        scenario.arm.nodes,
        _rod(scenario.arm),
        scenario.base.mount == "pinned",
        {
            name: _array(getattr(water, name))
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
        tuple(_load(load) for load in scenario.load),
        _contact(scenario),
        _bodies(scenario),
        _array(simulation.tolerance),
        jnp.asarray(simulation.max_iterations),
    )
    return System(
        rod=rod,
        forces=Forces(
            elements,
            Water(tuple(_flow(scenario, *numbered) for numbered in enumerate(scenario.flow))),
            _array(scenario.base.position),
            _obstacles(scenario, contact, bodies),
        ),
        base=_base(scenario, rod),
        integrator=_INTEGRATORS[simulation.integrator](**simulation.integrator_options),
        settings=settings,
        time_step=_array(simulation.time_step),
        max_halvings=simulation.max_halvings,
    )


def _array(value: object) -> Array:
    return jnp.asarray(np.asarray(value, float))


Numbers = dict[str, Any]


@eqx.filter_jit  # one small program instead of many, and none of its own for each value
def _assemble(
    nodes: int,
    sections: Numbers,
    pinned: bool,
    water: Numbers,
    loads: tuple[tuple[type[DistributedLoad | TipLoad], Numbers], ...],
    contact: Numbers | None,
    bodies: Numbers | None,
    tolerance: Array,
    max_iterations: Array,
) -> tuple[Rod, tuple[Element, ...], Settings, Contact | None, Body | None]:
    rod = Rod.round(nodes=nodes, **sections)
    density = water["density"]
    elements = (
        Stretch.of(rod),
        Bend.of(rod, pinned=pinned),
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
    numbers = {
        "radius": arm.radii,
        **{
            name: getattr(arm, name)
            for name in ("length", "density", "youngs_modulus", "rest_curvature", "damping_time")
        },
        **{
            name: getattr(arm.section, name)
            for name in ("EA", "EI", "mass_per_length", "diameter", "displaced_area")
        },
    }
    return {name: _array(number) for name, number in numbers.items() if number is not None}


def _load(
    load: DistributedTable | TipTable,
) -> tuple[type[DistributedLoad | TipLoad], Numbers]:
    stop = np.inf if load.stop is None else load.stop
    onset = {"onset": Onset(*map(_array, (load.start, load.ramp_time, stop)))}
    if isinstance(load, TipTable):
        force = np.asarray(load.force)
        return TipLoad, onset | {
            "dead_force": _array(0 * force if load.follower else force),
            "follower_force": _array(force if load.follower else 0 * force),
            "moment": _array(load.moment),
        }
    fixed = np.zeros(2)
    if not isinstance(load.direction, str):
        fixed = np.asarray(load.direction) / np.hypot(*load.direction)
    return DistributedLoad, onset | {
        "tangential": _array(load.magnitude * (load.direction == "tangential")),
        "normal": _array(load.magnitude * (load.direction == "normal")),
        "fixed": _array(load.magnitude * fixed),
    }


def _flow(scenario: Scenario, index: int, flow: flows.Flow) -> Flow:
    onset = Onset(*map(_array, (flow.start, flow.ramp_time, np.inf)))
    # two random flows of one scenario are not the same
    seed = np.random.SeedSequence(scenario.seed, spawn_key=(index,))
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
        case flows.GaussMarkovFlow():
            return GaussMarkov.of(
                onset,
                mean=np.array(flow.mean),
                standard_deviation=np.array(flow.standard_deviation),
                correlation_time=flow.correlation_time,
                duration=scenario.simulation.duration,
                generator=np.random.default_rng(seed),
            )
        case flows.TurbulenceFlow():
            return Turbulence.of(
                onset,
                mean=np.array(flow.mean),
                intensity=flow.intensity,
                length_scale=flow.length_scale,
                modes=flow.modes,
                generator=np.random.default_rng(seed),
            )
        case flows.WavesFlow():
            depth = scenario.water.depth
            assert depth is not None  # likewise
            return Waves.of(
                onset,
                significant_height=flow.significant_height,
                peak_period=flow.peak_period,
                heading=np.cos([np.deg2rad(flow.direction_deg)]),
                gamma=flow.gamma,
                components=flow.components,
                depth=depth,
                gravity=scenario.water.gravity,
                generator=np.random.default_rng(seed),
            )
        case flows.MeasuredFlow():
            from crinoid.scenario.build_measured import measured  # xarray, which few need

            recording = scenario.recordings[index]
            return measured(onset, recording, scenario)


def _contact(scenario: Scenario) -> Numbers | None:
    obstacles = scenario.obstacle
    if not obstacles:
        return None
    return {
        "radius": _array([getattr(o, "radius", 0.0) for o in obstacles]),
        "half_axis": _array([o.half_axis for o in obstacles]),
        "normal": _array([o.out for o in obstacles]),
        "friction": _array([o.friction for o in obstacles]),
        "mass": _array([getattr(o, "mass", None) or np.inf for o in obstacles]),
    }


def _bodies(scenario: Scenario) -> Numbers | None:
    if not scenario.obstacle:
        return None
    free = [scenario.obstacle[index] for index in _free(scenario)]
    return {
        "mass": _array([getattr(body, "mass", None) for body in free]),
        "radius": _array([getattr(body, "radius", None) for body in free]),
    }


def _free(scenario: Scenario) -> tuple[int, ...]:
    """Return which obstacles the arm can push away."""
    return tuple(
        index
        for index, obstacle in enumerate(scenario.obstacle)
        if isinstance(obstacle, Sphere) and obstacle.mass is not None
    )


def _obstacles(
    scenario: Scenario, contact: Contact | None, bodies: Body | None
) -> Obstacles | None:
    if contact is None or bodies is None:
        return None
    drifts = [obstacle.velocity for obstacle in scenario.obstacle]
    return Obstacles(
        contact=contact,
        bodies=bodies,
        place=_array([o.position for o in scenario.obstacle]) - _array(scenario.base.position),
        drift=_array([(0.0, 0.0) if drift == "flow" else drift for drift in drifts]),
        free=_free(scenario),
        carried=tuple(index for index, drift in enumerate(drifts) if drift == "flow"),
    )


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
        ghost_length=_array(np.asarray(rod.rest_length)[0]),
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
    from scipy.interpolate import CubicSpline  # slow to load, and few scenarios need it

    return TableMotion(channel, PiecewiseCubic(CubicSpline(motion.time, motion.value_si)))
