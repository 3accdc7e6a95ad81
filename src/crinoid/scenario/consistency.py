"""Rules between the tables of a scenario."""

import math
from collections.abc import Iterator, Mapping

from crinoid.scenario.arm import Arm
from crinoid.scenario.base import Base
from crinoid.scenario.control import COORDINATES, Control
from crinoid.scenario.errors import Mistake, one_of, shown
from crinoid.scenario.flow import Flow, GaussMarkovFlow, MeasuredFlow, ShearFlow, WavesFlow
from crinoid.scenario.motion import TableMotion
from crinoid.scenario.obstacle import Capsule, Cylinder, Obstacle
from crinoid.scenario.sensor import Reading
from crinoid.scenario.simulation import Output, Simulation, not_whole, whole_steps
from crinoid.scenario.target import Target
from crinoid.scenario.vehicle import Vehicle
from crinoid.scenario.water import Water
from crinoid.space import AXES, CHANNELS, LARGEST_TURN, PARTNERS
from crinoid.variables import large_names, of_dimension

__all__ = [
    "channel_conflicts",
    "contact_conflicts",
    "control_conflicts",
    "depth_conflicts",
    "joint_conflicts",
    "measured_conflicts",
    "motion_conflicts",
    "output_conflicts",
    "rate_conflicts",
    "record_conflicts",
    "shape_conflicts",
    "vehicle_conflicts",
    "wave_conflicts",
]

_MAX_READINGS = 10_000
"""Readings under way at once: all are moved at each time step."""
_MAX_CORRELATION_TIMES = 50_000
"""A random current as long as that takes 2 s to draw and 64 MB to keep."""


def joint_conflicts(base: Base, dimension: int) -> Iterator[Mistake]:
    """Yield what turns the root of a planar arm that turns freely.

    In space the joint hands on twist, so each turn of the base is felt.
    """
    if base.mount == "clamped" or dimension == 3:
        return
    text = 'moves nothing: with base.mount = "pinned" the root turns freely'
    if "tilt" in base.channels.present:
        yield Mistake("base.channels.tilt", text)
    for index, motion in enumerate(base.motion):
        if motion.channel == "tilt":
            yield Mistake(f"base.motion.{index}.channel", f"{shown(motion.channel)} {text}")


def shape_conflicts(arm: Arm) -> Iterator[Mistake]:
    """Yield a natural shape in which edges fold onto each other."""
    given = arm.rest_curvature
    bend = math.hypot(*given[:2]) if isinstance(given, tuple) else abs(given)
    turn = math.degrees(bend * arm.length / (arm.nodes - 1))
    if turn > LARGEST_TURN:
        text = f"turns the arm by {turn:.0f} degrees at each node; takes up to {LARGEST_TURN:.0f}: "
        yield Mistake("arm.rest_curvature", text + "less, or more arm.nodes")


def depth_conflicts(water: Water, base: Base, flows: tuple[Flow, ...]) -> Iterator[Mistake]:
    """Yield what lies below the bed, and what needs to know where it is."""
    depth = water.depth
    needing = {
        f"flow.{index}": flow
        for index, flow in enumerate(flows)
        if isinstance(flow, ShearFlow | WavesFlow)
    }
    if depth is None:
        if needing:
            names = ", ".join(needing)
            yield Mistake("water.depth", f"missing, takes a number above 0 (m): {names} needs it")
        return
    key, height = _height(base)
    if height < -depth:
        yield Mistake(key, f"got {height}; must be -water.depth = {-depth} or more (m), at the bed")
    for name, flow in needing.items():
        if isinstance(flow, WavesFlow):
            if flow.significant_height >= depth:
                text = f"got {flow.significant_height}, takes a number below water.depth"
                yield Mistake(f"{name}.significant_height", f"{text} = {depth} (m)")
            continue
        reference = depth - flow.reference_depth
        if reference <= 0:
            text = f"got {flow.reference_depth}, takes a number below water.depth = {depth} (m)"
            yield Mistake(f"{name}.reference_depth", text)
        elif flow.roughness_length is not None and flow.roughness_length >= reference:
            text = f"got {flow.roughness_length}, takes a number below {reference:.6g} (m), "
            text += "the height of reference_depth above the bed"
            yield Mistake(f"{name}.roughness_length", text)


def wave_conflicts(water: Water, base: Base, flows: tuple[Flow, ...]) -> Iterator[Mistake]:
    """Yield what waves cannot do without."""
    waves = [f"flow.{index}" for index, flow in enumerate(flows) if isinstance(flow, WavesFlow)]
    if not waves:
        return
    names = ", ".join(waves)
    if water.gravity == 0:
        yield Mistake("water.gravity", f"got 0.0, takes a number above 0 (m/s2): {names} needs it")
    key, height = _height(base)
    if height >= 0:
        text = f"got {height}, takes a number below 0 (m): {names} has its still surface at z = 0"
        yield Mistake(key, text)


def _height(base: Base) -> tuple[str, float]:
    """Return the height of the base (m), with its key."""
    return f"base.position.{len(base.position) - 1}", base.position[-1]


def measured_conflicts(flows: tuple[Flow, ...], dimension: int) -> Iterator[Mistake]:
    """Yield measured currents that lack a component, or have one too many."""
    for index, flow in enumerate(flows):
        if not isinstance(flow, MeasuredFlow):
            continue
        headed = flow.heading_deg is not None
        wanted = ("east", "north", "up") if headed else AXES[dimension]
        if len(flow.velocity) != len(wanted):
            text = f"got {shown(flow.velocity)}, takes a name for each of {', '.join(wanted)}"
            if dimension == 2 and not headed and len(flow.velocity) == 3:
                text += "; east, north and up go with heading_deg"
            yield Mistake(f"flow.{index}.velocity", text)


def record_conflicts(flows: tuple[Flow, ...], simulation: Simulation) -> Iterator[Mistake]:
    """Yield random currents that change so quickly that a run holds too much of them."""
    duration = simulation.duration
    for index, flow in enumerate(flows):
        if not isinstance(flow, GaussMarkovFlow):
            continue
        if duration > _MAX_CORRELATION_TIMES * flow.correlation_time:
            text = f"got {flow.correlation_time}, takes {duration / _MAX_CORRELATION_TIMES:.6g} or "
            text += f"more (s): simulation.duration = {duration} may hold {_MAX_CORRELATION_TIMES}"
            yield Mistake(f"flow.{index}.correlation_time", f"{text} of them")


def motion_conflicts(base: Base, simulation: Simulation, dimension: int) -> Iterator[Mistake]:
    """Yield prescribed motions of channels that are not there, or not from start to end."""
    duration = simulation.duration
    for index, motion in enumerate(base.motion):
        if motion.channel not in CHANNELS[dimension]:
            text = f"got {shown(motion.channel)}, takes {one_of(CHANNELS[dimension])}; "
            text += f"{motion.channel} needs arm.dimension = 3"
            yield Mistake(f"base.motion.{index}.channel", text)
        if not isinstance(motion, TableMotion):
            continue
        name, last = f"base.motion.{index}.time", len(motion.time) - 1
        if motion.time[0] > 0:
            yield Mistake(f"{name}.0", f"starts at {motion.time[0]}, takes 0 or before (s)")
        if motion.time[-1] < duration:
            text = f"ends at {motion.time[-1]}, takes simulation.duration = {duration} or later (s)"
            yield Mistake(f"{name}.{last}", text)


def vehicle_conflicts(vehicle: Vehicle | None, base: Base, target: Target) -> Iterator[Mistake]:
    """Yield what goes with a base that does not float only."""
    if vehicle is None:
        return
    if base.motion:
        text = "prescribes what the submarine does, takes no table vehicle, in which it floats"
        yield Mistake("base.motion", text)
    if target.frame == "base":
        text = 'got "base", which moves as prescribed; takes "world" with a table vehicle'
        yield Mistake("target.frame", text)


def channel_conflicts(
    control: Control, base: Base, threads: tuple[str, ...], dimension: int, *, others: bool
) -> Iterator[Mistake]:
    """Yield inputs that are driven but not there.

    ``threads`` are the names of chambers and tendons; with ``others`` there are actuators too,
    whose names are known when they have been built.
    """
    names = (*base.channels.present, *threads)
    for name in control.pid.present:
        key = f"control.pid.{name}"
        if name in CHANNELS[dimension] and name not in names:
            text = f"drives a channel that is not there; takes a table base.channels.{name} with it"
            yield Mistake(key, text)
        elif name not in (*names, *CHANNELS[3]) and not others:
            known = (*CHANNELS[dimension], *threads)
            yield Mistake(key, f"drives an input that is not there, takes {one_of(known)}")


def control_conflicts(control: Control, target: Target, dimension: int) -> Iterator[Mistake]:
    """Yield coordinates that the tip does not have, and what does not go with the controller."""
    if target.feed_forward and control.kind == "none":
        text = 'got true, goes with a controller; control.kind takes "pid" with it'
        yield Mistake("target.feed_forward", text)
    takes = f"takes {one_of(COORDINATES[dimension])}"
    if dimension == 3:
        takes += ": arm.dimension = 3"
    for index, name in enumerate(control.controlled):
        if name not in COORDINATES[dimension]:
            yield Mistake(f"control.controlled.{index}", f"got {shown(name)}, {takes}")
    driven = control.pid.present
    if control.mapping != "identity" or not driven:
        return
    partners = PARTNERS[dimension]
    for channel in driven:
        if channel not in partners:
            does = (
                "turns the base, which"
                if channel in CHANNELS[dimension]
                else "bends the arm, which"
            )
            text = f'{does} goes with no one coordinate; mapping = "identity" takes '
            text += ", ".join(partners)
            yield Mistake(f"control.pid.{channel}", text)
        elif partners[channel] not in control.controlled:
            text = f'mapping = "identity" takes {shown(partners[channel])} in controlled along'
            yield Mistake(f"control.pid.{channel}", f"{text} with it")
    for channel, coordinate in partners.items():
        if coordinate in control.controlled and channel not in driven:
            text = f'{shown(coordinate)} takes gains in pid.{channel} with mapping = "identity"'
            yield Mistake("control.controlled", text)
    if "direction" in control.controlled:
        text = 'got "direction", which does not go with mapping = "identity"; takes '
        text += one_of(partners.values())
        yield Mistake(f"control.controlled.{control.controlled.index('direction')}", text)


def rate_conflicts(
    sensors: Mapping[str, Reading], default_rate: float, control: Control, simulation: Simulation
) -> Iterator[Mistake]:
    """Yield rates of more than once a time step, and readings too many to keep."""
    step = simulation.time_step
    rates = {f"{key}.rate_hz": sensor.rate_hz for key, sensor in sensors.items()}
    rates["control.rate_hz"] = control.rate_hz
    for name, rate in rates.items():
        if rate is not None and rate * step > 1 + 1e-9:
            text = f"got {rate}, takes up to {1 / step:.6g} (Hz), once a time step"
            yield Mistake(name, f"{text} (simulation.time_step = {step})")
    for key, sensor in sensors.items():
        rate = sensor.rate_hz or default_rate
        if sensor.delay * rate > _MAX_READINGS:
            text = f"got {sensor.delay}, takes up to {_MAX_READINGS / rate:.6g} (s): at {rate:g} "
            text += f"Hz {_MAX_READINGS} readings are under way then"
            yield Mistake(f"{key}.delay", text)


def contact_conflicts(arm: Arm, obstacles: tuple[Obstacle, ...]) -> Iterator[Mistake]:
    """Yield an arm that has no surface to be touched, and what a planar arm would meet askew."""
    for index, obstacle in enumerate(obstacles):
        if arm.dimension == 2 and isinstance(obstacle, Cylinder | Capsule) and obstacle.oblique:
            text = f"got {shown(obstacle.axis)}, takes [0, 1, 0] or a vector with y = 0: oblique "
            text += "to the arm's plane its cut would be an ellipse"
            yield Mistake(f"obstacle.{index}.axis", text)
    if obstacles and arm.section.diameter == 0:
        text = "got 0.0, takes a number above 0 (m): the arm meets obstacles with this surface"
        yield Mistake("arm.section.diameter", text)


def output_conflicts(output: Output, simulation: Simulation, dimension: int) -> Iterator[Mistake]:
    """Yield variables that there are not, and an interval that no number of time steps fills."""
    there = of_dimension(dimension)
    for index, name in enumerate(output.variables or ()):
        if name not in there:
            text = f"got {shown(name)}, takes {one_of(large_names(dimension))}"
            yield Mistake(f"output.variables.{index}", text)
    interval = output.interval
    if interval is None:
        return
    steps = whole_steps(interval, simulation.time_step)
    if steps is None:
        yield Mistake("output.interval", not_whole(interval, simulation.time_step))
    elif steps > simulation.steps:
        text = f"got {interval}, takes up to simulation.duration = {simulation.duration} (s)"
        yield Mistake("output.interval", text)
