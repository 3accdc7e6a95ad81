"""Numbers that are plausible or not by themselves: a range for each key."""

import math
from collections.abc import Iterator
from typing import Any

from crinoid.plausibility.facts import Facts
from crinoid.plausibility.rule import Rule, numbers, usual
from crinoid.scenario import shown

_WATER = (600.0, 1400.0)  # oils to brines
_ANGLES = (
    "base.tilt_deg",
    "base.pan_deg",
    "base.roll_deg",
    "base.channels.*.range_deg",
    "base.motion.*.amplitude_deg",
    "base.motion.*.phase_deg",
    "base.motion.*.value_deg",
    "flow.*.phase_deg",
    "flow.*.direction_deg",
    "flow.*.heading_deg",
    "target.angle_deg",
)
_DIRECTIONS = (*_ANGLES[:3], "base.motion.*.phase_deg", *_ANGLES[7:10], "target.phase_deg")
_ROUND = 5.0
"""Angles that people choose are multiples of this (degrees)."""
_OFF = 0.1
"""Degrees by which three digits in radians may miss one."""


def _water(facts: Facts) -> Iterator[str]:
    density = facts.scenario.water.density
    if density == 0 or facts.in_air or _WATER[0] <= density <= _WATER[1]:
        return
    cause = "is it in g/cm3? Air has 1.2" if density < _WATER[0] else "no water is as dense"
    yield f"water.density: got {density:g} kg/m3; water has about 1000; {cause}"


def _radians(facts: Facts) -> Iterator[str]:
    for key in _ANGLES:
        for found, value in numbers(facts.scenario, key):
            largest = max(map(abs, value), default=0.0) if isinstance(value, tuple) else abs(value)
            turn = math.degrees(largest)
            off = abs(turn - _ROUND * round(turn / _ROUND))
            if 0 < largest <= 2 * math.pi + 0.01 and turn > _ROUND / 2 and off < _OFF:
                yield (
                    f"{found}: got {shown(value)} degrees; {largest:g} rad are {turn:.0f} degrees; "
                    "is it in radians?"
                )


def _speeds(facts: Facts) -> Iterator[str]:
    speeds = {f"flow.{index}": speed for index, speed in facts.foreign_speeds.items()}
    for index in facts.prepared.recordings:
        speed = facts.fastest(index, facts.scenario.flow[index])
        speeds[f"flow.{index}.velocity_scale"] = speed
    for key, speed in speeds.items():
        if speed > _CURRENT:
            yield (
                f"{key}: got a flow of up to {speed:.3g} m/s; usual is up to {_CURRENT:g} m/s; is "
                "it in cm/s?"
            )


_CURRENT = 5.0
"""Speed of the fastest tidal currents (m/s)."""
_SPEED: dict[str, Any] = {"above": "is it in cm/s or mm/s?"}

USUAL = (
    usual("arm.length", 0.01, 100, "m", below="is it in km?", above="is it in mm?"),
    usual(
        "arm.density",
        100,
        12e3,
        "kg/m3",
        below="is it in g/cm3?",
        above="that is denser than lead",
    ),
    usual(
        "arm.youngs_modulus",
        1e3,
        1e12,
        "Pa",
        below="is it in kPa, MPa or GPa?",
        above="no material is as stiff",
    ),
    Rule(("water.density",), "0, air (1.1 to 1.4) or 600 to 1400 kg/m3", _water),
    usual("water.kinematic_viscosity", 1e-7, 1e-2, "m2/s", above="is it in mm2/s (cSt)?"),
    usual("water.drag_normal", 0.1, 5, "", below="a cylinder has about 1", above="it has about 1"),
    usual("water.drag_tangential", 0, 0.5, "", above="a smooth arm has about 0.01"),
    usual("water.added_mass_normal", 0.1, 5, "", below="a cylinder has 1", above="it has 1"),
    usual("water.added_mass_tangential", 0, 2, "", above="a slender arm has hardly any"),
    usual("water.gravity", 1.5, 30, "m/s2", below="is it in g?", above="is it in cm/s2?"),
    usual("water.depth", 0.1, 11e3, "m", below="is it in km?", above="no sea is as deep"),
    Rule(_ANGLES, "no multiple of 5 degrees written in radians", _radians),
    *(usual(key, 0, 360, "degrees", above="a full turn has 360") for key in _DIRECTIONS),
    usual("base.channels.*.range_deg", 0, 1e3, "degrees", above="a full turn has 360"),
    usual("base.channels.*.max_speed", 1e-3, 10, "m/s", above="is it in mm/s?"),
    usual("base.channels.*.max_acceleration", 1e-3, 100, "m/s2", above="is it in mm/s2?"),
    usual("base.channels.*.max_speed_deg", 4, 5e3, "degrees/s", below="is it in rad/s?"),
    usual("base.channels.*.max_acceleration_deg", 15, 1e6, "degrees/s2", below="is it in rad/s2?"),
    usual("base.channels.*.bandwidth_hz", 0.05, 500, "Hz"),
    usual("flow.*.velocity", 0, _CURRENT, "m/s", **_SPEED),
    usual("flow.*.mean", 0, _CURRENT, "m/s", **_SPEED),
    usual("flow.*.amplitude", 0, _CURRENT, "m/s", **_SPEED),
    usual("flow.*.standard_deviation", 0, 2, "m/s", **_SPEED),
    Rule(("flow.*.velocity_scale",), "a record, or a flow of a package, up to 5 m/s", _speeds),
    usual("flow.*.time_scale", 0.01, 100, "", below="is it upside down?", above="upside down?"),
    usual("flow.*.length_scale", 0.01, 1e3, "m", below="is it in km?", above="is it in mm?"),
    usual("flow.*.significant_height", 0.005, 20, "m", above="is it in cm?"),
    usual("flow.*.peak_period", 0.3, 30, "s", below="is it the frequency?", above="is it in ms?"),
    usual("flow.*.exponent", 0, 1, "", above="a power law has about 1/7"),
    usual("flow.*.roughness_length", 0, 1, "m", above="is it in mm?"),
    usual("obstacle.*.velocity", 0, 5, "m/s", **_SPEED),
    usual("obstacle.*.friction", 0, 1.5, "", above="rubber on rock has about 1"),
    usual("tool.drag_area", 0, 10, "m2", above="is it in cm2?"),
    usual("tool.added_mass", 0, 1e3, "kg", above="is it in g?"),
    usual("chamber.*.time_constant", 0, 100, "s", above="is it in ms?"),
    usual("tendon.*.time_constant", 0, 100, "s", above="is it in ms?"),
    usual("chamber.*.stiffening", 0, 100, "", above="is it in percent?"),
    usual("sensor.resolution_position", 0, 0.1, "m", above="is it in mm?"),
    usual("sensor.resolution_angle_deg", 0, 30, "degrees"),
    usual("simulation.tolerance", 1e-13, 1e-4, "", below="round-off is larger", above="too loose"),
    usual(
        "simulation.max_iterations", 5, 1e3, "", below="a step takes about 3, more where it is hard"
    ),
)
