"""Base, vehicle, tool and obstacles: their numbers, and the arrays that follow from these."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from typing import TYPE_CHECKING

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from crinoid.assembly.arrays import array, from_table
from crinoid.base import Base, BaseMotion, Servo, SineMotion, TableMotion, VelocityMotion
from crinoid.dynamics import (
    FarEdges,
    FreeBodies,
    GripTriggers,
    Hull,
    Obstacles,
    Thrusters,
    Vehicle,
    far_edges,
    first_far_edge,
)
from crinoid.elements import (
    Bed,
    Body,
    BodyContact,
    Contact,
    HullContact,
    Pair,
    Pose,
    SignedDistance,
    Surface,
    Tool,
)
from crinoid.elements.bodies import capsule_inertia
from crinoid.elements.contact import surfaces
from crinoid.foundation.axes import CHANNEL_TABLE, CHANNELS
from crinoid.numerics.grid_spline import GridSpline
from crinoid.numerics.piecewise import PiecewisePolynomial, between, shape_preserving
from crinoid.numerics.ramp import Onset
from crinoid.rod import Rod
from crinoid.scenario import Capsule, Mistake, Obstacle, Plane, Scenario, ScenarioError, Sphere, got
from crinoid.scenario import Tool as ToolTable
from crinoid.scenario import Vehicle as VehicleTable
from crinoid.scenario import base as motions
from crinoid.scenario.quantity import unit_vector

if TYPE_CHECKING:
    from scipy.interpolate import PPoly

    from crinoid.recording import Series, SolidSurface


class BaseParameters(eqx.Module):
    """The numbers of ``[base]``, its channels and its prescribed motion."""

    position: Float[Array, " d"]
    angles: Float[Array, " angle"]
    """``tilt_deg``, in space ``pan_deg``, ``tilt_deg`` and ``roll_deg`` (rad)."""
    servo: Servo
    """Limits and bandwidths, one a channel."""
    motion: tuple[BaseMotion, ...]
    mount: str = eqx.field(static=True)

    @staticmethod
    def of(scenario: Scenario, series: Mapping[str, Series]) -> BaseParameters:
        """Return the numbers of a scenario's base; ``series`` by table, from its files."""
        base, axes = scenario.base, scenario.arm.dimension
        return BaseParameters(
            position=array(base.position),
            angles=array(base.angles if axes == 3 else [np.deg2rad(base.tilt_deg)]),
            servo=_servo(scenario),
            motion=tuple(
                each
                for index, motion in enumerate(base.motion)
                for each in _motions(motion, scenario, series.get(f"base.motion.{index}"))
            ),
            mount=base.mount,
        )


def _servo(scenario: Scenario) -> Servo:
    # a channel that nobody drives has no room to move and any limits
    channels = CHANNELS[scenario.arm.dimension]
    lower, upper, speed, acceleration, bandwidth = np.array(
        [[number] * len(channels) for number in (0.0, 0.0, 1.0, 1.0, 1.0)]
    )
    for name, channel in scenario.base.channels.present.items():
        index = channels.index(name)
        limits = channel.limits
        lower[index], upper[index] = limits.low, limits.high
        speed[index], acceleration[index] = limits.speed, limits.acceleration
        bandwidth[index] = limits.bandwidth_hz
    return Servo(*map(array, (lower, upper, speed, acceleration, bandwidth)))


def _motions(
    motion: motions.Motion, scenario: Scenario, series: Series | None
) -> Iterator[BaseMotion]:
    axes, duration = scenario.arm.dimension, scenario.simulation.duration
    if isinstance(motion, motions.VesselMotion):
        assert series is not None
        for index, values in enumerate(series.values.T):
            curve = _curve(series.time, values, motion.interpolation)
            yield TableMotion(index, PiecewisePolynomial(between(curve, 0.0, duration)))
        return
    channel = CHANNELS[axes].index(motion.channel)
    match motion:
        case motions.SineMotion():
            phase = array(np.deg2rad(motion.phase_deg))
            yield SineMotion(channel, array(motion.amplitude_si), array(motion.frequency_hz), phase)
        case motions.VelocityMotion():
            onset = Onset(*map(array, (motion.start, motion.ramp_time, np.inf)))
            yield VelocityMotion(channel, onset, array(motion.velocity_si))
        case motions.TableMotion():
            time, value = np.asarray(motion.time), np.asarray(motion.value_si)
            yield TableMotion(
                channel, PiecewisePolynomial(_curve(time, value, motion.interpolation))
            )
        case motions.FileMotion():
            assert series is not None
            curve = _curve(series.time, series.values[:, 0], motion.interpolation)
            # of a long record
            yield TableMotion(channel, PiecewisePolynomial(between(curve, 0.0, duration)))


def _curve(
    time: Float[np.ndarray, " point"], value: Float[np.ndarray, " point"], interpolation: str
) -> PPoly:
    if interpolation == "monotone":
        return shape_preserving(time, value)
    from scipy.interpolate import CubicSpline  # slow to load, and few scenarios need it

    return CubicSpline(time, value)


_ROUNDED = 1e-9
"""Share of the arm's length that is round-off."""


class ObstacleParameters(eqx.Module):
    """The numbers of all ``[[obstacle]]``; of a shape that lacks one it is without effect."""

    position: Float[Array, "m d"]
    """Where each one is at t = 0, in the world (m)."""
    velocity: Float[Array, "m d"]
    """Drift of each one; 0 of one that the flow carries (m/s)."""
    radius: Float[Array, " m"]
    half_axis: Float[Array, "m d"]
    normal: Float[Array, "m d"]
    friction: Float[Array, " m"]
    mass: Float[Array, " m"]
    """Infinite for one that the arm cannot push away (kg)."""
    length: Float[Array, " m"]
    """Distance of the middles of a capsule's ends (m)."""
    inertia: Float[Array, "m turns turns"]
    """Moments of inertia at the start, about the axes of the world (kg m2)."""
    spin: Float[Array, "m turns"]
    """Angular velocity at the start (rad/s)."""
    surfaces: tuple[Surface | None, ...]
    """Surfaces of meshes and beds, None of others; empty without any."""
    metacentric_height: Float[Array, " m"]
    """Height of the centre of buoyancy above that of mass at the start (m)."""
    free: tuple[int, ...] = eqx.field(static=True)
    carried: tuple[int, ...] = eqx.field(static=True)
    pairs: tuple[Pair, ...] = eqx.field(static=True)
    """Free obstacles with the obstacles that they can touch."""

    @staticmethod
    def of(scenario: Scenario, read: Mapping[str, SolidSurface]) -> ObstacleParameters:
        """Return the numbers of obstacles, one or more; ``read`` has their surfaces, by table."""
        obstacles, arm = scenario.obstacle, scenario.arm
        found = [read.get(f"obstacle.{index}") for index in range(len(obstacles))]
        edge = arm.length / (arm.nodes - 1)
        still = np.zeros(len(obstacles[0].position))
        drifts = [obstacle.velocity for obstacle in obstacles]
        turns = 1 if still.size == 2 else 3
        free = tuple(index for index, obstacle in enumerate(obstacles) if obstacle.free)
        return ObstacleParameters(
            position=array([o.position for o in obstacles]),
            velocity=array([still if drift == "flow" else drift for drift in drifts]),
            radius=array([getattr(o, "radius", 0.0) for o in obstacles]),
            half_axis=array([o.half_axis for o in obstacles]),
            normal=array([o.out for o in obstacles]),
            friction=array([o.friction for o in obstacles]),
            mass=array([getattr(o, "mass", None) or np.inf for o in obstacles]),
            length=array([getattr(o, "length", 0.0) for o in obstacles]),
            inertia=array([_inertia(o, turns) for o in obstacles]),
            spin=array([np.broadcast_to(getattr(o, "spin", 0.0), turns) for o in obstacles]),
            surfaces=tuple(each and _surface(each, edge) for each in found) if any(found) else (),
            metacentric_height=array([getattr(o, "metacentric_height", 0.0) for o in obstacles]),
            free=free,
            carried=tuple(index for index, drift in enumerate(drifts) if drift == "flow"),
            pairs=_pairs(obstacles, free),
        )

    def obstacles(
        self, rod: Rod, origin: Float[Array, " d"], density: Array, gravity: Array
    ) -> Obstacles:
        """Build the obstacles near a rod whose root is set at ``origin`` (m); traceable."""
        return Obstacles(
            contact=Contact.of(
                rod,
                radius=self.radius,
                half_axis=self.half_axis,
                normal=self.normal,
                friction=self.friction,
                mass=self.mass,
            ),
            bodies=self._bodies(rod, density, gravity) if self.free else None,
            position=self.position - origin,
            drift=self.velocity,
            carried=self.carried,
            surfaces=self.surfaces,
        )

    def _bodies(self, rod: Rod, density: Array, gravity: Array) -> FreeBodies:
        """Build the free bodies among the obstacles."""
        count, axes = self.position.shape
        at = np.asarray(self.free, int)
        contact = None
        if self.pairs:
            contact = BodyContact.between(
                self.pairs,
                radius=self.radius,
                half_axis=self.half_axis,
                normal=self.normal,
                friction=self.friction,
                mass=self.mass,
                strength=jnp.max(surfaces(rod)[1]),
                gravity=gravity,
            )
        return FreeBodies(
            index=self.free,
            body=Body.of(
                mass=self.mass[at],
                radius=self.radius[at],
                inertia=self.inertia[at],
                half_axis=self.half_axis[at],
                length=self.length[at],
                metacentric_height=self.metacentric_height[at],
                density=density,
                gravity=gravity,
            ),
            pose=Pose.unturned(count, axes),
            spin=self.spin,
            contact=contact,
            pairs=tuple((pair.first, pair.second) for pair in self.pairs),
        )


def _inertia(obstacle: Obstacle, turns: int) -> Float[np.ndarray, "turns turns"]:
    """Return the inertia of a free obstacle, by default that of a homogeneous solid (kg m2)."""
    moments = np.zeros((3, 3))
    if isinstance(obstacle, Sphere | Capsule) and obstacle.mass is not None:
        if obstacle.inertia is not None:
            moments = np.diag(np.broadcast_to(obstacle.inertia, 3))
        else:
            length = obstacle.length if isinstance(obstacle, Capsule) else 0.0
            axis = unit_vector(obstacle.axis) if isinstance(obstacle, Capsule) else (1.0, 0.0, 0.0)
            along, across = capsule_inertia(obstacle.mass, obstacle.radius, length)
            moments = across * np.eye(3) + (along - across) * np.outer(axis, axis)
    return moments if turns == 3 else moments[1:2, 1:2]


def _pairs(obstacles: Sequence[Obstacle], free: tuple[int, ...]) -> tuple[Pair, ...]:
    """Return the pairs of obstacles that can touch, of which one or both are free.

    First is a sphere where one is, and never a plane, so that points of contact are few: two of a
    capsule on a plane or another long body, otherwise one.
    """
    found: list[Pair] = []
    for one, other in combinations(range(len(obstacles)), 2):
        if one not in free and other not in free:
            continue
        first, second = one, other
        long = [any(obstacles[index].half_axis) for index in (one, other)]
        if long[0] != long[1]:
            first, second = (one, other) if long[1] else (other, one)
        elif one not in free:
            first, second = other, one
        if isinstance(obstacles[first], Plane):
            first, second = second, first
        ends = (1.0, -1.0) if any(obstacles[first].half_axis) else (0.0,)
        found += [Pair(first, second, end) for end in ends]
    return tuple(found)


def _surface(read: SolidSurface, edge: float) -> Surface:
    """Return a surface in contact with edges of a length (m)."""
    spline = GridSpline(*map(array, vars(read.spline).values()))
    # two points in each cell that an edge crosses
    samples = int(np.clip(2 * np.ceil(edge / read.spline.spacing.min()) + 1, 5, _MOST_SAMPLES))
    if read.heights:
        return Bed(height=spline, samples=samples)
    return SignedDistance(spline=spline, samples=samples)


_MOST_SAMPLES = 33
"""Largest number of points on an edge among which the search for the nearest one begins."""


class SelfContactParameters(eqx.Module):
    """The numbers of ``[contact]``."""

    friction: Float[Array, ""]
    beyond: tuple[int, ...] = eqx.field(static=True)
    """First edge ahead of each edge that it can touch."""

    @staticmethod
    def of(scenario: Scenario) -> SelfContactParameters | None:
        """Return the numbers of an arm that can touch itself."""
        if not scenario.contact.self_:
            return None
        beyond = far_edges(*_edges(scenario))
        if min(beyond) == scenario.arm.nodes - 1:
            if scenario.hull is not None:
                return None
            hint = "The arm is too short for its radius to turn back and touch itself."
            raise ScenarioError([Mistake("contact.self", got(True, "be false", hint))])
        return SelfContactParameters(array(scenario.contact.friction), beyond)

    def far_edges(self, rod: Rod) -> FarEdges:
        """Build the contact of a rod with itself; traceable."""
        return FarEdges.of(rod, self.beyond, self.friction)


def _edges(scenario: Scenario) -> tuple[Float[np.ndarray, " e"], Float[np.ndarray, " e"]]:
    """Return lengths and radii of the edges of an arm (m)."""
    arm, diameters = scenario.arm, np.asarray(scenario.arm.diameters)
    edges = arm.nodes - 1
    return np.full(edges, arm.length / edges), (diameters[1:] + diameters[:-1]) / 4


class HullParameters(eqx.Module):
    """The numbers of ``[vehicle] hull``."""

    length: Float[Array, ""]
    diameter: Float[Array, ""]
    friction: Float[Array, ""]
    first_edge: int = eqx.field(static=True)
    """First edge of the arm that can touch it."""

    @staticmethod
    def of(scenario: Scenario) -> HullParameters | None:
        """Return the numbers of a hull that the arm can touch."""
        if scenario.hull is None:
            return None
        first = first_far_edge(*_edges(scenario), _retraction(scenario))
        if first == scenario.arm.nodes - 1:
            must = "be left out for an arm too short to turn back to it"
            raise ScenarioError([Mistake("vehicle.hull", got(scenario.hull, must))])
        friction = array(scenario.contact.friction)
        return from_table(HullParameters, scenario.hull, friction=friction, first_edge=first)

    def hull(self, rod: Rod, base: Base, vehicle: Vehicle | None) -> Hull:
        """Build the hull behind the root of a rod; traceable."""
        contact = HullContact.of(
            rod,
            self.first_edge,
            length=self.length,
            diameter=self.diameter,
            friction=self.friction,
            mass=jnp.asarray(jnp.inf) if vehicle is None else vehicle.mass,
        )
        if vehicle is None:
            return Hull(contact, self.first_edge)
        axis = base.hold(jnp.zeros_like(base.servo.lower)) - vehicle.offset
        return Hull(contact, self.first_edge, axis, jnp.eye(rod.axes))


def _retraction(scenario: Scenario) -> float:
    """Return how far the channels draw the root back into a hull that floats (m)."""
    if not scenario.floats:
        return 0.0
    base = scenario.base
    pan, tilt = np.deg2rad(base.pan_deg), np.deg2rad(base.tilt_deg)
    level = np.cos(tilt)
    ahead = {"x": level * np.cos(pan), "y": level * np.sin(pan), "z": np.sin(tilt)}
    back = 0.0
    for channel in CHANNEL_TABLE:
        found = base.channels.present.get(channel.name)
        if found is not None and not channel.turns:
            limits = found.limits
            forward = ahead[channel.axis]
            back += max(0.0, -limits.low * forward, -limits.high * forward)
    return back


def edges_within(span: tuple[float, float], nodes: int) -> Bool[Array, " edge"]:
    """Return which edges of an arm overlap a part of it, given as shares of its length."""
    ends = np.arange(nodes) / (nodes - 1)
    return jax.device_put((ends[1:] > span[0] + _ROUNDED) & (ends[:-1] < span[1] - _ROUNDED))


class ToolParameters(eqx.Module):
    """The numbers of ``[tool]``."""

    mass: Float[Array, ""]
    volume: Float[Array, ""]
    drag_area: Float[Array, ""]
    added_mass: Float[Array, ""]
    inertia: Float[Array, ...]
    """One number, or in space three (kg m2)."""
    offset: Float[Array, ""]
    held: Onset
    """From when on and until when it is held; infinite if for good (s). Where touches decide, the
    times between which they count."""
    touched: Bool[Array, " edge"] | None
    """Which edges take it up, or let it go, at a touch; None where times decide."""
    take: int | None = eqx.field(static=True)
    """The obstacle at whose touch it is taken up."""
    drop: int | None = eqx.field(static=True)
    """The obstacle at whose touch it is let go."""

    @staticmethod
    def of(tool: ToolTable, nodes: int) -> ToolParameters:
        """Return the numbers of the tool of an arm."""
        until = np.inf if tool.until is None else tool.until
        return from_table(
            ToolParameters,
            tool,
            held=Onset(*map(array, (tool.from_, 0.0, until))),
            touched=edges_within(tool.touched, nodes) if tool.touches else None,
            take=tool.take_at_touch,
            drop=tool.drop_at_touch,
        )

    def grasp(self) -> GripTriggers | None:
        """Return the touches that decide when it is held, if any do."""
        if self.touched is None:
            return None
        return GripTriggers(self.take, self.drop, self.touched, self.held)

    def element(self, rod: Rod, density: Array, gravity: Array) -> Tool:
        """Build the tool at the tip of a rod in water of a density (kg/m3); traceable."""
        # not there before a touch: a window without length
        stop = self.held.stop if self.take is None else self.held.start
        numbers = vars(self) | {"held": replace(self.held, stop=stop)}
        for key in ("touched", "take", "drop"):
            del numbers[key]
        return Tool.of(rod, density=density, gravity=gravity, **numbers)


class VehicleParameters(eqx.Module):
    """The numbers of ``[vehicle]``; what has a value per axis may be one number for all."""

    mass: Float[Array, ""]
    inertia: Float[Array, ...]
    offset: Float[Array, " d"]
    volume: Float[Array, ""] | None
    """None: as much as carries it (m3)."""
    metacentric_height: Float[Array, ""]
    added_mass: Float[Array, ...]
    added_inertia: Float[Array, ...]
    drag_area: Float[Array, ...]
    angular_drag: Float[Array, ...]
    linear_drag: Float[Array, ...] | None
    """None: no drag in proportion to the speed."""
    angular_linear_drag: Float[Array, ...] | None
    bandwidth: Float[Array, ""]
    """Natural frequency at which thrusters hold it; 0 if there are none (Hz)."""
    max_force: Float[Array, ""]
    """Infinite where there is no limit (N)."""
    max_moment: Float[Array, ""]
    """Infinite where there is no limit (N m)."""

    @staticmethod
    def of(vehicle: VehicleTable) -> VehicleParameters:
        """Return the numbers of a vehicle."""
        held = vehicle.hold == "thrusters"
        linear = {
            name: array(getattr(vehicle, name)) if np.any(getattr(vehicle, name)) else None
            for name in ("linear_drag", "angular_linear_drag")
        }
        return from_table(
            VehicleParameters,
            vehicle,
            bandwidth=array(vehicle.bandwidth_hz if held else 0.0),
            max_force=array(vehicle.max_force or np.inf),
            max_moment=array(vehicle.max_moment or np.inf),
            **linear,
        )

    def vehicle(self, density: Array, gravity: Array) -> Vehicle:
        """Build the vehicle in water of a density (kg/m3); traceable."""
        axes = self.offset.size
        turns = 1 if axes == 2 else 3
        added_mass, drag_area = (
            jnp.broadcast_to(values, (axes,)) for values in (self.added_mass, self.drag_area)
        )
        inertia, added_inertia, angular_drag = (
            jnp.broadcast_to(values, (turns,))
            for values in (self.inertia, self.added_inertia, self.angular_drag)
        )
        linear, angular_linear = self.linear_drag, self.angular_linear_drag
        moved, turned = self.mass + added_mass, inertia + added_inertia
        rate = 2 * jnp.pi * self.bandwidth
        if self.volume is None:
            displaced = jnp.where(density > 0, self.mass, 0.0)
        else:
            displaced = density * self.volume
        return Vehicle(
            mass=self.mass,
            inertia=inertia,
            displaced=displaced,
            added_mass=added_mass,
            added_inertia=added_inertia,
            drag=0.5 * density * drag_area,
            angular_drag=angular_drag,
            metacentric_height=self.metacentric_height,
            gravity=gravity,
            offset=self.offset,
            thrusters=Thrusters(
                stiffness=rate**2 * moved,
                damping=2 * rate * moved,
                turn_stiffness=rate**2 * turned,
                turn_damping=2 * rate * turned,
                max_force=self.max_force,
                max_moment=self.max_moment,
            ),
            linear_drag=None if linear is None else jnp.broadcast_to(linear, (axes,)),
            angular_linear_drag=None
            if angular_linear is None
            else jnp.broadcast_to(angular_linear, (turns,)),
        )
