"""Odd numbers of a scenario are told before it is run: each rule, odd and plausible."""

import math
import re
from pathlib import Path

import numpy as np
import pytest

import crinoid
from crinoid.assembly.prepared import Prepared
from crinoid.plausibility import AT_REST, IN_THE_WATER, RULES, Rule, doubts
from crinoid.plausibility.facts import Facts
from crinoid.plausibility.usual import _ANGLES
from crinoid.plausibility.vibration import bending_frequencies
from crinoid.scenario import builtin_names

TURBULENT = str(Path(__file__).resolve().parents[1] / "benchmarks" / "planar.toml")
UNIFORM = 'flow=[{kind="uniform", velocity=[0.1, 0.0]}]'
DISTRIBUTED = "load=[{{kind='distributed', direction={}, magnitude={}}}]"
TIP = "load=[{{kind='tip', force={}, follower={}}}]"
SPHERE = "obstacle=[{{kind='sphere', position={}, radius={}, velocity={}}}]"
BALL = "obstacle=[{{kind='sphere', position=[0.4, -9.5], radius=0.05, mass={}}}]"
WAVES = "flow=[{{kind='waves', significant_height={}, peak_period={}}}]"
SHEAR = "flow=[{{kind='shear', velocity=[0.2, 0.0], reference_depth=1.0, {}}}]"
GAUSS = (
    "flow=[{{kind='gauss-markov', mean=[0.2, 0.0], standard_deviation={}, correlation_time={}}}]"
)
SINE = "base.motion=[{{kind='sine', channel='heave', amplitude={}, frequency_hz={}}}]"
CIRCLE = "target={{path='circle', centre={}, radius={}, period=5.0}}"
SCHEDULE = "schedule={{time=[{}, 1e7], share=[0.0, 1.0]}}"
CHAMBER = f"chamber=[{{{{offset={{}}, area={{}}, max_pressure=1e4, {SCHEDULE}}}}}]"
WINCH = "tendon=[{{drive='length', offset=0.008, max_shortening={}, stiffness=1e4}}]"
PUMP = "chamber=[{{drive='volume', offset=0.008, area=2e-4, bulk_modulus=1e6, max_volume={}}}]"
TENDON = f"tendon=[{{{{offset={{}}, max_tension={{}}, {SCHEDULE}}}}}]"
DEPTH = "water.depth=20.0"
RECORD = "flow.0.velocity_scale={}"

# by the keys that a rule looks at: odd settings, one list each, and plausible ones
RANGES = {
    "arm.length": ([["arm.length=500"], ["arm.length=5e-3"]], ["arm.length=2.0"]),
    "arm.density": ([["arm.density=1.08"], ["arm.density=1.08e6"]], ["arm.density=7850"]),
    "arm.youngs_modulus": ([["arm.youngs_modulus=4.0"]], ["arm.youngs_modulus=2.1e11"]),
    "water.density": (
        [["water.density=1.025"], ["water.density=1025e3"]],
        ["water.density=1.2"],
    ),
    "water.kinematic_viscosity": (
        [["water.kinematic_viscosity=1.2"]],
        ["water.kinematic_viscosity=1e-4"],
    ),
    "water.drag_normal": ([["water.drag_normal=11"]], ["water.drag_normal=2.0"]),
    "water.drag_tangential": ([["water.drag_tangential=1"]], ["water.drag_tangential=0.05"]),
    "water.added_mass_normal": ([["water.added_mass_normal=10"]], ["water.added_mass_normal=0"]),
    "water.added_mass_tangential": (
        [["water.added_mass_tangential=3"]],
        ["water.added_mass_tangential=0.1"],
    ),
    "water.gravity": ([["water.gravity=981"], ["water.gravity=1"]], ["water.gravity=1.62"]),
    "water.depth": ([["water.depth=2e4"]], [DEPTH]),
    "base.channels.*.max_speed": (
        [["base.channels.slide.max_speed=500"]],
        ["base.channels.slide.max_speed=1.0"],
    ),
    "base.channels.*.max_acceleration": (
        [["base.channels.slide.max_acceleration=3000"]],
        ["base.channels.slide.max_acceleration=9.0"],
    ),
    "base.channels.*.max_speed_deg": (
        [["base.channels.tilt.max_speed_deg=3.14"]],
        ["base.channels.tilt.max_speed_deg=30"],
    ),
    "base.channels.*.max_acceleration_deg": (
        [["base.channels.tilt.max_acceleration_deg=12.6"]],
        ["base.channels.tilt.max_acceleration_deg=720"],
    ),
    "base.channels.*.bandwidth_hz": (
        [["base.channels.tilt.bandwidth_hz=1e4"]],
        ["base.channels.tilt.bandwidth_hz=1.0"],
    ),
    "flow.*.velocity": (
        [["flow=[{kind='uniform', velocity=[30.0, 0.0]}]"]],
        ["flow=[{kind='uniform', velocity=[-2.0, 0.0]}]"],
    ),
    "flow.*.mean": ([["flow.0.mean=[30.0, 0.0]"]], ["flow.0.mean=[0.0, 0.2]"]),
    "flow.*.amplitude": (
        [["flow=[{kind='sine', amplitude=[30.0, 0.0], frequency_hz=0.2}]"]],
        ["flow=[{kind='sine', amplitude=[0.3, 0.0], frequency_hz=0.2}]"],
    ),
    "flow.*.standard_deviation": ([[GAUSS.format(10.0, 2.0)]], [GAUSS.format(0.1, 2.0)]),
    "flow.*.time_scale": (
        [["flow.0.time_scale=1e3"]],
        ["flow.0.time_scale=0.25"],
        "tidal-channel",
    ),
    "flow.*.length_scale": (
        [["flow.0.length_scale=5e3"], ["flow.0.length_scale=0.005"]],
        ["flow.0.length_scale=20"],
    ),
    "flow.*.significant_height": (
        [[WAVES.format(80.0, 25.0), "water.depth=500", "base.position=[0, -100]"]],
        [WAVES.format(1.0, 6.0), DEPTH],
    ),
    "flow.*.peak_period": (
        [[WAVES.format(0.5, 6000.0), DEPTH], [WAVES.format(0.01, 0.17), DEPTH]],
        [WAVES.format(0.5, 6.0), DEPTH],
    ),
    "flow.*.exponent": (
        [[SHEAR.format("exponent=7.0"), DEPTH]],
        [SHEAR.format("exponent=0.14"), DEPTH],
    ),
    "flow.*.roughness_length": (
        [[SHEAR.format("roughness_length=3.0"), DEPTH]],
        [SHEAR.format("roughness_length=0.003"), DEPTH],
    ),
    "obstacle.*.velocity": (
        [[SPHERE.format("[0.4, -9.5]", 0.1, "[-30.0, 0.0]")]],
        [SPHERE.format("[0.4, -9.5]", 0.1, "[-0.3, 0.0]")],
    ),
    "obstacle.*.friction": (
        [["obstacle.0.friction=40"]],
        ["obstacle.0.friction=0.4"],
        "coral-touch",
    ),
    "simulation.tolerance": ([["simulation.tolerance=1e-3"]], ["simulation.tolerance=1e-6"]),
    "simulation.max_iterations": ([["simulation.max_iterations=2"]], ["simulation.tolerance=1e-6"]),
}
TURNS = {
    "base.tilt_deg": ["base.tilt_deg={}"],
    "base.pan_deg": ["base.pan_deg={}"],
    "base.roll_deg": ["base.roll_deg={}"],
    "base.motion.*.phase_deg": [
        "base.motion=[{{kind='sine', channel='sway', amplitude=0.1, frequency_hz=0.1, "
        "phase_deg={}}}]"
    ],
    "flow.*.phase_deg": [
        "flow=[{{kind='sine', amplitude=[0.1, 0, 0], frequency_hz=1, phase_deg={}}}]"
    ],
    "flow.*.direction_deg": [
        "flow=[{{kind='waves', significant_height=0.1, peak_period=5, direction_deg={}}}]",
        DEPTH,
    ],
    "flow.*.heading_deg": ["flow=[{{kind='measured', file='no.csv', heading_deg={}}}]"],
    "target.phase_deg": ["target={{path='circle', radius=0.1, period=5, phase_deg={}}}"],
}
RANGES |= {
    key: (
        [[each.format(1000) for each in settings]],
        [each.format(-90) for each in settings],
        "station-keeping-3d",
    )
    for key, settings in TURNS.items()
} | {
    "base.channels.*.range_deg": (
        [["base.channels.tilt.range_deg=[-3600, 3600]"]],
        ["base.channels.tilt.range_deg=[-360, 360]"],
    ),
    "tool.drag_area": ([["tool={mass=0.1, drag_area=20}"]], ["tool={mass=0.1, drag_area=0.01}"]),
    "tool.added_mass": ([["tool={mass=0.1, added_mass=5e3}"]], ["tool={mass=0.1, added_mass=1}"]),
    "chamber.*.time_constant": (
        [["chamber=[{max_curvature=1.0, time_constant=200}]"]],
        ["chamber=[{max_curvature=1.0, time_constant=0.2}]"],
    ),
    "tendon.*.time_constant": (
        [["tendon=[{offset=8e-3, max_tension=1.0, time_constant=200}]"]],
        ["tendon=[{offset=8e-3, max_tension=1.0, time_constant=0.2}]"],
    ),
    "chamber.*.stiffening": (
        [["chamber=[{max_curvature=1.0, stiffening=500}]"]],
        ["chamber=[{max_curvature=1.0, stiffening=2}]"],
    ),
    "sensor.resolution_position": (
        [["sensor.resolution_position=1.0"]], ["sensor.resolution_position=1e-3"]
    ),
    "sensor.resolution_angle_deg": (
        [["sensor.resolution_angle_deg=90"]], ["sensor.resolution_angle_deg=1.0"]
    ),
}  # fmt: skip
RELATIONS = {
    ", ".join(_ANGLES): (
        [
            ["base.tilt_deg=-0.785"],
            ["base.channels.tilt.range_deg=[-1.047, 1.047]"],
            ["target.angle_deg=1.571"],
            [WAVES.format(0.5, 6.0), DEPTH, "flow.0.direction_deg=3.14"],
        ],
        ["base.tilt_deg=0.5", "target.angle_deg=2.0"],
    ),
    "flow.*.velocity_scale": (
        [[RECORD.format(30.0)]],
        [RECORD.format(1.0)],
        "tidal-channel",
    ),
    "arm.radius": (
        [["arm.radius=15"], ["arm.radius=1e-5"], ["arm.radius=[0.005, 0.02]"]],
        ["arm.radius=[0.02, 0.005]"],
    ),
    "arm.nodes": ([["arm.nodes=3"], ["arm.nodes=201"]], ["arm.nodes=81"]),
    "arm.rest_curvature": (
        [
            ["arm.rest_curvature=25.0"],
            ["arm.rest_curvature=180.0", "arm.radius=1e-3", "arm.nodes=101"],
            ["arm.rest_curvature=12.0", "arm.nodes=11"],
        ],
        ["arm.rest_curvature=6.0"],
    ),
    "arm.section.*": (
        [
            ["arm.section.EI=1.6e5"],
            ["arm.section.EI=1e-8"],
            ["arm.section.diameter=30"],
            ["arm.section.displaced_area=7.0"],
            ["arm.section.mass_per_length=760"],
        ],
        ["arm.section={EI=0.1, mass_per_length=0.9, diameter=0.04, displaced_area=9e-4}"],
    ),
    "base.position": (
        [
            ["base.position=[0.0, 10.0]"],
            ["base.position=[0.0, -0.2]", "base.tilt_deg=90"],
            ["base.position=[0.0, -9.9]", "water.depth=10.0"],
        ],
        ["base.position=[0.0, -9.9]", DEPTH],
    ),
    "base.channels.*.range, base.channels.*.range_deg": (
        [
            ["base.channels.slide.range=[-300, 300]"],
            ["base.channels.slide.range=[-3e-5, 3e-5]"],
            ["base.channels.tilt.range_deg=[-0.9, 0.9]"],
        ],
        ["base.channels.slide.range=[-1.0, 1.0]"],
    ),
    "base.motion.*": (
        [
            [SINE.format(0.3, 5.0)],
            [SINE.format(30.0, 0.1)],
            ["base.motion=[{kind='velocity', channel='slide', velocity=50.0}]"],
            [
                "base.motion=[{kind='table', channel='slide', time=[0, 0.02, 0.04, 40], "
                "value=[0, 0, 0.1, 0.1]}]"
            ],
        ],
        [SINE.format(0.3, 0.2)],
    ),
    "flow.*.length_scale against the arm": (
        [["flow.0.length_scale=0.05"]],
        ["flow.0.length_scale=0.1"],
    ),
    "flow.*.significant_height against the water": (
        [
            [WAVES.format(3.0, 2.0), DEPTH],
            [WAVES.format(7.0, 12.0), "water.depth=11.0"],
            [WAVES.format(4.0, 8.0), DEPTH, "base.position=[0.0, -3.0]"],
        ],
        [WAVES.format(1.0, 6.0), DEPTH],
    ),
    "flow.*.correlation_time": ([[GAUSS.format(0.1, 2000.0)]], [GAUSS.format(0.1, 5.0)]),
    "flow.*.start, flow.*.ramp_time, load.*.start, load.*.ramp_time": (
        [["flow.0.start=30"], ["flow.0.ramp_time=3000"]],
        ["flow.0.start=10"],
    ),
    "load.*.force, load.*.magnitude, load.*.moment": (
        [
            [TIP.format("[2000.0, 0.0]", "false")],
            [TIP.format("[0.0, 800.0]", "false")],
            [DISTRIBUTED.format("'normal'", 2000.0)],
            ["load=[{kind='tip', moment=9.0}]"],
        ],
        [TIP.format("[0.0, 3.0]", "false")],
    ),
    "load.*.force, load.*.magnitude against buckling": (
        [
            # EI is 0.159 N m2: Euler at 1.57 N, Beck at 12.8 N, Greenhill at 9.97 N/m
            [TIP.format("[-1.7, 0.0]", "false"), "base.tilt_deg=0"],
            [TIP.format("[-13.0, 0.0]", "true")],
            [DISTRIBUTED.format("[-1.0, 0.0]", 11.0), "base.tilt_deg=0"],
        ],
        [TIP.format("[-1.5, 0.0]", "false"), "base.tilt_deg=0"],
    ),
    "arm.youngs_modulus, arm.section.EI": (
        [
            ["arm.youngs_modulus=4000", "arm.density=1500"],
            ["arm.youngs_modulus=1e5", "arm.density=1500", "base.tilt_deg=90"],
        ],
        ["arm.youngs_modulus=4e6", "base.tilt_deg=90"],
    ),
    "flow": ([["arm.youngs_modulus=4000", "flow.0.mean=[1.5, 0.0]"]], ["flow.0.mean=[1.0, 0.0]"]),
    "vehicle.mass": (
        [["vehicle={mass=0.05, inertia=0.01}"]],
        ["vehicle={mass=50.0, inertia=3.0}"],
    ),
    "vehicle.bandwidth_hz, vehicle.max_force, vehicle.max_moment": (
        [
            ["vehicle={mass=50.0, inertia=3.0, bandwidth_hz=0.4}"],
            ["vehicle={mass=50.0, inertia=3.0, max_force=9.0}"],
            ["vehicle={mass=50.0, inertia=3.0, max_moment=9.0}"],
        ],
        ['vehicle={mass=50.0, inertia=3.0, bandwidth_hz=0.4, hold="thrusters"}'],
    ),
    "vehicle.volume": (
        [
            ["vehicle={mass=50.0, inertia=3.0, volume=50.0}"],
            ["vehicle={mass=50.0, inertia=3.0, volume=1e-3}"],
        ],
        ["vehicle={mass=50.0, inertia=3.0, volume=0.049}"],
    ),
    "vehicle.inertia": (
        [["vehicle={mass=50.0, inertia=3e5}"], ["vehicle={mass=50.0, inertia=3e-3}"]],
        ["vehicle={mass=50.0, inertia=3.0}"],
    ),
    "chamber.*.offset, tendon.*.offset": (
        [[CHAMBER.format(8.0, 2e-4, 0.1)], [TENDON.format(8.0, 1e-3, 0.1)]],
        [CHAMBER.format(8e-3, 2e-4, 0.1), TENDON.format(8e-3, 1.0, 0.1)],
    ),
    "chamber.*.max_pressure, chamber.*.max_volume, tendon.*.max_tension, tendon.*.max_shortening": (
        [
            [CHAMBER.format(8e-3, 2.0, 0.1)],
            [TENDON.format(8e-3, 1e3, 0.1)],
            [WINCH.format(0.4)],
            [PUMP.format(2e-3)],
        ],
        [
            CHAMBER.format(8e-3, 2e-4, 0.1),
            TENDON.format(8e-3, 1.0, 0.1),
            WINCH.format(0.02),
            PUMP.format(2e-6),
        ],
    ),
    "chamber.*.schedule.time, tendon.*.schedule.time": (
        [[CHAMBER.format(8e-3, 2e-4, 1e6)], [TENDON.format(8e-3, 1.0, 1e6)]],
        [CHAMBER.format(8e-3, 2e-4, 0.1), TENDON.format(8e-3, 1.0, 0.1)],
    ),
    "sensors.*.delay": (
        [["sensors=[{kind='wrench', delay=90.0}]"]],
        ["sensors=[{kind='wrench', delay=0.1}]"],
    ),
    "tool.mass": ([["tool={mass=200.0}"]], ["tool={mass=0.2}"]),
    "tool.volume": (
        [["tool={mass=0.2, volume=0.05}"], ["tool={mass=0.2, volume=5e-9}"]],
        ["tool={mass=0.2, volume=5e-5}"],
    ),
    "tool.offset": ([["tool={mass=0.2, offset=30.0}"]], ["tool={mass=0.2, offset=0.03}"]),
    "tool.inertia": ([["tool={mass=0.2, inertia=4.0}"]], ["tool={mass=0.2, inertia=1e-3}"]),
    "tool.from": ([["tool={mass=0.2, from=60.0}"]], ["tool={mass=0.2, from=6.0}"]),
    "obstacle.*.radius": (
        [
            [SPHERE.format("[0.4, -9.5]", 60.0, "[0, 0]")],
            [SPHERE.format("[0, -9.5]", 1e-4, "[0, 0]")],
        ],
        [SPHERE.format("[0.4, -9.5]", 0.1, "[0, 0]")],
    ),
    "obstacle.*.mass": ([[BALL.format(500.0)], [BALL.format(5e-4)]], [BALL.format(0.5)]),
    "obstacle.*.position": (
        [
            [SPHERE.format("[400.0, -9.5]", 0.1, "[0.0, 0.0]")],
            ["obstacle=[{kind='plane', position=[0, -30], normal=[0, 1]}]"],
            ["obstacle=[{kind='cylinder', position=[2, -10], axis=[0, 0, 1], radius=0.1}]"],
        ],
        [SPHERE.format("[4.0, -10.2]", 0.1, "[-0.3, 0.0]")],
    ),
    "target.tip, target.to, target.centre, target.radius, target.amplitude, target.file": (
        [
            ["target.tip=[1000.0, -10.0]"],
            ["target.tip=[[0.3, -10.3], [0.3, 0.3]]", "target.time=[1.0, 2.0]"],
            ["target.tip=[0.3, -10.3]", "target.frame=base"],
            ["target.path=line", "target.to=[300.0, -300.0]", "target.travel_time=2.0"],
            ["target.path=circle", "target.radius=100.0", "target.period=5.0"],
            [CIRCLE.format("[0.3, -9.9]", 0.6)],
            ["target.path=sine", "target.amplitude=[0.0, 100.0]", "target.frequency_hz=0.1"],
        ],
        ["target.tip=[0.3, -0.3]", "target.frame=base"],
    ),
    "target.time, target.start, control.start": (
        [
            ["control.start=30"],
            ["target.path=circle", "target.radius=0.1", "target.period=5.0", "target.start=30.0"],
            ["target.tip=[[0.3, -10.3], [0.4, -10.3]]", "target.time=[30.0, 40.0]"],
        ],
        ["control.start=10"],
    ),
    "sensor.delay": (
        [["sensor.delay=10"], ["sensor.delay=1.0", "simulation.duration=1.0"]],
        ["sensor.delay=0.1"],
    ),
    "sensor.noise_position, sensor.noise_angle_deg": (
        [["sensor.noise_position=1.0"], ["sensor.noise_angle_deg=57.3"]],
        ["sensor.noise_position=1e-3", "sensor.noise_angle_deg=1.0"],
    ),
    "control.pid.*.derivative_filter_hz": (
        [["control.rate_hz=20"]],
        ["control.pid.tilt.derivative_filter_hz=40"],
    ),
    "control.neural.weights": (
        [
            ["control.kind=neural", "arm.length=0.6"],
            ["control.kind=neural", "flow.0.amplitude.0=0.4"],
            ["control.kind=neural", "sensor.noise_position=0.001"],
        ],
        ["control.kind=neural", "arm.youngs_modulus=3e6", "sensor.delay=0.006"],
        "station-keeping",
    ),
    "arm.damping_time": ([["arm.damping_time=50"]], ["arm.damping_time=0.5"]),
    "water.linear_drag": ([["water.linear_drag=1000"]], ["water.linear_drag=5"]),
    "simulation.time_step": (
        [
            ["simulation.time_step=0.5"],
            ["simulation.time_step=0.05", "control.kind=none"],
            ["flow.0.length_scale=0.1", "flow.0.mean=[3.0, 0.0]"],
            [WAVES.format(0.1, 0.8), DEPTH, "simulation.time_step=0.1", "arm.youngs_modulus=2e4"],
            [SINE.format(1e-3, 30.0)],
            [SPHERE.format("[4.0, -10.2]", 0.01, "[-3.0, 0.0]")],
            [GAUSS.format(0.1, 0.02)],
            ["base.channels.tilt.bandwidth_hz=40"],
            ["flow.0.ramp_time=0.03"],
        ],
        ["simulation.time_step=0.02"],
    ),
    "simulation.integrator": (
        [["simulation.integrator=implicit-euler", "simulation.time_step=0.025"]],
        ["simulation.integrator=implicit-euler"],
    ),
    "output.interval": ([["output.interval=0.5"]], ["output.interval=0.1"]),
}
CASES = {**RANGES, **RELATIONS}


def name(rule: Rule) -> str:
    return ", ".join(rule.keys) + (f" against {rule.against}" if rule.against else "")


EVERY = {name(rule): rule for rule in RULES}


def described(settings: list[str], built_in: str) -> Facts:
    return Facts(Prepared(crinoid.load(built_in, settings)))


def test_every_rule_is_tried():
    assert len(EVERY) == len(RULES)
    assert set(CASES) == set(EVERY)


def matches(key: str, pattern: str) -> bool:
    return re.fullmatch(re.escape(pattern).replace(r"\*", r"[^.]+") + r"(\..*)?", key) is not None


@pytest.mark.parametrize("which", CASES)
def test_a_rule_tells_what_is_odd_and_nothing_else(which):
    rule, (odd, plausible, *built_in) = EVERY[which], CASES[which]
    scenario = built_in[0] if built_in else TURBULENT
    for settings in odd:
        found = list(rule.doubts(described(settings, scenario)))
        assert found, settings
        for doubt in found:
            key = doubt.split(":")[0]
            assert any(matches(key, pattern) for pattern in rule.keys), doubt
            assert "\n" not in doubt
    assert list(rule.doubts(described(plausible, scenario))) == []


@pytest.mark.parametrize("built_in", builtin_names())
def test_nothing_is_odd_about_the_built_in_scenarios(built_in):
    for _, case in crinoid.load(built_in).cases():
        assert doubts(Prepared(case)) == []


def test_a_thread_is_held_against_the_sections_that_it_runs_along():
    rule = next(rule for rule in RULES if "chamber.*.max_pressure" in rule.keys)
    tapered = ["arm.radius=[0.02, 0.005]", "arm.youngs_modulus=1e6"]
    chamber = "chamber=[{{span={}, offset=4e-3, area=5e-4, max_pressure=1.2e5}}]"
    for span, strain in (([0.0, 0.1], 0.056), ([0.9, 1.0], 0.764)):
        found = list(rule.doubts(described([*tapered, chamber.format(span)], TURBULENT)))
        assert bool(found) == (strain > 0.5)
        assert not found or f"stretches it by {100 * strain:.3g}%" in found[0]
    # along an arm whose stiffness falls with the fourth power of its radius
    given = chamber.format([0.0, 1.0]).replace("5e-4", "2.5e-4").replace("4e-3", "8e-3")
    (found,) = rule.doubts(described([*tapered, given], TURBULENT))
    ends = [1e6 * np.pi / 4 * radius**3 for radius in (0.02, 0.005)]
    length = crinoid.load(TURBULENT).arm.length
    turns = 30.0 * 8e-3 * length / 0.015 / 3 * (1 / ends[1] - 1 / ends[0]) / (2 * np.pi)
    assert float(found.split("into ")[1].split()[0]) == pytest.approx(turns, rel=0.03)


def test_the_defaults_are_plausible_in_the_plane_and_in_space():
    assert doubts(Prepared(crinoid.Scenario())) == []
    assert doubts(Prepared(crinoid.Scenario(arm={"dimension": 3}))) == []
    pinned = crinoid.Scenario(base={"mount": "pinned", "tilt_deg": -90.0})
    assert doubts(Prepared(pinned)) == []
    nothing = crinoid.Scenario(water={"density": 0.0, "gravity": 0.0})
    assert doubts(Prepared(nothing)) == []


def test_a_note_says_key_value_and_likely_cause():
    (note,) = doubts(Prepared(crinoid.load(TURBULENT, ["arm.radius=15"])))
    assert note == (
        "arm.radius: got 15.0 m on an arm of 0.5 m; a slender rod has a radius below a tenth of "
        "its length; is it in mm?"
    )


def test_commands_hear_of_what_they_use_only():
    values = ["sensor.delay=10", "base.tilt_deg=0.785", "flow.0.mean=[6.0, 0.0]"]
    odd = crinoid.load(TURBULENT, [*values, "simulation.time_step=0.005"])
    which = {"run": (), "still": AT_REST, "flow": IN_THE_WATER}
    told = {name: doubts(Prepared(odd), tables) for name, tables in which.items()}
    tables = {name: {note.split(".")[0] for note in notes} for name, notes in told.items()}
    assert tables["run"] == {"flow", "base", "sensor"}
    assert tables["still"] == {"flow", "base"}
    assert tables["flow"] == {"flow"}


ROUND = {"path": "circle", "centre": [0.2, 0.0, -9.7], "radius": 0.25, "period": 5.0}


@pytest.mark.parametrize(
    ("normal", "far"), [([0, -1, 0], True), ([1e-200, 0, 0], True), ([0.2, 0.0, 0.3], False)]
)
def test_a_circle_in_space_reaches_as_far_as_its_plane_lets_it(normal, far):
    # the base is at [0, 0, -10]; from it the centre is at [0.2, 0, 0.3], 0.36 m away
    turn = np.linspace(0.0, 2 * math.pi, 1001)
    first, second = np.linalg.svd(np.array([normal]) / max(map(abs, normal)))[2][1:]
    circle = np.outer(np.cos(turn), first) + np.outer(np.sin(turn), second)
    points = np.array([0.2, 0.0, 0.3]) + 0.25 * circle
    farthest = np.linalg.norm(points, axis=1).max()
    arm = {"dimension": 3, "length": 0.5}
    found = doubts(Prepared(crinoid.Scenario(arm=arm, target={**ROUND, "normal": normal})))
    assert [note.split(":")[0] for note in found] == ["target.radius"] * far
    assert not far or f"a target {farthest:.4g} m from the base" in found[0]


def test_series_from_files_are_held_against_the_arm_as_lists_are(tmp_path):
    (tmp_path / "path.csv").write_text("time,x,z\n-9,900,0\n0,0.3,-10\n10,0.3,-9.8\n99,800,0\n")
    path = {"path": "file", "file": str(tmp_path / "path.csv")}
    assert doubts(Prepared(crinoid.Scenario(target=path, simulation={"duration": 10.0}))) == []
    (note,) = doubts(Prepared(crinoid.Scenario(target=path, simulation={"duration": 50.0})))
    assert note.startswith("target.file: got ")
    assert "a target 800.1 m from the base" in note
    points = {"time": [0.0, 1.0, 2.0, 30.0], "value": [0.0, 0.0, 200.0, 200.0]}
    lines = zip(points["time"], points["value"], strict=True)
    text = "time,heave\n" + "".join(f"{time},{value}\n" for time, value in lines)
    (tmp_path / "heave.csv").write_text(text)
    given = {"kind": "file", "file": str(tmp_path / "heave.csv")}
    notes = []
    for motion in ({"kind": "table", **points}, given):
        base = {"motion": [{"channel": "heave", **motion}]}
        notes += [
            note for note in doubts(Prepared(crinoid.Scenario(base=base))) if "shakes" in note
        ]
    assert [note.split(":")[0] for note in notes] == ["base.motion.0.value", "base.motion.0.file"]
    table, file = (note.split(", which")[1] for note in notes)
    assert table == file
    assert "the base with 200 m/s2" in file


@pytest.mark.parametrize("size", [1e-308, 1e-160, 1e160, 1e300])
@pytest.mark.parametrize(
    ("built_in", "key"),
    [
        ("station-keeping", "arm.radius"),
        ("station-keeping", "arm.length"),
        ("station-keeping", "arm.youngs_modulus"),
        ("station-keeping", "flow.0.amplitude.0"),
        ("station-keeping", "target.tip.0"),
        ("debris-strike", "obstacle.0.radius"),
        ("debris-strike", "obstacle.0.mass"),
        ("wave-zone", "flow.0.peak_period"),
        ("wave-zone", "flow.0.significant_height"),
        ("trace-circle-3d", "target.radius"),
        ("constant-load", "water.gravity"),
    ],
)
def test_numbers_beyond_what_can_be_computed_are_told_and_do_not_stop_the_rules(
    built_in, key, size
):
    try:
        odd = crinoid.load(built_in, [f"{key}={size}"])
    except crinoid.ScenarioError:  # refused before
        return
    found = doubts(Prepared(odd))
    assert all(re.match(r"[a-z_0-9.*]+: ", note) and "\n" not in note for note in found)
    if size > 1:
        assert found


def test_a_rule_that_cannot_be_computed_names_its_keys():
    found = doubts(Prepared(crinoid.load("debris-strike", ["obstacle.0.radius=1e-160"])))
    assert any("go beyond what can be computed" in note for note in found)


@pytest.mark.parametrize("error", [OverflowError, FloatingPointError, ValueError])
def test_what_a_rule_found_is_kept_where_it_cannot_go_on(error, monkeypatch):
    def breaks(facts):
        yield "flow.0.velocity: odd"
        raise error("math range error")

    def goes_on(facts):
        yield "flow.1.velocity: odd too"

    rules = (Rule(("flow.*.velocity",), "", breaks, "the arm"), Rule(("flow.*",), "", goes_on))
    monkeypatch.setattr("crinoid.plausibility._FIRST", ())
    monkeypatch.setattr("crinoid.plausibility._THEN", rules)
    assert doubts(Prepared(crinoid.Scenario())) == [
        "flow.0.velocity: odd",
        "flow.*.velocity: cannot be judged against the arm; numbers go beyond what can be computed",
        "flow.1.velocity: odd too",
    ]
    # what is wrong with a file is no note

    def refuses(facts):
        raise crinoid.ScenarioError([])
        yield

    monkeypatch.setattr("crinoid.plausibility._THEN", (Rule(("flow.*",), "", refuses),))
    with pytest.raises(crinoid.ScenarioError):
        doubts(Prepared(crinoid.Scenario()))


def test_what_follows_from_an_odd_arm_goes_without_saying():
    both = doubts(
        Prepared(crinoid.load(TURBULENT, ["arm.youngs_modulus=0.004", "sensor.delay=10"]))
    )
    assert [note.split(":")[0] for note in both] == ["arm.youngs_modulus"]


def test_the_periods_of_cantilevers_are_those_on_paper():
    bending, mass = np.full(2, 0.3), np.full(2, 1.7)
    found = bending_frequencies(0.8, bending, mass)
    exact = np.array([1.875104, 4.694091, 7.854757]) ** 2 / (2 * math.pi)
    np.testing.assert_allclose(
        found[:3], exact * math.sqrt(0.3 / 1.7) / 0.8**2, rtol=1e-4
    )  # Blevins 2016
    pinned = bending_frequencies(0.8, bending, mass, clamped=False)
    scale = math.sqrt(0.3 / 1.7) / 0.8**2 / (2 * math.pi)
    np.testing.assert_allclose(pinned[:2], np.array([3.926602, 7.068583]) ** 2 * scale, rtol=1e-4)
    # a cone that ends in a point: Conway, Becker and Dubil 1964
    sharp = bending_frequencies(0.8, np.array([0.3, 0.0]), np.array([1.7, 1e-9]), taper=1e-4)
    assert sharp[0] == pytest.approx(8.719 * scale, rel=0.01)
