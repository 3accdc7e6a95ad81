"""Where the base is and how it moves."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from jaxtyping import Float

from crinoid.plausibility.facts import Facts
from crinoid.plausibility.rule import Rule
from crinoid.scenario import shown
from crinoid.scenario.motion import FileMotion, SineMotion, TableMotion, VelocityMotion
from crinoid.scenario.obstacle import Plane
from crinoid.space import ANGLES

_LONG, _TINY = 10.0, 1e-3
"""Travel of a channel over the length of the arm."""
_SPEED = 5.0
_ACCELERATION = 20.0
"""Acceleration of the base, or of the tip of a stiff arm that it turns (m/s2): two g."""
_NARROW = 2.0
"""Travel of a channel that turns below which its limits may be in radians (degrees)."""


def _height(facts: Facts) -> Iterator[str]:
    base, depth = facts.scenario.base, facts.scenario.water.depth
    if not facts.wet:
        return
    last = len(base.position) - 1
    height = base.position[last]
    tip = height + facts.length * facts.direction[-1]
    got = f"base.position.{last}: got {height:g} m"
    if height > 0:
        yield f"{got}, above the water: its surface is at z = 0, and z is up; is the sign right?"
    elif height < 0 < tip:
        yield (
            f"{got}; the arm reaches up to z = {tip:.3g} m, out of the water, whose surface is at "
            "z = 0; what is above it is computed as if it were in water"
        )
    bed = any(isinstance(obstacle, Plane) for obstacle in facts.scenario.obstacle)
    if depth is not None and tip < -depth <= height and not bed:
        yield (
            f"{got}; the arm reaches down to z = {tip:.3g} m, through the bed at "
            f"z = {-depth:g} m (water.depth), which nothing keeps it from: an [[obstacle]] of kind "
            "plane does"
        )


def _range(facts: Facts) -> Iterator[str]:
    for name, channel in facts.scenario.base.channels.present.items():
        travel = channel.limits.high - channel.limits.low
        if name in ANGLES:
            if math.degrees(travel) < _NARROW:
                yield (
                    f"base.channels.{name}.range_deg: got a travel of {math.degrees(travel):.3g} "
                    "degrees, which hardly moves an arm; is it in radians?"
                )
        elif travel > _LONG * facts.length:
            yield (
                f"base.channels.{name}.range: got a travel of {travel:g} m, more than "
                f"{_LONG:g} lengths of the arm; is it in mm?"
            )
        elif travel < _TINY * facts.length:
            yield (
                f"base.channels.{name}.range: got a travel of {travel:g} m, less than "
                f"{_TINY:g} of the arm's length; is it in km?"
            )


def _motion(facts: Facts) -> Iterator[str]:
    for index, motion in enumerate(facts.scenario.base.motion):
        lever = facts.length if motion.channel in ANGLES else 1.0
        key = f"base.motion.{index}"
        if isinstance(motion, SineMotion):
            rate = 2 * math.pi * motion.frequency_hz
            speed = abs(motion.amplitude_si) * rate * lever
            hard = speed * rate
            got = f"{key}.frequency_hz: got {motion.frequency_hz:g} Hz with this amplitude"
        elif isinstance(motion, TableMotion):
            speed, hard = _fastest(np.array(motion.time), lever * np.array(motion.value_si))
            value = "value_deg" if motion.channel in ANGLES else "value"
            got = f"{key}.{value}: got {shown(getattr(motion, value))}"
        elif isinstance(motion, VelocityMotion):
            speed = abs(motion.velocity_si) * lever
            hard = math.pi / 2 * speed / motion.ramp_time
            value = "velocity_deg" if motion.channel in ANGLES else "velocity"
            got = f"{key}.{value}: got {getattr(motion, value):g}"
        elif isinstance(motion, FileMotion):
            time, values = facts.prepared.series[key].during(facts.scenario.simulation.duration)
            speed, hard = _fastest(time, lever * values[:, 0])
            got = f"{key}.file: got {shown(motion.file)}"
        where = "the base" if lever == 1.0 else "the tip of a stiff arm"
        if hard > _ACCELERATION:
            yield (
                f"{got}, which shakes {where} with {hard:.3g} m/s2; usual is up to "
                f"{_ACCELERATION:g} m/s2, two g; are amplitude and times in m (degrees) and s?"
            )
        elif speed > _SPEED:
            yield (
                f"{got}, which moves {where} at {speed:.3g} m/s; usual is up to {_SPEED:g} m/s; "
                "are amplitude and times in m (degrees) and s?"
            )


def _fastest(
    time: Float[np.ndarray, " time"], value: Float[np.ndarray, " time"]
) -> tuple[float, float]:
    """Return the largest speed and acceleration along a path through points."""
    speeds = np.diff(value) / np.diff(time)
    middles = (time[1:] + time[:-1]) / 2
    hard = np.abs(np.diff(speeds) / np.diff(middles)).max(initial=0.0)
    return float(np.abs(speeds).max()), float(hard)


BASE = (
    Rule(
        ("base.position",),
        "base and straight arm below the surface at z = 0 and, without a plane, above the bed",
        _height,
    ),
    Rule(
        ("base.channels.*.range", "base.channels.*.range_deg"),
        "a travel of 1e-3 to 10 lengths of the arm; of 2 degrees or more",
        _range,
    ),
    Rule(
        ("base.motion.*",),
        "up to 5 m/s and 20 m/s2, of the base or of the tip of a stiff arm that it turns",
        _motion,
    ),
)
