"""Rules doubt odd numbers of a scenario before it runs, and no plausible ones."""

import math
import re

import numpy as np
import pytest

import crinoid
from crinoid.assembly.facts import Facts, bending_frequencies
from crinoid.assembly.prepared import Prepared
from crinoid.diagnostics.plausibility import (
    AT_REST,
    IN_THE_WATER,
    RULES,
    Rule,
    plausibility_warnings,
)
from crinoid.diagnostics.plausibility.table import ANGLES
from crinoid.scenario import builtin_names
from helpers.paths import ROOT

TURBULENT = str(ROOT / "tests" / "helpers" / "turbulent.toml")
SLIDE, TILT = "base.channels.slide.", "base.channels.tilt."
SHEAR = "flow=[{kind='shear', velocity=[0.2, 0.0], reference_depth=1.0, ?}]; water.depth=20.0"
SINE = "flow=[{kind='sine', amplitude=[?, 0.0], frequency_hz=0.2}]"
GAUSS = "flow=[{kind='gauss-markov', mean=[0.2, 0.0], standard_deviation=?}]"
REGULAR = "flow=[{kind='regular-wave', height=?"
WAVES = "flow=[{kind='waves', significant_height=?"
BALL = "[0.4, -9.5], radius=0.05, "
SPHERE = "obstacle=[{kind='sphere', position=?}]"
ROLLING = (
    "obstacle=[{kind='sphere', position=[0.4, -9.5], radius=0.05, mass=0.5, rolling_friction=?}, "
    "{kind='plane', position=[0, -9.6], normal=[0, 1]}]"
)
VEHICLE = "vehicle={mass=50.0, inertia=?}"
CHAMBER = "chamber=[{max_pressure=1e4, schedule={time=[?, 1e7], share=[0.0, 1.0]}, offset="
TENDON = "tendon=[{schedule={time=[?, 1e7], share=[0.0, 1.0]}, offset="
SLOW_TENDON = "tendon=[{offset=8e-3, max_tension=1.0, time_constant=?}]"
WINCH = "tendon=[{drive='length', offset=0.008, stiffness=1e4, max_shortening="
PUMP = "chamber=[{drive='volume', offset=0.008, area=2e-4, bulk_modulus=1e6, max_volume="
EARLY_CHAMBER, EARLY_TENDON = CHAMBER.replace("?", "0.1"), TENDON.replace("?", "0.1")
EULER = "simulation.integrator=implicit-euler"

# By the keys that a rule looks at: a setting, or several, with a blank, what is odd in the blank,
# and what is plausible. Where a rule needs another scenario than that one, its name.
# fmt: off
CASES = {
    "arm.length": ("arm.length=?", ["500", "5e-3"], ["2.0"]),
    "arm.density": ("arm.density=?", ["1.08", "1.08e6"], ["7850"]),
    "arm.youngs_modulus": ("arm.youngs_modulus=?", ["4.0"], ["2.1e11"]),
    "arm.damping_time": ("arm.damping_time=?", ["50",
        "1e-3; arm.loss_factor={value=0.1, band_hz=[0.1, 10.0]}"], ["0.5"]),
    "arm.radius": ("arm.radius=?", ["15", "1e-5", "[0.005, 0.02]"], ["[0.02, 0.005]"]),
    "arm.nodes": ("arm.nodes=?", ["3", "201"], ["81"]),
    "arm.rest_curvature": ("arm.rest_curvature=?", ["25.0", "180.0; arm.radius=1e-3; arm.nodes=101",
        "12.0; arm.nodes=11"], ["6.0"]),
    "arm.section.*": ("arm.section={?}", ["EI=1.6e5", "EI=1e-8", "EA=100.0", "EA=1e9",
        "diameter=30", "displaced_area=7.0", "mass_per_length=760"],
        ["EI=0.1, mass_per_length=0.9, diameter=0.04, displaced_area=9e-4"]),
    "arm.section.GJ": ("arm.section.GJ=?", ["10.0"], ["0.1"], "station-keeping-3d"),
    "arm.youngs_modulus, arm.section.EI": ("arm.youngs_modulus=?", ["4000; arm.density=1500",
        "1e5; arm.density=1500; base.tilt_deg=90"], ["4e6; base.tilt_deg=90"]),
    "water.density": ("water.density=?", ["1.025", "1025e3"], ["1.2"]),
    "water.kinematic_viscosity": ("water.kinematic_viscosity=?", ["1.2"], ["1e-4"]),
    "water.drag_normal": ("water.drag_normal=?", ["11"], ["2.0"]),
    "water.drag_tangential": ("water.drag_tangential=?", ["1"], ["0.05"]),
    "water.added_mass_normal": ("water.added_mass_normal=?", ["10"], ["0"]),
    "water.added_mass_tangential": ("water.added_mass_tangential=?", ["3"], ["0.1"]),
    "water.linear_drag": ("water.linear_drag=?", ["1000"], ["5"]),
    "water.gravity": ("water.gravity=?", ["981", "1"], ["1.62"]),
    "water.depth": ("water.depth=?", ["2e4"], ["20.0"]),
    "base.position": ("base.position=?", ["[0.0, 10.0]", "[0.0, -0.2]; base.tilt_deg=90",
        "[0.0, -9.9]; water.depth=10.0"], ["[0.0, -9.9]; water.depth=20.0"]),
    "base.channels.*.max_speed": (SLIDE + "max_speed=?", ["500"], ["1.0"]),
    "base.channels.*.max_acceleration": (SLIDE + "max_acceleration=?", ["3000"], ["9.0"]),
    "base.channels.*.max_speed_deg": (TILT + "max_speed_deg=?", ["3.14"], ["30"]),
    "base.channels.*.max_acceleration_deg": (TILT + "max_acceleration_deg=?", ["12.6"], ["720"]),
    "base.channels.*.bandwidth_hz": (TILT + "bandwidth_hz=?", ["1e4"], ["1.0"]),
    "base.channels.*.range_deg": (TILT + "range_deg=?", ["[-3600, 3600]"], ["[-360, 360]"]),
    "base.channels.*.range, base.channels.*.range_deg": ("base.channels.?",
        ["slide.range=[-300, 300]", "slide.range=[-3e-5, 3e-5]", "tilt.range_deg=[-0.9, 0.9]"],
        ["slide.range=[-1.0, 1.0]"]),
    "base.motion.*": ("base.motion=[{kind=?}]",
        ["'sine', channel='heave', amplitude=0.3, frequency_hz=5.0",
        "'sine', channel='heave', amplitude=30.0, frequency_hz=0.1",
        "'velocity', channel='slide', velocity=50.0",
        "'table', channel='slide', time=[0, 0.02, 0.04, 40], value=[0, 0, 0.1, 0.1]"],
        ["'sine', channel='heave', amplitude=0.3, frequency_hz=0.2"]),
    ", ".join(ANGLES): ("?", ["base.tilt_deg=-0.785",
        "base.channels.tilt.range_deg=[-1.047, 1.047]", "target.angle_deg=1.571",
        WAVES.replace("?", "0.5, peak_period=6.0, direction_deg=3.14}]; water.depth=20.0")],
        ["base.tilt_deg=0.5; target.angle_deg=2.0"]),
    "flow.*.velocity": ("flow=[{kind='uniform', velocity=[?, 0.0]}]", ["30.0"], ["-2.0"]),
    "flow.*.mean": ("flow.0.mean=?", ["[30.0, 0.0]"], ["[0.0, 0.2]"]),
    "flow.*.amplitude": (SINE, ["30.0"], ["0.3"]),
    "flow.*.standard_deviation": (GAUSS, ["10.0, correlation_time=2"], ["0.1, correlation_time=2"]),
    "target.tip": ("flow.0.ramp_time=?", ["0.0; flow.0.intensity=0.9",
        "0.0; flow.0.mean=[1.0, 0.0]"], ["0.5", "0.0; flow.0.intensity=0.05",
        "0.0; target.tip=[0.3, -10.2]"]),
    "flow.*.correlation_time": (GAUSS, ["0.1, correlation_time=2e3"], ["0.1, correlation_time=5"]),
    "flow.*.time_scale": ("flow.0.time_scale=?", ["1e3"], ["0.25"], "tidal-channel"),
    "flow.*.velocity_scale": ("flow.0.velocity_scale=?", ["30.0"], ["1.0"], "tidal-channel"),
    "flow.*.length_scale": ("flow.0.length_scale=?", ["5e3", "0.005"], ["20"]),
    "flow.*.length_scale against the arm": ("flow.0.length_scale=?", ["0.05"], ["0.1"]),
    "flow.*.significant_height": (f"{WAVES}}}]; water.depth=500; base.position=[0, -100]",
        ["80.0, peak_period=25.0"], ["1.0, peak_period=6.0"]),
    "flow.*.significant_height against the water": (WAVES,
        ["3.0, peak_period=2.0}]; water.depth=20.0", "7.0, peak_period=12.0}]; water.depth=11.0",
        "4.0, peak_period=8.0}]; water.depth=20.0; base.position=[0.0, -3.0]"],
        ["1.0, peak_period=6.0}]; water.depth=20.0"]),
    "flow.*.height": (f"{REGULAR}}}]; water.depth=500; base.position=[0, -100]",
        ["80.0, period=25.0"], ["1.0, period=6.0"]),
    "flow.*.height against the water": (REGULAR, ["3.0, period=2.0}]; water.depth=20.0",
        "7.0, period=12.0}]; water.depth=11.0", "4.0, period=8.0}]; base.position=[0.0, -3.0]"],
        ["1.0, period=6.0}]"]),
    "flow.*.period": (f"{REGULAR}}}]", ["0.5, period=6e3", "0.01, period=0.17"], ["0.5, period=6"]),
    "flow.*.peak_period": (f"{WAVES}}}]; water.depth=20.0", ["0.5, peak_period=6000.0",
        "0.01, peak_period=0.17"], ["0.5, peak_period=6.0"]),
    "flow.*.exponent": (SHEAR, ["exponent=7.0"], ["exponent=0.14"]),
    "flow.*.roughness_length": (SHEAR, ["roughness_length=3.0"], ["roughness_length=0.003"]),
    "flow.*.start, flow.*.ramp_time, load.*.start, load.*.ramp_time": ("?", ["flow.0.start=30",
        "flow.0.ramp_time=3000", "load=[{kind='tip', force=[0.1, 0.0], start=30.0}]",
        "load=[{kind='tip', force=[0.1, 0.0], ramp_time=3e3}]"], ["flow.0.start=10"]),
    "flow": ("flow.0.mean=?", ["[1.5, 0.0]; arm.youngs_modulus=4000"], ["[1.0, 0.0]"]),
    "load.*.force, load.*.magnitude, load.*.moment": ("load=[{kind=?}]",
        ["'tip', force=[2000.0, 0.0]", "'tip', force=[0.0, 800.0]",
        "'distributed', direction='normal', magnitude=2000.0", "'tip', moment=9.0"],
        ["'tip', force=[3.0, 0.0]"]),
    # EI is 0.159 N m2: Euler at 1.57 N, Beck at 12.8 N, Greenhill at 9.97 N/m
    "load.*.force, load.*.magnitude against buckling": ("load=[{kind=?",
        ["'tip', force=[-1.7, 0.0]}]; base.tilt_deg=0",
        "'tip', force=[-13.0, 0.0], follower=true}]",
        "'distributed', direction=[-1.0, 0.0], magnitude=11.0}]; base.tilt_deg=0"],
        ["'tip', force=[-1.5, 0.0]}]; base.tilt_deg=0"]),
    "obstacle.*.velocity": (SPHERE, [BALL + "velocity=[-30, 0]"], [BALL + "velocity=[-0.3, 0]"]),
    "obstacle.*.friction": ("obstacle.0.friction=?", ["40"], ["0.4"], "coral-touch"),
    "obstacle.*.rolling_friction": (ROLLING, ["0.5"], ["1e-4"]),
    "obstacle.*.spinning_friction": ("obstacle.0.spinning_friction=?", ["0.5"], ["1e-4"],
        "wind-around"),
    "obstacle.*.radius": (SPHERE.replace("?", "[0.4, -9.5], radius=?"), ["60.0", "1e-4"], ["0.1"]),
    "obstacle.*.mass": (SPHERE, [BALL + "mass=500.0", BALL + "mass=5e-4"], [BALL + "mass=0.5"]),
    "obstacle.*.position": ("obstacle=[{kind=?}]", ["'sphere', position=[400.0, -9.5], radius=0.1",
        "'plane', position=[0, -30], normal=[0, 1]",
        "'cylinder', position=[2, -10], axis=[0, 0, 1], radius=0.1"],
        ["'sphere', position=[4.0, -10.2], radius=0.1, velocity=[-0.3, 0.0]"]),
    "vehicle.mass": ("vehicle={mass=?}", ["0.05, inertia=0.01"], ["50.0, inertia=3.0"]),
    "vehicle.bandwidth_hz, vehicle.max_force, vehicle.max_moment": (VEHICLE,
        ["3.0, bandwidth_hz=0.4", "3.0, max_force=9.0", "3.0, max_moment=9.0"],
        ["3.0, bandwidth_hz=0.4, hold='thrusters'"]),
    "vehicle.volume": (VEHICLE, ["3.0, volume=50.0", "3.0, volume=1e-3"], ["3.0, volume=0.049"]),
    "vehicle.inertia": (VEHICLE, ["3e5", "3e-3"], ["3.0"]),
    "chamber.*.offset, tendon.*.offset": ("?}]", [EARLY_CHAMBER + "8.0, area=2e-4",
        EARLY_TENDON + "8.0, max_tension=1e-3"], [EARLY_CHAMBER + "8e-3, area=2e-4",
        EARLY_TENDON + "8e-3, max_tension=1.0"]),
    "chamber.*.max_pressure, chamber.*.max_volume, tendon.*.max_tension, tendon.*.max_shortening": (
        "?}]", [EARLY_CHAMBER + "8e-3, area=2.0", EARLY_TENDON + "8e-3, max_tension=1e3",
        WINCH + "0.4", PUMP + "2e-3"], [EARLY_CHAMBER + "8e-3, area=2e-4",
        EARLY_TENDON + "8e-3, max_tension=1.0", WINCH + "0.02", PUMP + "2e-6"]),
    "chamber.*.schedule.time, tendon.*.schedule.time": ("?}]",
        [CHAMBER.replace("?", "1e6") + "8e-3, area=2e-4",
        TENDON.replace("?", "1e6") + "8e-3, max_tension=1.0"], [EARLY_CHAMBER + "8e-3, area=2e-4",
        EARLY_TENDON + "8e-3, max_tension=1.0"]),
    "chamber.*.time_constant": ("chamber=[{max_curvature=1.0, time_constant=?}]", ["200"], ["0.2"]),
    "tendon.*.friction": ("tendon=[{offset=8e-3, max_tension=1.0, friction=?}]", ["1.5"],
        ["0.2, schedule={time=[0.0, 1.0], share=[1.0, 1.0]}"]),
    "tendon.*.time_constant": (SLOW_TENDON, ["200"], ["0.2"]),
    "chamber.*.stiffening": ("chamber=[{max_curvature=1.0, stiffening=?}]", ["500"], ["2"]),
    "tool.mass": ("tool={mass=?}", ["200.0"], ["0.2"]),
    "tool.volume": ("tool={mass=0.2, volume=?}", ["0.05", "5e-9"], ["5e-5"]),
    "tool.offset": ("tool={mass=0.2, offset=?}", ["30.0"], ["0.03"]),
    "tool.radius": ("tool={mass=0.2, radius=?}", ["20.0"], ["0.02"]),
    "tool.inertia": ("tool={mass=0.2, inertia=?}", ["4.0"], ["1e-3"]),
    "tool.from": ("tool={mass=0.2, from=?}", ["60.0"], ["6.0"]),
    "tool.drag_area": ("tool={mass=0.1, drag_area=?}", ["20"], ["0.01"]),
    "tool.added_mass": ("tool={mass=0.1, added_mass=?}", ["5e3"], ["1"]),
    "target.tip, target.to, target.centre, target.radius, target.amplitude, target.file": (
        "target.?", ["tip=[1000.0, -10.0]",
        "tip=[[0.3, -10.3], [0.3, 0.3]]; target.time=[1.0, 2.0]",
        "tip=[0.3, -10.3]; target.frame=base",
        "path=line; target.to=[300.0, -300.0]; target.travel_time=2.0",
        "path=circle; target.radius=100.0; target.period=5.0",
        "path=circle; target.radius=0.6; target.period=5.0; target.centre=[0.3, -9.9]",
        "path=sine; target.amplitude=[0.0, 100.0]; target.frequency_hz=0.1"],
        ["tip=[0.3, -0.3]; target.frame=base"]),
    "target.time.0, target.start, control.start": ("?", ["control.start=30",
        "target.path=circle; target.radius=0.1; target.period=5.0; target.start=30.0",
        "target.tip=[[0.3, -10.3], [0.4, -10.3]]; target.time=[30.0, 40.0]"], ["control.start=10"]),
    "sensor.delay": ("sensor.delay=?", ["10", "1.0; simulation.duration=1.0"], ["0.1"]),
    "sensor.noise_position, sensor.noise_angle_deg": ("sensor.noise_?", ["position=1.0",
        "angle_deg=57.3"], ["position=1e-3; sensor.noise_angle_deg=1.0"]),
    "sensor.resolution_position": ("sensor.resolution_position=?", ["1.0"], ["1e-3"]),
    "sensor.resolution_angle_deg": ("sensor.resolution_angle_deg=?", ["90"], ["1.0"]),
    "sensors.*.delay": ("sensors=[{kind='wrench', delay=?}]", ["90.0"], ["0.1"]),
    "control.pid.*.derivative_filter_hz": ("control.?", ["rate_hz=20"],
        ["pid.tilt.derivative_filter_hz=40"]),
    "control.neural.weights": ("control.kind=neural; ?", ["arm.length=0.6",
        "flow.0.amplitude.0=0.4", "sensor.noise_position=0.001"],
        ["arm.youngs_modulus=3e6; sensor.delay=0.006"], "station-keeping"),
    "simulation.tolerance": ("simulation.tolerance=?", ["1e-3"], ["1e-6"]),
    "simulation.max_iterations": ("simulation.?", ["max_iterations=2"], ["tolerance=1e-6"]),
    "simulation.time_step": ("?", ["simulation.time_step=0.5", "simulation.time_step=1e-5",
        "simulation.time_step=0.05; control.kind=none",
        "flow.0.length_scale=0.1; flow.0.mean=[3.0, 0.0]",
        WAVES.replace("?", "0.1, peak_period=0.8}]; water.depth=20.0; simulation.time_step=0.1")
        + "; arm.youngs_modulus=2e4",
        "base.motion=[{kind='sine', channel='heave', amplitude=1e-3, frequency_hz=30.0}]",
        "obstacle=[{kind='sphere', position=[4.0, -10.2], radius=0.01, velocity=[-3.0, 0.0]}]",
        GAUSS.replace("?", "0.1, correlation_time=0.02"), "base.channels.tilt.bandwidth_hz=40",
        "flow.0.ramp_time=0.03"], ["simulation.time_step=0.02"]),
    "simulation.integrator": (EULER + "?", ["; simulation.time_step=0.025"], [""]),
    "output.interval": ("output.interval=?", ["0.5"], ["0.1"]),
}
TURNS = {
    **{f"base.{turn}_deg": f"base.{turn}_deg=?" for turn in ("tilt", "pan", "roll")},
    "base.motion.*.phase_deg": "base.motion=[{kind='sine', channel='sway', amplitude=0.1, "
                               "frequency_hz=0.1, phase_deg=?}]",
    "flow.*.phase_deg": "flow=[{kind='sine', amplitude=[1, 0, 0], frequency_hz=1, phase_deg=?}]",
    "flow.*.direction_deg":
        WAVES.replace("?", "0.1, peak_period=5, direction_deg=?}]; water.depth=20.0"),
    "flow.*.heading_deg": "flow=[{kind='measured', file='no.csv', heading_deg=?}]",
    "target.phase_deg": "target={path='circle', radius=0.1, period=5, phase_deg=?}",
}
# fmt: on
CASES |= {key: (turn, ["1000"], ["-90"], "station-keeping-3d") for key, turn in TURNS.items()}


TRIED_ELSEWHERE = {("load",)}  # loads of packages: tests/assembly/test_door.py


def rules_of(case: str) -> list[Rule]:
    """Return the rules on the keys of a case."""
    keys = case.split(" against ")[0].split(", ")
    return [rule for rule in RULES if all(any(matches(k, p) for p in keys) for k in rule.keys)]


def matches(key: str, pattern: str) -> bool:
    return re.fullmatch(re.escape(pattern).replace(r"\*", r"[^.]+") + r"(\..*)?", key) is not None


def warnings_of(rules: list[Rule], settings: list[str], scenario: str = TURBULENT) -> list[str]:
    facts = Facts(Prepared(crinoid.load(scenario, settings)))
    return [note for rule in rules for note in rule.warnings(facts)]


def warnings_about(scenario: str | None = None, settings: list[str] = (), **tables) -> list[str]:
    """Return the doubts about a scenario of a file with settings, or of tables."""
    case = crinoid.load(scenario, list(settings)) if scenario else crinoid.Scenario(**tables)
    return plausibility_warnings(Prepared(case))


def test_every_rule_warns_in_some_case():
    for rule in (each for each in RULES if each.keys not in TRIED_ELSEWHERE):
        assert any(
            warnings_of([rule], setting.replace("?", value).split("; "), *built_in)
            for case, (setting, odd, _, *built_in) in CASES.items()
            for value in (odd if rule in rules_of(case) else ())
        ), rule.keys


@pytest.mark.parametrize("case", CASES)
def test_rules_warn_of_odd_values_and_no_others(case):
    rules, (setting, odd, plausible, *built_in) = rules_of(case), CASES[case]
    for value in odd:
        found = warnings_of(rules, setting.replace("?", value).split("; "), *built_in)
        assert found, value
        for note in found:
            key = note.split(":")[0]
            assert any(matches(key, pattern) for rule in rules for pattern in rule.keys), note
            assert "\n" not in note
    for value in plausible:
        assert warnings_of(rules, setting.replace("?", value).split("; "), *built_in) == []


@pytest.mark.parametrize("built_in", builtin_names())
def test_nothing_is_odd_about_the_built_in_scenarios(built_in):
    for _, case in crinoid.load(built_in).cases():
        assert plausibility_warnings(Prepared(case)) == []


def test_a_rule_compares_a_thread_with_the_sections_along_it():
    rule = next(rule for rule in RULES if "chamber.*.max_pressure" in rule.keys)
    tapered = ["arm.radius=[0.02, 0.005]", "arm.youngs_modulus=1e6"]
    chamber = "chamber=[{{span={}, offset=4e-3, area=5e-4, max_pressure=1.2e5}}]"
    for span, strain in (([0.0, 0.1], 0.056), ([0.9, 1.0], 0.764)):
        found = warnings_of([rule], [*tapered, chamber.format(span)])
        assert bool(found) == (strain > 0.5)
        assert not found or f"stretches it by {100 * strain:.3g}%" in found[0]
    # along an arm whose stiffness falls with the fourth power of its radius
    given = chamber.format([0.0, 1.0]).replace("5e-4", "2.5e-4").replace("4e-3", "8e-3")
    (found,) = warnings_of([rule], [*tapered, given])
    ends = [1e6 * np.pi / 4 * radius**3 for radius in (0.02, 0.005)]
    length = crinoid.load(TURBULENT).arm.length
    turns = 30.0 * 8e-3 * length / 0.015 / 3 * (1 / ends[1] - 1 / ends[0]) / (2 * np.pi)
    assert float(found.split("into ")[1].split()[0]) == pytest.approx(turns, rel=0.03)


def test_the_defaults_are_plausible():
    pinned, nothing = {"mount": "pinned", "tilt_deg": -90.0}, {"density": 0.0, "gravity": 0.0}
    for tables in ({}, {"arm": {"dimension": 3}}, {"base": pinned}, {"water": nothing}):
        assert warnings_about(**tables) == []


def test_a_note_says_key_value_and_likely_cause():
    assert warnings_about(TURBULENT, ["arm.radius=15"]) == [
        "arm.radius: got 15.0 m (radius / length = 30); usual is 0.0001 to 0.1. Is it in mm?"
    ]


def test_a_command_gets_warnings_about_what_it_uses_only():
    values = ["sensor.delay=10", "base.tilt_deg=0.785", "flow.0.mean=[6.0, 0.0]"]
    odd = crinoid.load(TURBULENT, [*values, "simulation.time_step=0.005"])
    which = {"run": (), "still": AT_REST, "flow": IN_THE_WATER}
    told = {name: plausibility_warnings(Prepared(odd), tables) for name, tables in which.items()}
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
    found = warnings_about(arm=arm, target={**ROUND, "normal": normal})
    assert [note.split(":")[0] for note in found] == ["target.radius"] * far
    assert not far or f"a target {farthest:.4g} m from the base" in found[0]


def test_rules_judge_series_from_files_as_they_judge_lists(tmp_path):
    (tmp_path / "path.csv").write_text("time,x,z\n-9,900,0\n0,0.3,-10\n10,0.3,-9.8\n99,800,0\n")
    path = {"path": "file", "file": str(tmp_path / "path.csv")}
    assert warnings_about(target=path, simulation={"duration": 10.0}) == []
    (note,) = warnings_about(target=path, simulation={"duration": 50.0})
    assert note.startswith("target.file: got ")
    assert "a target 800.1 m from the base" in note


SCALED = {
    "station-keeping": "arm.radius arm.length arm.youngs_modulus flow.0.amplitude.0 target.tip.0",
    "debris-strike": "obstacle.0.radius obstacle.0.mass",
    "wave-zone": "flow.0.peak_period flow.0.significant_height",
    "trace-circle-3d": "target.radius",
    "constant-load": "water.gravity",
}


@pytest.mark.parametrize("size", [1e-308, 1e-160, 1e160, 1e300])
@pytest.mark.parametrize(
    ("built_in", "key"),
    [(built_in, key) for built_in, keys in SCALED.items() for key in keys.split()],
)
def test_numbers_beyond_what_can_be_computed_do_not_stop_the_rules(built_in, key, size):
    try:
        found = warnings_about(built_in, [f"{key}={size}"])
    except crinoid.ScenarioError:  # refused before
        return
    assert all(re.match(r"[a-z_0-9.*]+: ", note) and "\n" not in note for note in found)
    if size > 1:
        assert found


def test_what_follows_from_an_odd_arm_goes_without_saying():
    both = warnings_about(TURBULENT, ["arm.youngs_modulus=0.004", "sensor.delay=10"])
    assert [note.split(":")[0] for note in both] == ["arm.youngs_modulus"]


def test_the_periods_of_cantilevers_are_those_on_paper():
    bending, mass = np.full(2, 0.3), np.full(2, 1.7)
    scale = math.sqrt(0.3 / 1.7) / 0.8**2 / (2 * math.pi)
    for clamped, roots in ((True, [1.875104, 4.694091, 7.854757]), (False, [3.926602, 7.068583])):
        found = bending_frequencies(0.8, bending, mass, clamped=clamped)[: len(roots)]
        np.testing.assert_allclose(found, np.square(roots) * scale, rtol=1e-4)  # Blevins 2016
    # a cone that ends in a point: Conway, Becker and Dubil 1964
    sharp = bending_frequencies(0.8, np.array([0.3, 0.0]), np.array([1.7, 1e-9]), taper=1e-4)
    assert sharp[0] == pytest.approx(8.719 * scale, rel=0.01)
