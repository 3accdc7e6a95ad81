"""Plausibility rules that no range expresses: angles, base, water, loads and time steps."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from crinoid.assembly.facts import Facts
from crinoid.diagnostics.plausibility.rule import magnitude, numbers, rule, unusual
from crinoid.diagnostics.plausibility.table import IN_AIR, LIMP, arm_depth, breaking_height
from crinoid.scenario import (
    DistributedLoad,
    GaussMarkovFlow,
    GustFlow,
    LoadTable,
    SurfaceWaves,
    TipLoad,
    TurbulenceFlow,
    shown,
)
from crinoid.scenario.model import Model, properties_of
from crinoid.scenario.obstacle import Plane, Seabed
from crinoid.scenario.quantity import unit_of

_FAST = 5.0  # speed of the fastest tidal currents (m/s)
_ROPE = 150.0
"""Largest force per length times length cubed over EI: it bends over a fifth of the length."""
_BENDING = {"N": (2, LIMP), "N/m": (3, LIMP), "N m": (1, 20.0)}
"""By the unit of a load: the power of the length with which it is over EI, and the largest value; a
moment winds three turns."""
_GREENHILL = 7.837
"""Force per length over EI / length^3 at which a cantilever buckles (Greenhill 1881)."""
_EULER = math.pi**2 / 4  # force over EI / length^2 at which a cantilever buckles
_BECK = 20.05  # force that follows the tip, over EI / length^2, under which it flutters (Beck 1952)
_ANGLES = (
    *("base.tilt_deg", "base.pan_deg", "base.roll_deg", "base.channels.*.range_deg"),
    *("base.motion.*.amplitude_deg", "base.motion.*.phase_deg", "base.motion.*.value_deg"),
    *("base.motion.*.heading_deg", "flow.*.phase_deg", "flow.*.direction_deg"),
    *("flow.*.heading_deg", "target.angle_deg"),
)


@rule(*_ANGLES, limit="no multiple of 5 degrees written in radians")
def _radians(facts: Facts) -> Iterator[str]:
    for key in _ANGLES:
        for found, value, _ in numbers(facts.scenario, key):
            largest = max(map(abs, value), default=0.0) if isinstance(value, tuple) else abs(value)
            turn = math.degrees(largest)
            # angles that people choose are multiples of 5 degrees; three digits miss by 0.1
            off = abs(turn - 5.0 * round(turn / 5.0))
            if 0 < largest <= 2 * math.pi + 0.01 and turn > 2.5 and off < 0.1:
                hint = f"{largest:g} rad are {turn:.0f} degrees. Is it in radians?"
                yield f"{found}: got {shown(value)} degrees; {hint}"


@rule("flow", limit="up to 5 m/s each")
def _flow_speed(facts: Facts) -> Iterator[str]:
    for index, speed in facts.speeds.items():
        if speed > _FAST:
            got, usual = f"a flow of up to {speed:.3g} m/s", f"up to {_FAST:g} m/s"
            yield unusual(f"flow.{index}", got, usual, "Is it in cm/s or mm/s?")


@rule(
    *("flow.*.elevation", "flow.*.spectrum"),
    limit="significant height up to that of breaking waves, and up to the depth of the arm",
)
def _seas_in_files(facts: Facts) -> Iterator[str]:
    for index, sea in facts.prepared.seas.items():
        height, period, *_ = sea.statistics
        got, depth = f"a significant height of {height:.3g} m", arm_depth(facts)
        if height > (most := breaking_height(facts, period)):
            yield unusual(f"flow.{index}", got, f"up to {most:.3g} m", "Such waves break.")
        if 0 <= depth < height:
            yield unusual(f"flow.{index}", got, f"up to {depth:.3g} m, the arm's depth", IN_AIR)


@rule(
    "base.position", limit="base and straight arm below z = 0 and, without a plane, above the bed"
)
def _base_height(facts: Facts) -> Iterator[str]:
    base, depth = facts.scenario.base, facts.scenario.water.depth
    if not facts.wet:
        return
    last = len(base.position) - 1
    height = base.position[last]
    tip = height + facts.length * facts.direction[-1]
    got = f"base.position.{last}: got {height:g} m"
    if height > 0:
        yield f"{got}, above the water; its surface is at z = 0, and z is up. Is the sign right?"
    elif height < 0 < tip:
        yield (
            f"{got}; the arm leaves the water, up to z = {tip:.3g} m (its surface is at z = 0). "
            "The part above is computed as if it were in water."
        )
    bed = any(isinstance(obstacle, Plane | Seabed) for obstacle in facts.scenario.obstacle)
    if depth is not None and tip < -depth <= height and not bed:
        yield (
            f"{got}; the arm reaches z = {tip:.3g} m, through the bed at z = {-depth:g} m "
            "(water.depth). Add an [[obstacle]] of kind plane or seabed."
        )


@rule(
    "load.*.force",
    "load.*.magnitude",
    "load.*.moment",
    limit="force (N) times L^2 / EI and force per length (N/m) times L^3 / EI up to 500, moment "
    "times L / EI up to 20; no push toward the root that buckles the arm",
)
def _loads(facts: Facts) -> Iterator[str]:
    for key in ("force", "magnitude", "moment"):
        for found, value, load in numbers(facts.scenario, f"load.*.{key}"):
            unit = _unit(load, key)
            power, most = _BENDING.get(unit, (0, math.inf))
            bent = facts.limpness(magnitude(value), power)
            push = 0.0 if key == "moment" or not value else _push(facts, load)
            got = f"{shown(value)} {unit}"
            if bent > most:
                factor = "L" if power == 1 else f"L^{power}"
                got += f" ({key} times {factor} / EI = {bent:.3g})"
                hint = f"Is it in m{unit}, or arm.youngs_modulus in kPa or MPa?"
                yield unusual(found, got, f"up to {most:g}", hint)
            elif push > 1:
                text = f"pushes toward the root with {push:.2g} times the load that the arm bears"
                yield f"{found}: got {got}, which {text}: it buckles or flutters, to either side."


def _unit(table: Model, key: str) -> str:
    """Return the unit of a key of a table; empty if it has none."""
    return unit_of(properties_of(type(table)).get(key, {}))


def _push(facts: Facts, load: LoadTable) -> float:
    """Return the push toward the root over that which buckles a cantilever, 0 for a pull."""
    bending, along = float(facts.bending.min()), np.array(facts.direction)
    if facts.scenario.base.mount != "clamped":
        return 0.0
    if isinstance(load, TipLoad):
        push = -(load.force[0] if load.follower else float(along @ load.force))
        return push * facts.length**2 / bending / (_BECK if load.follower else _EULER)
    if not (isinstance(load, DistributedLoad) and isinstance(load.direction, tuple)):
        return 0.0
    way = np.array(load.direction) / math.hypot(*load.direction)
    return -load.magnitude * float(along @ way) * facts.length**3 / bending / _GREENHILL


@rule(
    "arm.youngs_modulus",
    "arm.section.EI",
    limit="weight in water, and drag of all flows together, times L^3 / EI up to 150; weight on an "
    "arm that points up, 7.8",
)
def _limp(facts: Facts) -> Iterator[str]:
    section, water = facts.scenario.arm.section, facts.scenario.water
    weight = water.gravity * float((facts.mass - facts.displaced).mean())
    drag = 0.5 * water.density * water.drag_normal * facts.diameter * facts.current**2
    loads = {"weight in water": abs(weight)}
    if facts.current < 2 * _FAST:  # faster water has a note already
        loads["drag"] = drag
    bending = float(facts.bending.min())
    key, value = "arm.youngs_modulus", f"{facts.scenario.arm.youngs_modulus:g} Pa"
    if section.EI is not None:
        key, value = "arm.section.EI", f"{bending:g} N m2"
    name = max(loads, key=loads.__getitem__)
    bent = facts.limpness(loads[name], 3)
    pushed, most = weight * facts.direction[-1], _GREENHILL * bending / facts.length**3
    if bent > _ROPE:
        value += f" ({name} times L^3 / EI = {bent:.2g}: it hangs like a rope)"
        yield unusual(key, value, f"up to {_ROPE:g}", "Is it in kPa or MPa?")
    elif facts.scenario.control.settings.balances:  # which swings up an arm that buckles
        return
    elif pushed > most and facts.scenario.base.mount == "clamped":
        way, force = ("up", "weight") if weight > 0 else ("down", "buoyancy")
        yield (
            f"{key}: got {value}; the arm points {way} and buckles under its {force} of "
            f"{abs(weight):.3g} N/m, to either side: it bears "
            f"{most / abs(facts.direction[-1]):.2g} N/m."
        )


def _time_scales(facts: Facts) -> Iterator[tuple[str, float, float]]:
    """Yield what varies in time: its name, its period (s), and the time steps that resolve it."""
    scenario = facts.scenario
    second = float(facts.frequencies[1])
    yield f"the arm's second bending mode (about {second:.2g} Hz)", 1 / second, 8
    channels = scenario.base.channels.present
    for name in (name for name in scenario.driven if name in channels):
        band = channels[name].bandwidth_hz
        yield f"the servo of {name} ({band:g} Hz)", 1 / band, 4
    if cycle := scenario.target.period or 1 / (scenario.target.frequency_hz or math.inf):
        yield "the period of the target", cycle, 8
    for index, flow in enumerate(scenario.flow):
        name = f"flow.{index}"
        match flow:
            case GustFlow():
                yield name, flow.duration, 8
            case GaussMarkovFlow():
                yield f"the correlation time of {name}", flow.correlation_time, 3
            case SurfaceWaves():
                yield f"the waves of {name}", facts.sea_state(index, flow).period, 16
            case TurbulenceFlow():
                yield f"the passing of an eddy of {name}", flow.length_scale / facts.current, 8
    for table in ("flow", "load", "base.motion"):
        for key, unit, power in (("frequency_hz", "Hz", -1), ("period", "s", 1)):
            for found, value, each in numbers(scenario, f"{table}.*.{key}"):
                if _unit(each, key) == unit and magnitude(value):
                    yield found.removesuffix(f".{key}"), magnitude(value) ** power, 8


@rule(
    "simulation.time_step",
    limit="8 time steps to the period of the second bending mode, of the target, of sines, "
    "gusts and loads and to the passing of an eddy, 16 to the peak period of waves, 4 to a period "
    "at a driven servo's bandwidth, 3 to a correlation time",
)
def _time_step(facts: Facts) -> Iterator[str]:
    step = facts.scenario.simulation.time_step
    name, period, steps = min(_time_scales(facts), key=lambda scale: scale[1] / scale[2])
    if step * steps > period:
        value = f"{step:g} s, {period / step:.2g} time steps in {name}, {period:.2g} s"
        hint = f"Use up to {period / steps:.2g} s."
        yield unusual("simulation.time_step", value, f"{steps:g} or more", hint)


CHECKS = (_radians, _seas_in_files, _base_height, _flow_speed, _loads, _limp, _time_step)
