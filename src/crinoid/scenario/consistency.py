"""Rules between the tables of a scenario."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from pkgutil import resolve_name
from typing import TYPE_CHECKING, TypeVar

from crinoid.foundation.axes import AXES, CHANNELS, LARGEST_TURN, PARTNERS
from crinoid.foundation.result_variables import large_names, of_dimension
from crinoid.scenario.actuator import actuator_conflicts, thread_conflicts
from crinoid.scenario.base_motion import ChannelMotion, ResponseMotion, TableMotion
from crinoid.scenario.control import COORDINATES
from crinoid.scenario.errors import Mistake, got, missing, one_of, shown
from crinoid.scenario.flow import MeasuredFlow, ShearFlow
from crinoid.scenario.obstacle import Capsule, Cylinder
from crinoid.scenario.random_flow import GaussMarkovFlow
from crinoid.scenario.sensor import sensor_conflicts
from crinoid.scenario.ship_wake import ShipWakeFlow
from crinoid.scenario.simulation import whole_conflicts
from crinoid.scenario.tool import tool_conflicts
from crinoid.scenario.waves import SurfaceWaves

if TYPE_CHECKING:
    from crinoid.scenario.scenario import Scenario

_MAX_READINGS = 10_000  # readings on their way at the same time: all move at each time step
_MAX_CORRELATION_TIMES = 50_000  # drawing a random current of that length needs 2 s and 64 MB

_Flow = TypeVar("_Flow")


def _flows_of_kind(scenario: Scenario, kind: type[_Flow]) -> Iterator[tuple[str, _Flow]]:
    """Yield the flows of a kind, each with its dotted key."""
    return ((f"flow.{i}", flow) for i, flow in enumerate(scenario.flow) if isinstance(flow, kind))


def _joint_conflicts(scenario: Scenario) -> Iterator[Mistake]:
    """Yield turns of the base that a planar arm on a joint does not feel.

    In space the joint transmits twist, so the arm feels each turn of the base.
    """
    base = scenario.base
    if base.mount == "clamped" or scenario.arm.dimension == 3:
        return
    pinned, hint = 'with base.mount = "pinned"', "The root turns freely."
    if "tilt" in base.channels.present:
        yield scenario.mistake("base.channels.tilt", f"be left out {pinned}", hint)
    for index, motion in enumerate(base.motion):
        if isinstance(motion, ChannelMotion) and motion.channel == "tilt":
            must = f'be "slide" or "heave" {pinned}'
            yield scenario.mistake(f"base.motion.{index}.channel", must, hint)


def _shape_conflicts(scenario: Scenario) -> Iterator[Mistake]:
    """Yield a natural shape in which edges fold onto each other."""
    arm = scenario.arm
    given = arm.rest_curvature
    bend = math.hypot(*given[:2]) if isinstance(given, tuple) else abs(given)
    turn = math.degrees(bend * arm.length / (arm.nodes - 1))
    if turn > LARGEST_TURN:
        must = f"turn the arm by at most {LARGEST_TURN:.0f} degrees at each node, not {turn:.0f}"
        yield scenario.mistake("arm.rest_curvature", must, "Lower it, or raise arm.nodes.")


def _depth_conflicts(scenario: Scenario) -> Iterator[Mistake]:
    """Yield a base below the bed, and flows that do not fit the depth of the water."""
    depth = scenario.water.depth
    shears = dict(_flows_of_kind(scenario, ShearFlow))
    waves = dict(_flows_of_kind(scenario, SurfaceWaves))
    if depth is None:
        if names := ", ".join(shears):
            yield Mistake("water.depth", missing(f"be a number above 0 (m) for {names}"))
        return
    if scenario.base.position[-1] < -depth:
        must = f"be -water.depth = {-depth} or more (m), at the bed"
        yield scenario.mistake(_height(scenario), must)
    below_depth = f"be below water.depth = {depth} (m)"
    for name, wave in waves.items():
        if wave.state is not None and wave.state.height >= depth:
            yield scenario.mistake(f"{name}.{wave.keys[0]}", below_depth)
    for name, shear in shears.items():
        reference = depth - shear.reference_depth
        roughness = shear.roughness_length
        if reference <= 0:
            yield scenario.mistake(f"{name}.reference_depth", below_depth)
        elif roughness is not None and roughness >= reference:
            must = f"be below {reference:.6g} (m), the height of reference_depth above the bed"
            yield scenario.mistake(f"{name}.roughness_length", must)


def _wave_conflicts(scenario: Scenario) -> Iterator[Mistake]:
    """Yield mistakes of waves: no gravity, a base above them, or a current that stops them."""
    names = ", ".join(name for name, _ in _flows_of_kind(scenario, SurfaceWaves))
    if names and scenario.water.gravity == 0:
        yield scenario.mistake("water.gravity", f"be above 0 (m/s2) for {names}")
    if names and scenario.base.position[-1] >= 0:
        yield scenario.mistake(_height(scenario), f"be below 0 (m), the still surface of {names}")
    for name, wave in _flows_of_kind(scenario, SurfaceWaves):
        against = -wave.current_along(scenario)
        if against <= 0 or not scenario.water.gravity or wave.state is None:
            continue
        stopped = resolve_name("crinoid.numerics.dispersion:stopped")
        frequency = float(stopped(against, scenario.water.depth, scenario.water.gravity))
        # of irregular waves those that the spectrum has little of may be stopped
        least = 2 * math.pi * (1.0 if wave.state.regular else 2.0)
        if frequency * wave.state.period <= least:
            must = "be that of waves that travel"
            if frequency:
                must = f"be above {least / frequency:.3g} (s) for waves to travel"
            must += f" against the mean current of {against:.3g} m/s"
            yield scenario.mistake(f"{name}.{wave.keys[1]}", must)


def _wake_conflicts(scenario: Scenario) -> Iterator[Mistake]:
    """Yield ships that do not fit the water, or whose wake needs too many waves."""
    wakes = _flows_of_kind(scenario, ShipWakeFlow) if scenario.water.gravity else ()
    for name, wake in wakes:
        for key, must in wake.misfits(scenario):
            yield scenario.mistake(f"{name}.{key}", must)


def _height(scenario: Scenario) -> str:
    """Return the key of the height of the base."""
    return f"base.position.{scenario.arm.dimension - 1}"


def _measured_conflicts(scenario: Scenario) -> Iterator[Mistake]:
    """Yield measured currents with too few or too many components."""
    dimension = scenario.arm.dimension
    for key, flow in _flows_of_kind(scenario, MeasuredFlow):
        headed = flow.heading_deg is not None
        components = ("east", "north", "up") if headed else AXES[dimension]
        if flow.speed is None and len(flow.velocity) != len(components):
            east = dimension == 2 and not headed and len(flow.velocity) == 3
            hint = "Set heading_deg to name east, north and up." if east else ""
            must = f"have a name for each of {', '.join(components)}"
            yield scenario.mistake(f"{key}.velocity", must, hint)


def _record_conflicts(scenario: Scenario) -> Iterator[Mistake]:
    """Yield random currents that change too quickly for the length of the run."""
    duration = scenario.simulation.duration
    for key, flow in _flows_of_kind(scenario, GaussMarkovFlow):
        if duration > _MAX_CORRELATION_TIMES * flow.correlation_time:
            must = f"be at least {duration / _MAX_CORRELATION_TIMES:.6g} (s)"
            hint = f"Or shorten simulation.duration = {duration}."
            yield scenario.mistake(f"{key}.correlation_time", must, hint)


def _motion_conflicts(scenario: Scenario) -> Iterator[Mistake]:
    """Yield motions of channels that do not exist or without their waves, and too short ones."""
    duration, channels = scenario.simulation.duration, CHANNELS[scenario.arm.dimension]
    for index, motion in enumerate(scenario.base.motion):
        key = f"base.motion.{index}"
        if isinstance(motion, ChannelMotion) and motion.channel not in channels:
            must, hint = f"be {one_of(channels)}", "Set arm.dimension = 3 to use it."
            yield scenario.mistake(f"{key}.channel", must, hint)
        if isinstance(motion, ResponseMotion):
            if not any(_flows_of_kind(scenario, SurfaceWaves)):
                hint = 'Add a [[flow]] of kind "waves" or "regular-wave".'
                yield Mistake(f"{key}.kind", got("rao", "be left out without surface waves", hint))
            if scenario.arm.dimension == 2 and motion.heading_deg % 180:
                must, hint = "be 0 or 180 in the plane", "Set arm.dimension = 3 for others."
                yield scenario.mistake(f"{key}.heading_deg", must, hint)
        if isinstance(motion, TableMotion):
            if motion.time[0] > 0:
                yield scenario.mistake(f"{key}.time.0", "be 0 or earlier (s)")
            if motion.time[-1] < duration:
                must = f"be at least simulation.duration = {duration} (s)"
                yield scenario.mistake(f"{key}.time.{len(motion.time) - 1}", must)


def _vehicle_conflicts(scenario: Scenario) -> Iterator[Mistake]:
    """Yield keys that exist only for a base that does not float."""
    floats, motion = scenario.floats, scenario.base.motion
    if floats and motion:
        hint = "A vehicle floats and has no prescribed motion."
        yield scenario.mistake("base.motion", "be left out with vehicle.mass", hint)
    if floats and scenario.target.frame == "base":
        yield scenario.mistake("target.frame", 'be "world" with vehicle.mass')


def _channel_conflicts(scenario: Scenario) -> Iterator[Mistake]:
    """Yield gains of inputs that do not exist."""
    channels, threads = CHANNELS[scenario.arm.dimension], scenario.threads
    names = scenario.inputs
    for name, gains in scenario.control.pid.present.items():
        key = f"control.pid.{name}"
        if name in channels and name not in names:
            text = got(gains, "drive an existing channel", f"Add a table base.channels.{name}.")
            yield Mistake(key, text)
        # the inputs of other actuators are known only after they are built
        elif name not in (*names, *CHANNELS[3]) and not scenario.actuator:
            yield Mistake(key, got(gains, f"drive {one_of((*channels, *threads))}"))


def _control_conflicts(scenario: Scenario) -> Iterator[Mistake]:
    """Yield coordinates that the tip does not have, and keys that the controller does not use."""
    control, dimension = scenario.control, scenario.arm.dimension
    in_space = " with arm.dimension = 3" if dimension == 3 else ""
    for index, name in enumerate(control.controlled):
        if name not in COORDINATES[dimension]:
            must = f"be {one_of(COORDINATES[dimension])}{in_space}"
            yield scenario.mistake(f"control.controlled.{index}", must)
    driven = control.pid.present
    if control.mapping != "identity" or not driven:
        return
    partners, identity = PARTNERS[dimension], 'with mapping = "identity"'
    for channel, gains in driven.items():
        if channel not in partners:
            hint = f"It maps to no single coordinate. Use {one_of(partners)}."
            yield Mistake(f"control.pid.{channel}", got(gains, f"be left out {identity}", hint))
        elif partners[channel] not in control.controlled:
            must = f"have {shown(partners[channel])} in controlled {identity}"
            yield scenario.mistake(f"control.pid.{channel}", must)
    for channel, coordinate in partners.items():
        if coordinate in control.controlled and channel not in driven:
            must = f"have gains in pid.{channel} for {shown(coordinate)} {identity}"
            yield scenario.mistake("control.controlled", must)
    if "direction" in control.controlled:
        must, index = f"be {one_of(partners.values())}", control.controlled.index("direction")
        yield scenario.mistake(f"control.controlled.{index}", f"{must} {identity}")


def _target_conflicts(scenario: Scenario) -> Iterator[Mistake]:
    """Yield a time from which errors count that the run does not reach."""
    duration, begin = scenario.simulation.duration, scenario.target.judged_from
    if begin is not None and begin >= duration:
        must = f"be below simulation.duration = {duration} (s)"
        yield scenario.mistake("target.judged_from", must)


def _rate_conflicts(scenario: Scenario) -> Iterator[Mistake]:
    """Yield rates above one per time step, and delays with too many readings on their way."""
    step = scenario.simulation.time_step
    further = {f"sensors.{index}": sensor for index, sensor in enumerate(scenario.sensors)}
    sensors = {"sensor": scenario.sensor, **further}
    rates = {f"{key}.rate_hz": each.rate_hz for key, each in sensors.items()}
    for key, rate in {**rates, "control.rate_hz": scenario.control.rate_hz}.items():
        if rate is not None and rate * step > 1 + 1e-9:
            must = f"be at most {1 / step:.6g} (Hz), once a time step"
            yield Mistake(key, got(rate, must, f"Lower simulation.time_step = {step} for more."))
    for key, sensor in sensors.items():
        rate = scenario.rate_hz(sensor.rate_hz)
        if sensor.delay * rate > _MAX_READINGS:
            most = f"{_MAX_READINGS / rate:.6g} (s), {_MAX_READINGS} readings at {rate:g} Hz"
            yield scenario.mistake(f"{key}.delay", f"be at most {most}")


def _contact_conflicts(scenario: Scenario) -> Iterator[Mistake]:
    """Yield what has no surface to touch, and obstacles oblique to the plane of the arm."""
    arm, obstacles = scenario.arm, scenario.obstacle
    for index, obstacle in enumerate(obstacles):
        if arm.dimension == 2 and isinstance(obstacle, Cylinder | Capsule) and obstacle.oblique:
            hint = "An oblique axis has an ellipse as its cut with the plane of the arm."
            must = "be [0, 1, 0] or a vector with y = 0"
            yield scenario.mistake(f"obstacle.{index}.axis", must, hint)
        if obstacle.spinning_friction and arm.dimension == 2:
            must = "be left out in the plane, where nothing turns about a normal"
            yield scenario.mistake(f"obstacle.{index}.spinning_friction", must)
            continue
        for name in ("rolling_friction", "spinning_friction"):
            free = any(each.free for each in obstacles)
            if getattr(obstacle, name) and (len(obstacles) == 1 or not free):
                must = "be left out without a free body and another obstacle that it touches"
                hint = "Add another obstacle." if free else "Set the mass of a sphere or a capsule."
                yield scenario.mistake(f"obstacle.{index}.{name}", must, hint)
    if (obstacles or scenario.contact.self_) and arm.section.diameter == 0:
        yield scenario.mistake("arm.section.diameter", "be above 0 (m), the surface of contact")
    if scenario.hull is not None and not scenario.contact.self_:
        must = "be left out with contact.self = false"
        yield scenario.mistake("vehicle.hull", must, "Set contact.self = true for its contact.")


def _output_conflicts(scenario: Scenario) -> Iterator[Mistake]:
    """Yield variables that do not exist, and an interval that does not fit the time steps."""
    simulation, dimension = scenario.simulation, scenario.arm.dimension
    for index, name in enumerate(scenario.output.variables or ()):
        without = {"vortices"} if scenario.water.vortices is None else set()
        without |= set() if scenario.control.settings.observes else {"estimate"}
        without |= set() if scenario.contact.self_ else {"self"}
        without |= {"hull"} if scenario.hull is None else set()
        if name not in of_dimension(dimension, without=without):
            must = f"be {one_of(large_names(dimension, without=without))}"
            yield scenario.mistake(f"output.variables.{index}", must)
    interval = scenario.output.interval
    if interval is None:
        return
    mistakes = list(whole_conflicts("output.interval", interval, simulation.time_step))
    yield from mistakes
    if not mistakes and round(interval / simulation.time_step) > simulation.steps:
        must = f"be at most simulation.duration = {simulation.duration} (s)"
        yield scenario.mistake("output.interval", must)


RULES: tuple[Callable[[Scenario], Iterator[Mistake]], ...] = (
    _shape_conflicts,
    _joint_conflicts,
    _depth_conflicts,
    _wave_conflicts,
    _measured_conflicts,
    _wake_conflicts,
    _record_conflicts,
    _motion_conflicts,
    _vehicle_conflicts,
    _channel_conflicts,
    _control_conflicts,
    _target_conflicts,
    lambda scenario: scenario.control.settings.conflicts(scenario),
    _rate_conflicts,
    lambda scenario: sensor_conflicts(scenario.sensors, scenario.obstacle),
    lambda scenario: actuator_conflicts(scenario.actuator, scenario.threads),
    lambda scenario: thread_conflicts(scenario.chamber, scenario.tendon, scenario.arm),
    _contact_conflicts,
    lambda scenario: tool_conflicts(scenario.tool, len(scenario.obstacle)),
    _output_conflicts,
)
"""Rules that need vectors of the right length."""
