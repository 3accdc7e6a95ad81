"""Usual ranges of the numbers of a scenario: one row each."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from crinoid.assembly.facts import Facts
from crinoid.diagnostics.plausibility.rule import Rule, magnitude, range_rule, start_rule
from crinoid.diagnostics.plausibility.waves import wave_rules
from crinoid.scenario import DistributedLoad, GaussMarkovFlow, TipLoad, TurbulenceFlow

INF = math.inf
CURRENT = 5.0
"""Speed of the fastest tidal currents (m/s)."""
LIMP = 1000.0
"""Largest force times length squared over EI; of a force per length, times length cubed."""
WOUND = 20.0
"""Largest moment times length over EI: three turns."""
GREENHILL = 7.837
"""Force per length over EI / length^3 at which a cantilever buckles (Greenhill 1881)."""
_EULER = math.pi**2 / 4
"""Force over EI / length^2 at which a cantilever buckles."""
_BECK = 20.05
"""Force that follows the tip, over EI / length^2, under which it flutters (Beck 1952)."""
ANGLES = (
    *("base.tilt_deg", "base.pan_deg", "base.roll_deg", "base.channels.*.range_deg"),
    *("base.motion.*.amplitude_deg", "base.motion.*.phase_deg", "base.motion.*.value_deg"),
    *("flow.*.phase_deg", "flow.*.direction_deg", "flow.*.heading_deg", "target.angle_deg"),
)
_DIRECTIONS = (*ANGLES[:3], "base.motion.*.phase_deg", *ANGLES[7:10], "target.phase_deg")
_SPEED: dict[str, Any] = {"above": "Is it in cm/s or mm/s?"}
_KPA = "or arm.youngs_modulus in kPa or MPa?"


def _bend(curvature: Any) -> tuple[float, float]:
    """Return the bending and the twist of a curvature at rest (1/m)."""
    if isinstance(curvature, tuple):
        return math.hypot(*curvature[:2]), curvature[2]
    return abs(curvature), 0.0


def _section_rules(name: str, unit: str) -> tuple[Rule, Rule]:
    """Return the rules that EI and EA are those of one section; EA is judged without EI only."""

    def over(facts: Facts, section: Any, length: float) -> float | None:
        if name == "EA" and section.EI is not None:
            return None
        return 2 * math.sqrt(float(facts.bending.max()) / facts.stretching) / length

    # fmt: off
    return (
        range_rule(f"arm.section.{name}", 0.0, 0.1, unit, quantity="2 sqrt(EI / EA) / arm.length",
                   of=lambda facts, _, section: over(facts, section, facts.length),
                   above="Such an arm stretches before it bends."),
        range_rule(f"arm.section.{name}", 0.01, INF, unit, below="Is it in N mm2?",
                   of=lambda facts, _, section: over(facts, section, max(facts.radii)),
                   quantity="2 sqrt(EI / EA) / arm.radius"),
    )
    # fmt: on


def _density(facts: Facts, mass_per_length: Any, _: Any) -> float | None:
    density = facts.scenario.water.density
    area = float(max(facts.displaced)) / density if density else facts.round_area
    return mass_per_length / area if area else None


def _half_strength(facts: Facts, ramp_time: Any, table: Any) -> float | None:
    """Return the time from half the strength to the end of a run (s)."""
    duration = facts.scenario.simulation.duration
    return None if table.start >= duration else duration - (table.start + 0.5 * ramp_time)


def _load(
    key: str, unit: str, quantity: str, high: float, of: Callable[[Facts, float], float]
) -> Rule:
    """Return the rule that a load does not bend or stretch the arm beyond reason."""
    kind = DistributedLoad if key.endswith("magnitude") else TipLoad
    above = "Is it in N mm?" if unit == "N m" else f"Is it in m{unit}, {_KPA}"

    def size(facts: Facts, value: Any, load: Any) -> float | None:
        return of(facts, magnitude(value)) if isinstance(load, kind) else None

    return range_rule(key, 0.0, high, unit, quantity=quantity, of=size, above=above)


def _push(facts: Facts, _: Any, load: Any) -> float | None:
    """Return the push toward the root over that which buckles a cantilever, 0 for a pull."""
    bending, along = float(facts.bending.min()), np.array(facts.direction)
    if facts.scenario.base.mount != "clamped":
        return None
    if isinstance(load, TipLoad):
        push = -(load.force[0] if load.follower else float(along @ load.force))
        most = (_BECK if load.follower else _EULER) * bending / facts.length**2
    elif isinstance(load, DistributedLoad) and isinstance(load.direction, tuple):
        way = np.array(load.direction) / math.hypot(*load.direction)
        push, most = -load.magnitude * float(along @ way), GREENHILL * bending / facts.length**3
    else:
        return None
    return max(0.0, push / most)


def _largest(value: Any) -> float:
    return float(max(value) if isinstance(value, tuple) else value)


def _tool_weight(facts: Facts, mass: Any, tool: Any) -> float:
    water = facts.scenario.water
    return facts.limpness(abs(mass - water.density * tool.volume) * water.gravity, 2)


def _offset(facts: Facts, offset: Any, thread: Any) -> float | None:
    if not facts.diameter or getattr(thread, "area", 1.0) is None:  # of no route
        return None
    return _largest(offset) / (facts.diameter / 2)


def _filter(facts: Facts, cutoff: Any, gains: Any) -> float | None:
    control, rate = facts.scenario.control, facts.scenario.control_rate_hz
    judged = control.gains and gains.kd and (control.rate_hz or rate == 100)
    return 2 * cutoff / rate if judged else None


# fmt: off
BASIC = (
    range_rule("arm.length", 0.01, 100.0, "m", below="Is it in km?", above="Is it in mm?"),
    range_rule("arm.density", 100.0, 12e3, "kg/m3", below="Is it in g/cm3?",
               above="That is denser than lead."),
    range_rule("arm.youngs_modulus", 1e3, 1e12, "Pa", below="Is it in kPa, MPa or GPa?",
               above="No material is as stiff."),
    range_rule("water.density", 600.0, 1400.0, "kg/m3", quantity="density outside of air",
               quantity_unit="kg/m3", limit="0, air (1.1 to 1.4) or 600 to 1400 kg/m3",
               of=lambda facts, value, _: None if facts.in_air or not value else value,
               below="Is it in g/cm3? Air has 1.2.", above="No water is as dense."),
    range_rule("water.kinematic_viscosity", 1e-7, 1e-2, "m2/s", above="Is it in mm2/s (cSt)?"),
    range_rule("water.drag_normal", 0.1, 5.0, below="A cylinder has about 1.",
               above="A cylinder has about 1."),
    range_rule("water.drag_tangential", 0.0, 0.5, above="A smooth arm has about 0.01."),
    range_rule("water.added_mass_normal", 0.1, 5.0, below="A cylinder has 1.",
               above="A cylinder has 1."),
    range_rule("water.added_mass_tangential", 0.0, 2.0, above="A slender arm has hardly any."),
    range_rule("water.gravity", 1.5, 30.0, "m/s2", below="Is it in g?", above="Is it in cm/s2?"),
    range_rule("water.depth", 0.1, 11e3, "m", below="Is it in km?", above="No sea is as deep."),
    *(range_rule(key, 0.0, 360.0, "degrees", above="A full turn has 360.") for key in _DIRECTIONS),
    range_rule("base.channels.*.range_deg", 0.0, 1e3, "degrees", above="A full turn has 360."),
    range_rule("base.channels.*.max_speed", 1e-3, 10.0, "m/s", above="Is it in mm/s?"),
    range_rule("base.channels.*.max_acceleration", 1e-3, 100.0, "m/s2", above="Is it in mm/s2?"),
    range_rule("base.channels.*.max_speed_deg", 4.0, 5e3, "degrees/s", below="Is it in rad/s?"),
    range_rule("base.channels.*.max_acceleration_deg", 15.0, 1e6, "degrees/s2",
               below="Is it in rad/s2?"),
    range_rule("base.channels.*.bandwidth_hz", 0.05, 500.0, "Hz"),
    range_rule("flow.*.velocity", 0.0, CURRENT, "m/s", **_SPEED),
    range_rule("flow.*.mean", 0.0, CURRENT, "m/s", **_SPEED),
    range_rule("flow.*.amplitude", 0.0, CURRENT, "m/s", **_SPEED),
    range_rule("flow.*.standard_deviation", 0.0, 2.0, "m/s", **_SPEED),
    range_rule("flow.*.time_scale", 0.01, 100.0, below="Is it upside down?",
               above="Is it upside down?"),
    range_rule("flow.*.length_scale", 0.01, 1e3, "m", below="Is it in km?", above="Is it in mm?"),
    *(range_rule(f"flow.*.{key}", 0.005, 20.0, "m", above="Is it in cm?")
      for key in ("significant_height", "height")),
    *(range_rule(f"flow.*.{key}", 0.3, 30.0, "s", below="Is it the frequency?",
                 above="Is it in ms?") for key in ("peak_period", "period")),
    range_rule("flow.*.exponent", 0.0, 1.0, above="A power law has about 1/7."),
    range_rule("flow.*.roughness_length", 0.0, 1.0, "m", above="Is it in mm?"),
    range_rule("obstacle.*.velocity", 0.0, 5.0, "m/s", **_SPEED),
    range_rule("obstacle.*.friction", 0.0, 1.5, above="Rubber on rock has about 1."),
    *(range_rule(f"obstacle.*.{kind}_friction", 0.0, 0.1, "m", above="Is it in mm?")
      for kind in ("rolling", "spinning")),
    range_rule("tool.drag_area", 0.0, 10.0, "m2", above="Is it in cm2?"),
    range_rule("tool.added_mass", 0.0, 1e3, "kg", above="Is it in g?"),
    range_rule("chamber.*.time_constant", 0.0, 100.0, "s", above="Is it in ms?"),
    range_rule("tendon.*.time_constant", 0.0, 100.0, "s", above="Is it in ms?"),
    range_rule("chamber.*.stiffening", 0.0, 100.0, above="Is it in percent?"),
    range_rule("sensor.resolution_position", 0.0, 0.1, "m", above="Is it in mm?"),
    range_rule("sensor.resolution_angle_deg", 0.0, 30.0, "degrees"),
    range_rule("simulation.tolerance", 1e-13, 1e-4, below="Round-off is larger.",
               above="It is too loose."),
    range_rule("simulation.time_step", 0.0, 1e6, "s", quantity="time steps in the run",
               of=lambda facts, _, simulation: simulation.steps, above="Use a larger one."),
    range_rule("simulation.max_iterations", 5.0, 1e3,
               below="A step needs about 3, more where it is hard to solve."),

    # a rod theory without shear is right within some percent up to a tenth of the length
    range_rule("arm.radius", 1e-4, 0.1, "m", quantity="radius / length",
               of=lambda facts, value, _: max(facts.radii) / facts.length,
               below="Is arm.length in mm?", above="Is it in mm?"),
    range_rule("arm.radius", 0.0, 2.0, "m", quantity="radius of the tip / that of the root",
               of=lambda facts, value, _: facts.radii[1] / facts.radii[0],
               above="Is it [root, tip]?"),
    range_rule("arm.nodes", 5.0, INF,
               below="So few edges bend at one or two places only. Use about 20."),
    range_rule("arm.nodes", 0.25, INF, quantity="edge / radius",
               of=lambda facts, value, _: facts.edge / min(facts.radii)
               if 0.25 * min(facts.radii) < 0.1 * facts.length else None,
               below="Shorter edges cost time and show nothing that a rod has. Use fewer."),
    range_rule("arm.rest_curvature", 0.0, 0.3, "1/m", quantity="curvature times radius",
               of=lambda facts, value, _: _bend(value)[0] * max(facts.radii),
               above="Is it in degrees/m?"),
    range_rule("arm.rest_curvature", 0.0, 10.0, "1/m", quantity="turns of the arm",
               of=lambda facts, value, _: facts.length * math.hypot(*_bend(value)) / (2 * math.pi),
               above="Is it in degrees/m?"),
    range_rule("arm.rest_curvature", 0.0, 30.0, "1/m", quantity="turn from edge to edge",
               quantity_unit="degrees", above="Raise arm.nodes.",
               of=lambda facts, value, _: math.degrees(_bend(value)[0] * facts.edge)),
    *_section_rules("EI", "N m2"),
    *_section_rules("EA", "N"),
    range_rule("arm.section.GJ", 0.0, 3.0, "N m2", quantity="GJ / EI",
               of=lambda facts, value, _: np.max(value) / facts.bending.max(),
               above="A round section has 2/3 to 1."),
    range_rule("arm.section.diameter", 0.1, 10.0, "m", quantity="diameter / 2 arm.radius",
               of=lambda facts, value, _: value / (2 * max(facts.radii)) if value else None,
               below="Is it in km?", above="Is it in mm?"),
    range_rule("arm.section.displaced_area", 0.1, 10.0, "m2",
               quantity="area / that of the diameter",
               of=lambda facts, value, _: value / facts.round_area
               if value and facts.round_area else None, below="Is it in km2?",
               above="Is it in cm2?"),
    range_rule("arm.section.mass_per_length", 100.0, 12e3, "kg/m", quantity="density",
               quantity_unit="kg/m3", of=_density, below="Is it in t/m?", above="Is it in g/m?"),
)
"""Ranges of single numbers, and the proportions of the arm."""

DERIVED = (
    range_rule("arm.damping_time", 0.0, 1.0, "s", quantity="damping_time / first period",
               of=lambda facts, value, _: value / facts.period,
               above="The arm creeps back instead of swinging. Is it in ms?"),
    range_rule("water.linear_drag", 0.0, 10.0, "N s/m2", above="Is that water?",
               of=lambda facts, drag, _: drag * facts.period
               / (4 * math.pi * float(facts.swung.mean())),
               quantity="damping ratio of the first vibration"),
    range_rule("base.channels.*.range", 1e-3, 10.0, "m", quantity="travel / arm.length",
               of=lambda facts, value, _: (value[1] - value[0]) / facts.length,
               below="Is it in km?", above="Is it in mm?"),
    range_rule("base.channels.*.range_deg", 2.0, INF, "degrees", quantity="travel",
               quantity_unit="degrees", of=lambda facts, value, _: value[1] - value[0],
               below="That hardly moves an arm. Is it in radians?"),
    # eddies below this are not the same all across the arm, as its drag assumes
    range_rule("flow.*.length_scale", 2.0, INF, "m", quantity="length_scale / diameter",
               of=lambda facts, value, flow: value / facts.diameter
               if isinstance(flow, TurbulenceFlow) and facts.diameter else None,
               below="Drag assumes water that is the same across the arm."),
    *wave_rules("significant_height"),
    *wave_rules("height"),
    range_rule("flow.*.correlation_time", 0.0, 10.0, "s", quantity="correlation_time / duration",
               of=lambda facts, value, flow: value / facts.scenario.simulation.duration
               if isinstance(flow, GaussMarkovFlow) else None,
               above="The flow hardly varies in the run. Is it in ms?"),
    *(start_rule(f"{table}.*.start") for table in ("flow", "load")),
    *(range_rule(f"{table}.*.ramp_time", 0.0, INF, "s", quantity="time left at half the strength",
                 quantity_unit="s", of=_half_strength,
                 below="The run ends earlier. Is it in ms?")
      for table in ("flow", "load")),
    _load("load.*.force", "N", "force / EA", 0.3,
          lambda facts, force: force / facts.stretching),
    _load("load.*.force", "N", "force times L^2 / EI", LIMP,
          lambda facts, force: facts.limpness(force, 2)),
    _load("load.*.moment", "N m", "moment times L / EI", WOUND,
          lambda facts, moment: facts.limpness(moment, 1)),
    _load("load.*.magnitude", "N/m", "magnitude times L / EA", 0.3,
          lambda facts, line: line * facts.length / facts.stretching),
    _load("load.*.magnitude", "N/m", "magnitude times L^3 / EI", LIMP,
          lambda facts, line: facts.limpness(line, 3)),
    *(range_rule(key, 0.0, 1.0, unit, quantity="push toward the root / buckling load", of=_push,
                 above="The arm buckles or flutters, to either side.")
      for key, unit in (("load.*.force", "N"), ("load.*.magnitude", "N/m"))),
    range_rule("tool.mass", 0.0, LIMP, "kg", quantity="weight in water times L^2 / EI",
               of=_tool_weight, above=f"Is it in g, {_KPA}"),
    range_rule("tool.volume", 20.0, 22e3, "m3", quantity="density", quantity_unit="kg/m3",
               of=lambda facts, value, tool: tool.mass / value if value else None,
               below="Is it in litres or cm3?", above="Is it in km3?"),
    range_rule("tool.offset", 0.0, 3.0, "m", quantity="offset / arm.length",
               of=lambda facts, value, _: value / facts.length, above="Is it in mm?"),
    range_rule("tool.radius", 0.0, 3.0, "m", quantity="radius / arm.length",
               of=lambda facts, value, _: value / facts.length, above="Is it in mm?"),
    range_rule("tool.inertia", 0.0, 3.0, "kg m2", quantity="radius of gyration / arm.length",
               of=lambda facts, value, tool: (_largest(value) / tool.mass) ** 0.5 / facts.length,
               above="Is it in kg cm2?"),
    start_rule("tool.from", "The tool is never taken up."),
    *(range_rule(f"{table}.*.offset", 0.0, 1.0, "m",
                 quantity="offset / radius of the arm", of=_offset,
                 above="Is it in mm?") for table in ("chamber", "tendon")),
    *(start_rule(f"{table}.*.schedule.time", "Is it in ms?") for table in ("chamber", "tendon")),
    start_rule("sensors.*.delay", "Its readings never arrive. Is it in ms?"),
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
    range_rule("obstacle.*.radius", 0.0, 100.0, "m", quantity="radius / arm.length",
               of=lambda facts, value, _: value / facts.length,
               above="That is a wall. Is it in mm?"),
    range_rule("obstacle.*.radius", 0.02, INF, "m", quantity="radius / that of the arm",
               of=lambda facts, value, _: value / (facts.diameter / 2) if facts.diameter else None,
               below="That is a wire. Is it in km?"),
    range_rule("obstacle.*.mass", 20.0, 12e3, "kg", quantity="density", quantity_unit="kg/m3",
               of=lambda facts, value, body: value / body.volume,
               below="Is it in t?", above="Is it in g?"),
    start_rule("target.time.0", "The target never moves."),
    start_rule("target.start", "The path never starts."),
    start_rule("control.start", "The controller is never switched on.", controlled=True),
    start_rule("sensor.delay", "The controller gets no reading. Is it in ms?", controlled=True),
    range_rule("sensor.delay", 0.0, 1.0, "s", quantity="delay / first period",
               of=lambda facts, value, _: value / facts.period
               if value and facts.scenario.control.acts else None,
               above="Is it in ms?"),
    range_rule("sensor.noise_position", 0.0, 0.05, "m", quantity="noise / arm.length",
               of=lambda facts, value, _: value / facts.length, above="Is it in mm?"),
    range_rule("sensor.noise_angle_deg", 0.0, 20.0, "degrees"),
    range_rule("control.pid.*.derivative_filter_hz", 0.0, 1.0, "Hz", of=_filter,
               quantity="cutoff / half of control.rate_hz", above="It filters nothing."),
    range_rule("output.interval", 0.0, 0.25, "s", quantity="interval / first period",
               of=lambda facts, value, _: facts.scenario.output_interval / facts.period,
               above="Fewer than 4 instants in a period show no vibration."),
)
"""Ranges of what follows from an arm and its water."""
# fmt: on
