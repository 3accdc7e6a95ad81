"""What the tables of a scenario ask of one another."""

from __future__ import annotations

from collections.abc import Iterator

from crinoid.scenario.arm import Arm
from crinoid.scenario.base import Base
from crinoid.scenario.control import Control, Sensor
from crinoid.scenario.errors import Mistake
from crinoid.scenario.flow import Flow, GaussMarkovFlow, ShearFlow, WavesFlow
from crinoid.scenario.motion import TableMotion
from crinoid.scenario.obstacle import Obstacle
from crinoid.scenario.simulation import Output, Simulation, not_whole, whole_steps
from crinoid.scenario.water import Water

__all__ = [
    "channel_conflicts",
    "contact_conflicts",
    "depth_conflicts",
    "motion_conflicts",
    "output_conflicts",
    "rate_conflicts",
    "record_conflicts",
    "size_conflicts",
    "wave_conflicts",
]

_MAX_BYTES = 8e9
_BYTES_PER_NODE = 100
_MAX_CORRELATION_TIMES = 50_000
"""A random current as long as that takes 2 s to draw and 64 MB to keep."""


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
    height = base.position[1]
    if height <= -depth:
        text = f"got {height}, takes a number above -water.depth = {-depth} (m)"
        yield Mistake("base.position.1", text)
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
    height = base.position[1]
    if height >= 0:
        text = f"got {height}, takes a number below 0 (m): {names} has its still surface at z = 0"
        yield Mistake("base.position.1", text)


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


def motion_conflicts(base: Base, simulation: Simulation) -> Iterator[Mistake]:
    """Yield prescribed motions that do not last from the start to the end of the run."""
    duration = simulation.duration
    for index, motion in enumerate(base.motion):
        if not isinstance(motion, TableMotion):
            continue
        name, last = f"base.motion.{index}.time", len(motion.time) - 1
        if motion.time[0] > 0:
            yield Mistake(f"{name}.0", f"starts at {motion.time[0]}, takes 0 or before (s)")
        if motion.time[-1] < duration:
            text = f"ends at {motion.time[-1]}, takes simulation.duration = {duration} or later (s)"
            yield Mistake(f"{name}.{last}", text)


def channel_conflicts(control: Control, base: Base) -> Iterator[Mistake]:
    """Yield channels that are driven but not there."""
    for name in control.pid.present:
        if name not in base.channels.present:
            text = f"drives a channel that is not there; takes a table base.channels.{name} with it"
            yield Mistake(f"control.pid.{name}", text)


def rate_conflicts(sensor: Sensor, control: Control, simulation: Simulation) -> Iterator[Mistake]:
    """Yield rates of more than once a time step."""
    step = simulation.time_step
    rates = {"sensor.rate_hz": sensor.rate_hz, "control.rate_hz": control.rate_hz}
    for name, rate in rates.items():
        if rate is not None and rate * step > 1 + 1e-9:
            text = f"got {rate}, takes up to {1 / step:.6g} (Hz), once a time step"
            yield Mistake(name, f"{text} (simulation.time_step = {step})")


def contact_conflicts(arm: Arm, obstacles: tuple[Obstacle, ...]) -> Iterator[Mistake]:
    """Yield an arm that has no surface to be touched."""
    if obstacles and arm.section.diameter == 0:
        text = "got 0.0, takes a number above 0 (m): the arm meets obstacles with this surface"
        yield Mistake("arm.section.diameter", text)


def output_conflicts(output: Output, simulation: Simulation) -> Iterator[Mistake]:
    """Yield an interval that no number of time steps fills."""
    interval = output.interval
    if interval is None:
        return
    steps = whole_steps(interval, simulation.time_step)
    if steps is None:
        yield Mistake("output.interval", not_whole(interval, simulation.time_step))
    elif steps > simulation.steps:
        text = f"got {interval}, takes up to simulation.duration = {simulation.duration} (s)"
        yield Mistake("output.interval", text)


def size_conflicts(nodes: int, instants: int) -> Iterator[Mistake]:
    """Yield a result that no memory holds: all of it is kept until the end of a run."""
    size = instants * nodes * _BYTES_PER_NODE
    if size > _MAX_BYTES:
        text = f"keeps {instants} instants of {nodes} nodes, about {size / 1e9:.0f} GB; "
        text += f"takes a longer one, for {_MAX_BYTES / 1e9:.0f} GB or less"
        yield Mistake("output.interval", text)
