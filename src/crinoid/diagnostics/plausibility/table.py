"""Usual ranges of the numbers of a scenario: one row each."""

from __future__ import annotations

import math
from typing import Any

from crinoid.assembly.facts import Facts
from crinoid.diagnostics.plausibility.rule import range_rule
from crinoid.scenario import SurfaceWaves, TurbulenceFlow

INF = math.inf
LIMP = 500.0
"""Largest force times length squared over EI; of a force per length, times length cubed."""
IN_AIR = "The troughs leave the arm in the air, which is computed as water."
_WAVES = "flow.*.significant_height, flow.*.height"
_STARTS = (
    "flow.*.start, load.*.start, tool.from, chamber.*.schedule.time, tendon.*.schedule.time, "
    "target.time, target.start, control.start, sensor.delay, sensors.*.delay"
)


def _density(facts: Facts, *_: Any) -> float | None:
    water = facts.scenario.water.density
    round_area = math.pi * (facts.diameter / 2) ** 2
    area = float(facts.displaced.max()) / water if water else round_area
    return float(facts.mass.max()) / area if area else None


def breaking_height(facts: Facts, period: float) -> float:
    """Return the height at which waves break (m): Miche (1944) in deep water, else by depth."""
    water, depth = facts.scenario.water, facts.scenario.water.depth
    deep = 0.14 * water.gravity * period**2 / (2 * math.pi)
    return min(deep, INF if depth is None else 0.6 * depth)


def _breaking(facts: Facts, height: Any, flow: Any) -> float | None:
    if not isinstance(flow, SurfaceWaves) or flow.state is None:
        return None
    return float(height / breaking_height(facts, flow.state.period))


def arm_depth(facts: Facts) -> float:
    """Return the depth of the highest point of a straight arm (m)."""
    root = facts.scenario.base.position[-1]
    return -max(root, root + facts.length * float(facts.direction[-1]))


def _below_troughs(facts: Facts, height: Any, flow: Any) -> float | None:
    depth = arm_depth(facts)
    return float(depth - height) if isinstance(flow, SurfaceWaves) and depth >= 0 else None


def _time_left(facts: Facts, value: Any, _: Any) -> float:
    start = value[0] if isinstance(value, tuple) else value
    return facts.scenario.simulation.duration - float(start)


def _tool_weight(facts: Facts, mass: Any, tool: Any) -> float:
    water = facts.scenario.water
    return facts.limpness(abs(mass - water.density * tool.volume) * water.gravity, 2)


def _over_length(facts: Facts, value: Any, _: Any) -> float:
    return float(value / facts.length)


# fmt: off
RANGES = (
    range_rule("arm.length", 0.01, 100.0, "m", below="Is it in km?", above="Is it in mm?"),
    # a rod theory without shear is right within some percent up to a tenth of the length
    range_rule("arm.radius", 1e-4, 0.1, "m", quantity="radius / length",
               of=lambda facts, *_: max(facts.radii) / facts.length,
               below="Is arm.length in mm?", above="Is it in mm?"),
    range_rule("arm.density", 100.0, 12e3, "kg/m3", below="Is it in g/cm3?",
               above="That is denser than lead."),
    range_rule("arm.section.mass_per_length, arm.section.displaced_area", 100.0, 12e3,
               quantity="density of the arm", quantity_unit="kg/m3", of=_density,
               below="Is it in t or mm?", above="Is it in g or km?"),
    range_rule("arm.section.diameter", 0.1, 10.0, "m", quantity="diameter / 2 arm.radius",
               of=lambda facts, value, _: value / (2 * max(facts.radii)) if value else None,
               below="Is it in km?", above="Is it in mm?"),
    range_rule("arm.youngs_modulus", 1e3, 1e12, "Pa", below="Is it in kPa, MPa or GPa?",
               above="No material is as stiff."),
    range_rule("water.density", 600.0, 1400.0, "kg/m3", quantity="density outside of air",
               quantity_unit="kg/m3", limit="0, air (1.1 to 1.4) or 600 to 1400 kg/m3",
               of=lambda facts, value, _: value if facts.wet else None,
               below="Is it in g/cm3? Air has 1.2.", above="No water is as dense."),
    range_rule("water.kinematic_viscosity", 1e-7, 1e-2, "m2/s", above="Is it in mm2/s (cSt)?"),
    range_rule("water.gravity", 1.5, 30.0, "m/s2", below="Is it in g?", above="Is it in cm/s2?"),
    range_rule("base.channels.*.range", 0.01, 10.0, "m", quantity="travel / arm.length",
               of=lambda facts, value, _: (value[1] - value[0]) / facts.length,
               below="Is it in km?", above="Is it in mm?"),
    range_rule("base.channels.*.range_deg", 2.0, INF, "degrees", quantity="travel",
               quantity_unit="degrees", of=lambda facts, value, _: value[1] - value[0],
               below="That hardly moves an arm. Is it in radians?"),
    range_rule("base.channels.*.max_speed", 3e-3, 10.0, "m/s", above="Is it in mm/s?"),
    range_rule("base.channels.*.max_acceleration", 0.01, 100.0, "m/s2", above="Is it in mm/s2?"),
    range_rule("base.channels.*.max_speed_deg", 4.0, 5e3, "degrees/s", below="Is it in rad/s?"),
    range_rule("base.channels.*.max_acceleration_deg", 15.0, 1e6, "degrees/s2",
               below="Is it in rad/s2?"),
    range_rule("flow.*.length_scale", 2.0, 5e3, "m", quantity="length_scale / diameter",
               of=lambda facts, value, flow: value / facts.diameter
               if isinstance(flow, TurbulenceFlow) and facts.diameter else None,
               below="Drag assumes water that is the same across the arm.", above="Is it in mm?"),
    range_rule("flow.*.peak_period, flow.*.period", 0.3, 30.0, "s", below="Is it the frequency?",
               above="Is it in ms?"),
    range_rule(_WAVES, 0.0, 1.0, "m", quantity="height / that of breaking waves", of=_breaking,
               above="Such waves break."),
    range_rule(_WAVES, 0.0, INF, "m", quantity="depth of the arm below troughs",
               quantity_unit="m", of=_below_troughs,
               below=IN_AIR),
    range_rule("flow.*.speed", 0.3, 1.0, "m/s", quantity="speed / sqrt(g length)",
               of=lambda facts, value, ship: value
               / (facts.scenario.water.gravity * ship.length) ** 0.5,
               below="Its waves are several times too high.", above="Is it in km/h or knots?"),
    range_rule("flow.*.beam", 0.0, 0.25, "m", quantity="beam / length",
               of=lambda facts, value, flow: value / flow.length,
               above="The theory is that of a thin ship; its waves are too high."),
    range_rule("flow.*.distance", 0.5, INF, "m", quantity="distance / length",
               of=lambda facts, value, ship: abs(value) / ship.length,
               below="The flow of the hull itself is left out."),
    range_rule("flow.*.time", 0.0, INF, "s", quantity="time left when the wake arrives",
               quantity_unit="s", limit="before the end of the run",
               of=lambda facts, value, ship: facts.scenario.simulation.duration - value
               - 8**0.5 * abs(ship.distance) / ship.speed,
               below="The waves of the ship do not arrive in time."),
    range_rule(_STARTS, math.ulp(0.0), INF, "s", quantity="time left in the run",
               quantity_unit="s", of=_time_left, limit="before the end of the run",
               below="It never starts. Is it in ms?"),
    range_rule("tool.mass", 0.0, LIMP, "kg", quantity="weight in water times L^2 / EI",
               of=_tool_weight, above="Is it in g, or arm.youngs_modulus in kPa or MPa?"),
    range_rule("tool.offset, tool.radius", 0.0, 3.0, "m", quantity="size / arm.length",
               of=_over_length, above="Is it in mm?"),
    range_rule("vehicle.mass", 0.5, INF, "kg", quantity="mass / that of the arm",
               of=lambda facts, value, _: value / (float(facts.mass.mean()) * facts.length),
               below="Is it in t?"),
    range_rule("vehicle.volume", 0.8, 1.25, "m3", quantity="mass / that of the water displaced",
               of=lambda facts, value, vehicle: vehicle.mass
               / (facts.scenario.water.density * value) if facts.wet else None,
               below="The vehicle rises. Is it in litres?",
               above="The vehicle sinks. Is it in litres?"),
    range_rule("vehicle.inertia", 0.02, 20.0, "kg m2", quantity="radius of gyration",
               quantity_unit="m", below="Is it in t m2?", above="Is it in kg cm2?",
               of=lambda facts, value, vehicle: [
                   (moment / vehicle.mass) ** 0.5
                   for moment in (value if isinstance(value, tuple) else (value,))]),
    range_rule("obstacle.*.mass", 20.0, 12e3, "kg", quantity="density", quantity_unit="kg/m3",
               of=lambda facts, value, body: value / body.volume,
               below="Is it in t?", above="Is it in g?"),
    range_rule("sensor.noise_position", 0.0, 0.05, "m", quantity="noise / arm.length",
               of=_over_length, above="Is it in mm?"),
    range_rule("sensor.delay", 0.0, 1.0, "s", quantity="delay / first period",
               of=lambda facts, value, _: value / facts.period
               if value and facts.scenario.control.acts else None,
               above="Is it in ms?"),
    range_rule("arm.damping_time", 0.0, 1.0, "s", quantity="damping_time / first period",
               of=lambda facts, value, _: value / facts.period,
               above="The arm creeps back instead of swinging. Is it in ms?"),
)
"""Ranges of single numbers, and of those next to the arm's size, stiffness and period."""
# fmt: on
