"""Interactive bodies, a target that can be dragged, and the scenario with them."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from itertools import product
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from crinoid.assembly.arrays import array
from crinoid.assembly.parameters import Parameters
from crinoid.assembly.prepared import Prepared
from crinoid.compilation import ONCE, compiled
from crinoid.control import Pid
from crinoid.control.target import Pose, Target, Time
from crinoid.dynamics import ActingForces, State, System
from crinoid.flow import Flow, on_currents
from crinoid.recording import SolidSurface
from crinoid.scenario import Obstacle, Plane, Scenario, ScenarioError
from crinoid.scenario.arm import Arm
from crinoid.simulation.conclusion import start_failure
from crinoid.simulation.loop import Loop
from crinoid.simulation.setup import Setup, set_up
from crinoid.studies.comparison import controlled_by
from crinoid.view.live.adjustable import AdjustableNumbers, LoopNumbers, adjusted_flows

_LONGEST = 3600.0  # simulated time of a session (s)
_RADIUS = 0.08  # radius of the debris, over the arm's length
_FROM = 0.45  # distance that it is thrown from, over the arm's length
_SPEED = 1.3  # speed relative to the current, over the arm's length (1/s)
_AIM = 0.7  # arc length that it is aimed at, over the arm's length
_PARKED = 40.0  # distance from the root at which it is parked, over the arm's length
_DEFLECTION = 0.3  # deflection of a straight arm by a pull in the long run, over its length
_STILL = 1e-3  # speed of the water below which its direction is ignored (m/s)
_FLIGHT = 0.45  # time of flight (s)
_LED = 0.3  # largest distance that it is aimed in front of a moving arm, over the arm's length

Vector = Float[np.ndarray, " d"]


class Debris(NamedTuple):
    """A neutrally buoyant sphere to throw at the arm."""

    radius: float
    mass: float
    parked: tuple[float, ...]  # place in the world at which it is parked (m)

    def table(self, position: Any, velocity: Any) -> dict[str, Any]:
        """Return it as a table of a scenario."""
        motion = {"position": list(map(float, position)), "velocity": list(map(float, velocity))}
        return {"kind": "sphere", "radius": self.radius, "mass": self.mass} | motion


class InteractiveBodies(NamedTuple):
    """A load of zero at the tip and debris far away, which are added to a scenario."""

    debris: Debris | None  # None where nothing can be hit, or no place is free
    duration: float
    """Longest simulated time (s): an hour, or that of files and tables of the scenario."""

    @staticmethod
    def suited_to(scenario: Scenario, surfaces: Mapping[str, SolidSurface]) -> InteractiveBodies:
        """Return the interactive bodies of a scenario with surfaces from files, by table."""
        length = scenario.arm.length
        radius = max(_RADIUS * length, max(scenario.arm.diameters) / 2)
        base = np.array(scenario.base.position)
        far = _PARKED * length * np.eye(base.size)
        read = [surfaces.get(f"obstacle.{index}") for index in range(len(scenario.obstacle))]
        solids = list(zip(scenario.obstacle, read, strict=True))
        mass = (scenario.water.density or 1000.0) * 4 / 3 * np.pi * radius**3
        debris = [
            Debris(radius, mass, tuple(map(float, place)))
            for place in (base - far[0], base + far[0], base + far[-1], base - far[-1])
            if all(_apart(place, *solid) > radius + length for solid in solids)
        ]
        own = scenario.simulation.duration  # a table or a file may end soon after it
        for duration, body in product((max(_LONGEST, own), own), (*debris[:1], None)):
            found = InteractiveBodies(body, duration)
            with suppress(ScenarioError):
                found.added_to(scenario)
                break
        return found

    def added_to(self, scenario: Scenario) -> Scenario:
        """Return a scenario with them."""
        document, still = scenario.to_dict(), [0.0] * scenario.arm.dimension
        loads = [*document.get("load", []), {"kind": "tip", "force": still}]
        values: dict[str, Any] = {"load": loads, "simulation.duration": self.duration}
        if self.debris is not None:
            table = self.debris.table(self.debris.parked, still)
            values["obstacle"] = [*document.get("obstacle", []), table]
        return scenario.with_values(values)


def tip_force(system: System) -> float:
    """Return a force (N) that would bend a straight arm by a third of its length."""
    stiffness = float(jnp.min(system.forces.bending_stiffness(system.reference)))
    length = float(jnp.sum(system.reference.rest_length))
    return float(f"{3 * stiffness * _DEFLECTION / length**2:.2g}")


def _apart(place: Vector, obstacle: Obstacle, surface: SolidSurface | None) -> float:
    """Return the distance of a place from an obstacle at the start, of a bed its height (m)."""
    off, half = place - np.array(obstacle.position), np.array(obstacle.half_axis)
    if surface is not None and surface.heights:
        return float(off[-1] - surface.spline.at(off[None, :-1])[0])
    if isinstance(obstacle, Plane):
        return float(off @ np.array(obstacle.out))
    off -= np.clip(half @ off / (half @ half or 1.0), -1.0, 1.0) * half
    size = getattr(obstacle, "radius", 0.0)
    if surface is not None:
        size = np.linalg.norm(surface.points, axis=1).max()
    return float(np.linalg.norm(off) - size)


def launch_paths(debris: Debris, state: State, arm: Arm) -> list[tuple[Vector, Vector]]:
    """Return places (m) and velocities (m/s) from which debris hits an arm, the best first.

    It comes across the arm and with the current, or from the other side where the arm is in the
    way, or obliquely. It is aimed at where the arm will be if its velocity stays the same.
    """
    length, thickness = arm.length, max(arm.diameters)
    nodes = np.asarray(state.position)[1:]
    aim = round(_AIM * (len(nodes) - 1))
    along = nodes[min(aim + 1, len(nodes) - 1)] - nodes[aim - 1]
    along /= np.linalg.norm(along)
    water = np.asarray(state.flow_velocity)[1:][aim]
    across = water - (water @ along) * along
    if np.linalg.norm(across) < _STILL:
        down = np.zeros_like(along)
        down[-1] = -1.0
        across = down - (down @ along) * along
        if np.linalg.norm(across) < 0.1:  # the arm hangs
            across = np.eye(len(along))[0]
            across -= (across @ along) * along
    across /= np.linalg.norm(across)
    far = _FROM * length + debris.radius + thickness / 2
    led = _FLIGHT * np.asarray(state.velocity)[1:][aim]
    led *= min(1.0, _LED * length / max(float(np.linalg.norm(led)), 1e-9))
    places = [nodes[aim] + led - side * far * across for side in (1.0, -1.0)]
    room = [np.min(np.linalg.norm(nodes - place, axis=1)) for place in places]
    side = 1.0 if room[0] >= min(room[1], 2 * debris.radius + thickness) else -1.0
    ways = [side * across, -side * across]
    if len(along) == 3:
        ways += [np.cross(along, way) for way in ways]
    ways += [(way + tilt * along) / np.sqrt(2) for way in ways for tilt in (1.0, -1.0)]
    return [(nodes[aim] + led - far * way, water + _SPEED * length * way) for way in ways]


@compiled(**ONCE)
def launch(
    system: System, state: State, position: Float[Array, " d"], velocity: Float[Array, " d"]
) -> tuple[State, Bool[Array, ""]]:
    """Return a state with its last obstacle moved (m, m/s), and whether that touches nothing."""
    forces, motion = system.forces, state.motion
    obstacles = forces.obstacles
    assert obstacles is not None
    assert obstacles.bodies is not None
    row, count = forces.rows.obstacle(obstacles.count - 1), obstacles.count
    both = np.array([row, row + count])  # and its rotation
    acting = ActingForces.of(forces, state.context)
    axes = forces.axes
    moved = motion.position.at[row, :axes].set(position)
    faster = motion.velocity.at[both].set(0.0).at[row, :axes].set(velocity)
    still = motion.acceleration.at[both].set(0.0)
    gap, body_gap = acting.gaps(moved), acting.body_gaps(moved)
    assert gap is not None
    assert body_gap is not None
    pairs = [pair for group in obstacles.bodies.pairs for pair in group]
    own = np.array([count - 1 in pair for pair in pairs], bool)
    apart = jnp.concatenate([gap[-1], (body_gap - obstacles.bodies.skin)[own]])
    launched = replace(
        state,
        motion=replace(motion, position=moved, velocity=faster, acceleration=still),
        auxiliary_offset=state.auxiliary_offset.at[both].set(0.0),
        acceleration_history=state.acceleration_history.at[:, both].set(0.0),
        gap=gap,
        body_gap=body_gap,
    )
    return launched, jnp.all(apart > 0)


CAPACITY = 64  # most instants of a call
KINDS = ("none", "pid", "lqg", "mpc")
"""Kinds of controllers that any scenario with inputs may be switched to."""


class ShiftedTarget(Target):
    """A target, or its whole path, at a shift from that of the scenario."""

    shift: Float[Array, " d"] | None = None  # shift in the target's own frame (m)

    @staticmethod
    def of(target: Target, axes: int) -> ShiftedTarget:
        """Return a target with a shift of zero."""
        none = array(np.zeros(axes))
        return ShiftedTarget(target.fixed, target.path, target.moving, target.carrier, none)

    def in_frame(self, time: Time) -> Pose:
        """Return the reference pose at ``time`` (s), in the frame of the target."""
        assert self.shift is not None
        return super().in_frame(time).at[: self.shift.shape[0]].add(self.shift)


def shift_to(target: ShiftedTarget, place: Vector, time: float) -> Vector:
    """Return the shift that brings a target to a place in the world (m) at a time (s)."""
    assert target.shift is not None
    axes, now = target.shift.shape[0], jnp.asarray(time, float)
    there = target.to_frame(target(now).at[:axes].set(place), now)
    return np.asarray(target.shift + (there - target.in_frame(now))[:axes])


class StartError(RuntimeError):
    """A scenario without a state to start from."""


class ControlledScenario(NamedTuple):
    """A scenario under one kind of controller."""

    scenario: Scenario  # without interactive bodies
    parameters: Parameters  # with interactive bodies
    flows: tuple[Flow, ...]  # the flows of the scenario
    setup: Setup
    loop: Loop  # at the start, with a target that can be shifted

    @staticmethod
    def of(scenario: Scenario, bodies: InteractiveBodies, kind: str) -> ControlledScenario:
        """Assemble and compile a scenario under a kind of controller."""
        if kind != scenario.control.kind:
            scenario = controlled_by(scenario, kind)
        prepared = Prepared(bodies.added_to(scenario))
        numbers, place = prepared.parameters, np.asarray(scenario.base.position)
        # sliders change no wave number, so that no wave jumps
        flows = on_currents(numbers.flow, numbers.water.gravity)
        # a loop that starts has the form of one whose water was changed: both are one program
        prepared.parameters = replace(
            numbers, flow=adjusted_flows(flows, None, AdjustableNumbers(), place, 0.0)
        )

        prepared.check()
        setup = set_up(prepared)
        if trouble := start_failure(setup):
            raise StartError(trouble)
        target = ShiftedTarget.of(setup.loop.target, scenario.arm.dimension)
        loop = eqx.tree_at(lambda x: x.target, setup.loop, target)
        return ControlledScenario(scenario, prepared.parameters, flows, setup, loop)

    def loop_numbers(self, *, parked: bool, shift: Vector, since: float | None) -> LoopNumbers:
        """Return numbers of the loop, its target shifted (m), its control on since a time (s)."""
        controller = self.loop.controller
        own = controller.take_up if isinstance(controller, Pid) else array(0.0)
        on, take_up = self.loop.switched_on, own
        if since is not None:  # else it is in control from the start
            on, take_up = array(since), array(self.setup.plan.first_period)
        return LoopNumbers(jnp.asarray(parked), array(shift), on, take_up)


def kinds_for(scenario: Scenario) -> tuple[str, ...]:
    """Return the kinds of controllers that a scenario can be switched to."""
    others = KINDS if scenario.inputs else ("none",)
    return tuple(dict.fromkeys((*others, scenario.control.kind)))
