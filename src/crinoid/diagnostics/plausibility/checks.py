"""Plausibility rules that no range expresses: base, water, loads and time steps."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from operator import attrgetter

import numpy as np
from jaxtyping import Float

from crinoid.assembly.facts import Facts
from crinoid.diagnostics.plausibility.rule import Rule, numbers, unusual
from crinoid.diagnostics.plausibility.table import ANGLES, CURRENT, GREENHILL, LIMP, WOUND
from crinoid.foundation.axes import ANGLES as TURNING
from crinoid.scenario import (
    GaussMarkovFlow,
    GustFlow,
    SineFlow,
    SurfaceWaves,
    TurbulenceFlow,
    shown,
)
from crinoid.scenario.base_motion import (
    FileMotion,
    Motion,
    SineMotion,
    TableMotion,
    VelocityMotion,
    VesselMotion,
)
from crinoid.scenario.obstacle import Plane, Seabed

_BASE_SPEED, _BASE_ACCELERATION = 5.0, 20.0
"""Largest usual speed (m/s) and acceleration (m/s2, two g) of the base, or of the tip of a stiff
arm that it turns."""
_DAMPED = 0.05
"""Damping ratio that a time integrator may add to the first vibration."""

Check = Callable[[Facts], Iterator[str]]


def check(*keys: str, limit: str, quantity: str = "") -> Callable[[Check], Rule]:
    """Return the decorator that makes a rule of a function."""
    return lambda warnings: Rule(keys, limit, warnings, quantity)


@check(*ANGLES, limit="no multiple of 5 degrees written in radians")
def _radians(facts: Facts) -> Iterator[str]:
    for key in ANGLES:
        for found, value, _ in numbers(facts.scenario, key):
            largest = max(map(abs, value), default=0.0) if isinstance(value, tuple) else abs(value)
            turn = math.degrees(largest)
            # angles that people choose are multiples of 5 degrees; three digits miss by 0.1
            off = abs(turn - 5.0 * round(turn / 5.0))
            if 0 < largest <= 2 * math.pi + 0.01 and turn > 2.5 and off < 0.1:
                hint = f"{largest:g} rad are {turn:.0f} degrees. Is it in radians?"
                yield f"{found}: got {shown(value)} degrees; {hint}"


@check("flow.*.velocity_scale", limit="a record, or a flow of a package, up to 5 m/s")
def _flow_speed(facts: Facts) -> Iterator[str]:
    speeds = {f"flow.{index}": speed for index, speed in facts.sampled_speeds.items()}
    for index in facts.prepared.recordings:
        speed = facts.fastest(index, facts.scenario.flow[index])
        speeds[f"flow.{index}.velocity_scale"] = speed
    for key, speed in speeds.items():
        if speed > CURRENT:
            value, usual = f"a flow of up to {speed:.3g} m/s", f"up to {CURRENT:g} m/s"
            yield unusual(key, value, usual, "Is it in cm/s?")


@check(
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


@check("base.motion.*", limit="up to 5 m/s and 20 m/s2, of the base or of the tip of a stiff arm")
def _base_motion(facts: Facts) -> Iterator[str]:
    hint = "Are lengths in m, angles in degrees and times in s?"
    for index, motion in enumerate(facts.scenario.base.motion):
        found = f"base.motion.{index}"
        key, time, columns = _course(facts, found, motion)
        for name, values in columns.items():
            turns = name in TURNING
            lever = facts.length if turns else 1.0
            where = "tip of a stiff arm" if turns else "base"
            speed, acceleration = _fastest(motion, time, values)
            for quantity, size, most, unit in (
                ("acceleration", lever * acceleration, _BASE_ACCELERATION, "m/s2"),
                ("speed", lever * speed, _BASE_SPEED, "m/s"),
            ):
                if size > most:
                    of = f"{quantity} of the {where} = {size:.3g} {unit}"
                    value = f"{shown(getattr(motion, key))} ({of})"
                    yield unusual(f"{found}.{key}", value, f"up to {most:g} {unit}", hint)
                    break


def _course(
    facts: Facts, found: str, motion: Motion
) -> tuple[str, Float[np.ndarray, " point"], dict[str, Float[np.ndarray, " point"]]]:
    """Return the key of a motion to blame, and its points in time (SI) by channel."""
    if isinstance(motion, (FileMotion, VesselMotion)):
        time, values = facts.prepared.series[found].during(facts.scenario.simulation.duration)
        names = motion.moved(facts.scenario.arm.dimension)
        return "file", time, dict(zip(names, values.T, strict=True))
    suffix, none = "_deg" if motion.channel in TURNING else "", np.zeros(0)
    if isinstance(motion, TableMotion):
        value = {motion.channel: np.array(motion.value_si)}
        return f"value{suffix}", np.array(motion.time), value
    key = "frequency_hz" if isinstance(motion, SineMotion) else f"velocity{suffix}"
    return key, none, {motion.channel: none}


def _fastest(
    motion: Motion, time: Float[np.ndarray, " point"], value: Float[np.ndarray, " point"]
) -> tuple[float, float]:
    """Return the largest speed and acceleration of a motion (SI)."""
    if isinstance(motion, SineMotion):
        rate = 2 * math.pi * motion.frequency_hz
        speed = abs(motion.amplitude_si) * rate
        return speed, speed * rate
    if isinstance(motion, VelocityMotion):
        speed = abs(motion.velocity_si)
        return speed, math.pi / 2 * speed / motion.ramp_time
    speeds = np.diff(value) / np.diff(time)
    middles = (time[1:] + time[:-1]) / 2
    acceleration = np.abs(np.diff(speeds) / np.diff(middles)).max(initial=0.0)
    return float(np.abs(speeds).max()), float(acceleration)


@check(
    "load", limit="loads of packages: force times L^2 / EI up to 1000, moment times L / EI up to 20"
)
def _sum_of_foreign_loads(facts: Facts) -> Iterator[str]:
    for name, (push, couple) in facts.sampled[1].items():
        for got, size, most in (
            (f"{push:.3g} N", facts.limpness(float(push), 2), LIMP),
            (f"{couple:.3g} N m", facts.limpness(float(couple), 1), WOUND),
        ):
            if size > most:
                yield (
                    f"load: {name} puts {got} on the arm, {size:.2g} times the scale of EI and "
                    f"length; usual is up to {most:g}. Is it in mN or N mm?"
                )


@check(
    "arm.youngs_modulus",
    "arm.section.EI",
    limit="weight in water times L^3 / EI up to 1000; on an arm that points up, 7.8",
)
def _weight(facts: Facts) -> Iterator[str]:
    section, gravity = facts.scenario.arm.section, facts.scenario.water.gravity
    weight = gravity * float((facts.mass - facts.displaced).mean())
    bending = float(facts.bending.min())
    key, value = "arm.youngs_modulus", f"{facts.scenario.arm.youngs_modulus:g} Pa"
    if section.EI is not None:
        key, value = "arm.section.EI", f"{bending:g} N m2"
    bent = facts.limpness(abs(weight), 3)
    pushed, most = weight * facts.direction[-1], GREENHILL * bending / facts.length**3
    if bent > LIMP:
        value += f" (weight in water times L^3 / EI = {bent:.2g})"
        yield unusual(key, value, f"up to {LIMP:g}", "Is it in kPa or MPa?")
    elif facts.scenario.control.settings.balances:  # which swings up an arm that buckles
        return
    elif pushed > most and facts.scenario.base.mount == "clamped":
        way, force = ("up", "weight") if weight > 0 else ("down", "buoyancy")
        yield (
            f"{key}: got {value}; the arm points {way} and buckles under its {force} of "
            f"{abs(weight):.3g} N/m, to either side: it bears "
            f"{most / abs(facts.direction[-1]):.2g} N/m."
        )


@check("flow", limit="drag of all flows together times L^3 / EI up to 1000")
def _drag(facts: Facts) -> Iterator[str]:
    water = facts.scenario.water
    drag = 0.5 * water.density * water.drag_normal * facts.diameter * facts.current**2
    bent = facts.limpness(drag, 3)
    if bent > LIMP and facts.current < 2 * CURRENT:  # faster water has a note already
        value = f"up to {facts.current:.3g} m/s (drag times L^3 / EI = {bent:.2g})"
        yield unusual("flow", value, f"up to {LIMP:g}", "Is arm.youngs_modulus in kPa or MPa?")


def _time_scales(facts: Facts) -> Iterator[tuple[str, float, float]]:
    """Yield what varies in time: its name, its period (s), and the time steps that resolve it."""
    scenario = facts.scenario
    second = float(facts.frequencies[1])
    yield f"the arm's second bending mode (about {second:.2g} Hz)", 1 / second, 8
    channels = scenario.base.channels.present
    for name in (name for name in scenario.driven if name in channels):
        band = channels[name].bandwidth_hz
        yield f"the servo of {name} ({band:g} Hz)", 1 / band, 4
    for index, motion in enumerate(scenario.base.motion):
        if isinstance(motion, SineMotion):
            yield f"base.motion.{index}", 1 / motion.frequency_hz, 8
    for index, flow in enumerate(scenario.flow):
        name = f"flow.{index}"
        match flow:
            case SineFlow():
                yield name, 1 / flow.frequency_hz, 8
            case GustFlow():
                yield name, flow.duration, 8
            case GaussMarkovFlow():
                yield f"the correlation time of {name}", flow.correlation_time, 3
            case SurfaceWaves():
                yield f"the waves of {name}", flow.wave_period, 16
            case TurbulenceFlow():
                yield f"the passing of an eddy of {name}", flow.length_scale / facts.current, 8
    for table in ("flow", "load", "base.motion"):
        for index, each in enumerate(attrgetter(table)(scenario)):
            if ramp := getattr(each, "ramp_time", 0.0):
                yield f"the ramp of {table}.{index}", ramp, 4
    for index, obstacle in enumerate(scenario.obstacle):
        if hasattr(obstacle, "radius") and obstacle.velocity != "flow":
            speed = math.hypot(*obstacle.velocity)
            size = 2 * obstacle.radius + facts.diameter
            if speed:
                yield f"the passing of obstacle.{index}", size / speed, 4


@check(
    "simulation.time_step",
    limit="8 time steps to the period of the second bending mode, of sines and gusts and to the "
    "passing of an eddy, 16 to the peak period of waves, 4 to a period at a driven servo's "
    "bandwidth, to a ramp and to the passing of an obstacle, 3 to a correlation time",
)
def _time_step(facts: Facts) -> Iterator[str]:
    step = facts.scenario.simulation.time_step
    name, period, steps = min(_time_scales(facts), key=lambda scale: scale[1] / scale[2])
    if step * steps > period:
        value = f"{step:g} s, {period / step:.2g} time steps in {name}, {period:.2g} s"
        hint = f"Use up to {period / steps:.2g} s."
        yield unusual("simulation.time_step", value, f"{steps:g} or more", hint)


@check(
    "simulation.integrator",
    limit="implicit-euler that adds up to 5 % of critical damping to the first vibration",
)
def _integrator(facts: Facts) -> Iterator[str]:
    simulation = facts.scenario.simulation
    ratio = math.pi * simulation.time_step / facts.period
    if simulation.integrator == "implicit-euler" and ratio > _DAMPED:
        step = f"{_DAMPED * facts.period / math.pi:.2g}"
        hint = f"Use simulation.time_step = {step}, or another integrator."
        share = f"the arm's first vibration by {ratio:.0%} of critical"
        value = f'"implicit-euler", which damps {share}'
        yield unusual("simulation.integrator", value, f"up to {_DAMPED:.0%}", hint)


@check("arm.damping_time", limit="0 next to arm.loss_factor")
def _damped_twice(facts: Facts) -> Iterator[str]:
    arm = facts.scenario.arm
    if arm.loss_factor is not None and arm.damping_time > 0:
        more = math.pi * facts.frequencies[0] * arm.damping_time
        asked = arm.loss_factor.value / 2
        hint = f"It adds up to {more:.2g} to the first damping ratio, {asked:.2g} of loss_factor."
        value = f"{arm.damping_time:g} s"
        yield unusual("arm.damping_time", value, "0 next to arm.loss_factor", hint)


BASIC_CHECKS = (_radians, _flow_speed)
CHECKS = (
    *(_base_height, _base_motion, _sum_of_foreign_loads, _weight, _drag),
    *(_time_step, _integrator, _damped_twice),
)
