"""Rules doubt odd numbers of a scenario before it runs, and no plausible ones."""

import math
import re
from types import SimpleNamespace
from typing import Annotated, Literal

import numpy as np
import pytest
from pydantic import Field

import crinoid
from crinoid.assembly.facts import bending_frequencies
from crinoid.assembly.prepared import Prepared
from crinoid.diagnostics.plausibility import IN_THE_WATER, RULES, plausibility_warnings
from crinoid.scenario import builtin_names, kinds
from crinoid.scenario.scenario import AT_REST
from crinoid.tables import LoadTable, Newtons, Quantity, Seconds

# A built-in scenario, an odd value of one of its keys (or with what it needs), and how the note
# begins. still-water: EI = 0.0628 N m2: Euler at 0.62 N, Beck at 5.0 N, Greenhill at 3.9 N/m.
# fmt: off
ODD = [
    ("station-keeping", "arm.length=500", "arm.length: got 500.0 m; usual is 0.01 to 100 m. Is"),
    ("station-keeping", "arm.length=5e-4", "arm.length: got 0.0005 m"),
    ("station-keeping", "arm.radius=15", "arm.radius: got 15.0 m (radius / length = 30)"),
    ("station-keeping", "arm.radius=1e-5", "arm.radius: got 1e-05 m"),
    ("station-keeping", "arm.density=1.08", "arm.density: got 1.08 kg/m3"),
    ("station-keeping", "arm.density=1.08e6", "arm.density: got 1080000.0 kg/m3"),
    ("station-keeping", "arm.youngs_modulus=4.0", "arm.youngs_modulus: got 4.0 Pa; usual is"),
    ("station-keeping", "arm.youngs_modulus=4e3", "arm.youngs_modulus: got 4000 Pa (drag times"),
    ("swing-up", "arm.youngs_modulus=7.7e3", "arm.youngs_modulus: got 7700 Pa (weight in water"),
    ("swing-up", "control.kind=none", "arm.youngs_modulus: got 7.7e+06 Pa; the arm points up and"),
    ("floating", "arm.section.EI=1e-4", "arm.section.EI: got 0.0001 N m2 (weight"),
    ("tool", "arm.section.mass_per_length=1360", "arm.section.mass_per_length: got 1360.0 (dens"),
    ("tool", "arm.section.displaced_area=12.6", "arm.section.displaced_area: got 12.6 (density"),
    ("tool", "arm.section.diameter=40", "arm.section.diameter: got 40.0 m (diameter / 2 arm.rad"),
    ("still-water", "arm.damping_time=50", "arm.damping_time: got 50.0 s (damping_time / first"),
    ("station-keeping", "water.density=1.025", "water.density: got 1.025 kg/m3 (density outside"),
    ("station-keeping", "water.density=1.025e6", "water.density: got 1025000.0 kg/m3"),
    ("station-keeping", "water.kinematic_viscosity=1.2", "water.kinematic_viscosity: got 1.2 m2"),
    ("constant-load", "water.gravity=981", "water.gravity: got 981.0 m/s2"),
    ("constant-load", "water.gravity=1", "water.gravity: got 1.0 m/s2"),
    ("curl", "base.position=[0, 10]", "base.position.1: got 10 m, above the water"),
    ("swing-up", "base.position=[0, -0.2]", "base.position.1: got -0.2 m; the arm leaves the wat"),
    ("wave-zone", "base.position=[0, -9.9]", "base.position.1: got -9.9 m; the arm reaches z = -"),
    ("swing-up", "base.channels.slide.range=[-500, 500]", "base.channels.slide.range: got [-500"),
    ("swing-up", "base.channels.slide.range=[-5e-4, 5e-4]", "base.channels.slide.range: got [-0.0"),
    ("tool", "base.channels.tilt.range_deg=[-0.9, 0.9]", "base.channels.tilt.range_deg: got [-0.9"),
    ("tool", "base.channels.slide.max_speed=500", "base.channels.slide.max_speed: got 500.0 m/s"),
    ("swing-up", "base.channels.slide.max_speed=2e-3", "base.channels.slide.max_speed: got 0.002"),
    ("tool", "base.channels.slide.max_acceleration=3e3", "base.channels.slide.max_acceleration: "),
    ("tool", "base.channels.slide.max_acceleration=3e-3", "base.channels.slide.max_acceleration"),
    ("tool", "base.channels.tilt.max_speed_deg=3.14", "base.channels.tilt.max_speed_deg: got 3.1"),
    ("tool", "base.channels.tilt.max_acceleration_deg=12.6", "base.channels.tilt.max_accelerati"),
    ("tool", "base.tilt_deg=-0.785", "base.tilt_deg: got -0.785 degrees; 0.785 rad are 45 degre"),
    ("tool", "base.channels.tilt.range_deg=[-1.047, 1.047]", "base.channels.tilt.range_deg: got "),
    ("swing-up", "target.angle_deg=1.571", "target.angle_deg: got 1.571 degrees"),
    ("wave-zone", "flow.1.direction_deg=3.14", "flow.1.direction_deg: got 3.14 degrees"),
    ("station-keeping", "flow.1.length_scale=1e3", "flow.1.length_scale: got 1000.0 m"),
    ("station-keeping", "flow.1.length_scale=0.05", "flow.1.length_scale: got 0.05 m"),
    ("curl", "flow=[{kind='uniform', velocity=[30, 0.0]}]", "flow.0: got a flow of up to 30 m/s;"),
    ("curl",
        "flow=[{kind='shear', velocity=[9, 0], reference_depth=1.0, exponent=0.14}]",
        "flow.0: got a flow of up to 9 m/s"),
    ("curl",
        "flow=[{kind='gauss-markov', mean=[0.2, 0.0], standard_deviation=10, correlation_time=2}]",
        "flow.0: got a flow of up to 20.2"),
    ("station-keeping", "flow.0.amplitude=[30, 0]", "flow.0: got a flow of up to 30 m/s"),
    ("station-keeping", "flow.1.mean=[0, 30]", "flow.1: got a flow of up to "),
    ("tidal-channel", "flow.0.velocity_scale=33", "flow.0: got a flow of up to "),
    ("wave-zone", "flow.1.peak_period=6e3", "flow.1.peak_period: got 6000.0 s"),
    ("curl", "flow=[{kind='regular-wave', height=0.5, period=0.17}]", "flow.0.period: got 0.17 s"),
    ("curl", "flow=[{kind='regular-wave', height=3, period=2}]", "flow.0.height: got 3.0 m (heigh"),
    ("wave-zone", "flow.1.significant_height=7", "flow.1.significant_height: got 7.0 m (height"),
    ("wave-zone", "flow.1.significant_height=4", "flow.1.significant_height: got 4.0 m (depth of"),
    ("buoy-sea", "base.position=[0, 0, -1.5]; water.depth=1.8", "flow.0: got a significant"),
    ("buoy-sea", "base.position=[0, 0, -1.0]", "flow.0: got a significant height of 1.21 m"),
    ("ship-wake", "flow.0.speed=2", "flow.0.speed: got 2.0 m/s (speed / sqrt(g length) = 0.261)"),
    ("ship-wake", "flow.0.distance=2", "flow.0.distance: got 2.0 m (distance / length = 0.333)"),
    ("ship-wake", "flow.0.beam=2", "flow.0.beam: got 2.0 m (beam / length = 0.333)"),
    ("ship-wake", "flow.0.time=25", "flow.0.time: got 25.0 s (time left when the wake arrives"),
    ("gust-front", "flow.0.start=60", "flow.0.start: got 60.0 s (time left in the run = "),
    ("push-recover", "simulation.duration=4", "load.0.start: got 5.0 s"),
    ("tool", "tool.from=13.5; simulation.duration=12", "tool.from: got 13.5 s"),
    ("curl",
        "chamber.0.schedule.time=[1e3, 2e3]; chamber.0.schedule.share=[0, 1]",
        "chamber.0.schedule.time: got [1000.0, 2000.0] s"),
    ("coral-touch", "target.time=[5e3, 13e3]", "target.time: got [5000.0, 13000.0] s"),
    ("floating", "target.start=30", "target.start: got 30.0 s"),
    ("tool", "control.start=30", "control.start: got 30.0 s (time left in the run = -10 s)"),
    ("tool", "sensor.delay=30", "sensor.delay: got 30.0 s (time left in the run"),
    ("push-recover", "sensors.0.delay=90", "sensors.0.delay: got 90.0 s (time left in the run"),
    ("tool", "sensor.delay=10", "sensor.delay: got 10.0 s (delay / first period"),
    ("tool", "sensor.noise_position=1", "sensor.noise_position: got 1.0 m"),
    ("swing-up", "load.0.force=[200, 0]", "load.0.force: got [200.0, 0.0] N (force times L^2 / EI"),
    ("constant-load", "load.0.magnitude=500", "load.0.magnitude: got 500.0 N/m (magnitude times "),
    ("still-water", "load.0.moment=9", "load.0.moment: got 9.0 N m (moment times L / EI"),
    ("still-water", "load=[{kind='tip', force=[-0.65, 0]}]", "load.0.force: got [-0.65, 0.0] N, w"),
    ("still-water", "load=[{kind='tip', force=[-5.3, 0], follower=true}]", "load.0.force: got [-5"),
    ("still-water",
        "load=[{kind='distributed', direction=[-1, 1], magnitude=6}]",
        "load.0.magnitude: got 6.0 N/m, which pushes"),
    ("tool", "tool.mass=200", "tool.mass: got 200.0 kg (weight in water"),
    ("tool", "tool.offset=30", "tool.offset: got 30.0 m (size / arm.length = 60)"),
    ("reach-under-load", "tool.radius=20", "tool.radius: got 20.0 m"),
    ("floating", "vehicle.mass=0.02", "vehicle.mass: got 0.02 kg"),
    ("floating", "vehicle.volume=20", "vehicle.volume: got 20.0 m3"),
    ("floating", "vehicle.volume=1e-3", "vehicle.volume: got 0.001 m3"),
    ("floating", "vehicle.inertia=9e3", "vehicle.inertia: got 9000.0 kg m2"),
    ("floating", "vehicle.inertia=9e-4", "vehicle.inertia: got 0.0009 kg m2"),
    ("debris-strike", "obstacle.1.mass=275", "obstacle.1.mass: got 275.0 kg (density"),
    ("debris-strike", "obstacle.1.mass=2.7e-4", "obstacle.1.mass: got 0.00027 kg"),
    ("curl", "chamber.0.max_pressure=5e7", "chamber.0.max_pressure: curls the free arm into "),
    ("curl", "chamber.0.max_pressure=50", "chamber.0.max_pressure: curls the free arm into 0.0"),
    ("reach-pressure", "chamber.0.area=1.0", "chamber.0.max_pressure: curls"),
    ("still-water",
        "chamber=[{drive='volume', offset=8e-3, area=2e-4, bulk_modulus=1e6, max_volume=2e-3}]",
        "chamber.0.max_volume: curls"),
    ("still-water", "tendon=[{offset=8e-3, max_tension=1e3}]", "tendon.0.max_tension: curls"),
    ("still-water",
        "tendon=[{drive='length', offset=8e-3, stiffness=1e4, max_shortening=0.4}]",
        "tendon.0.max_shortening: curls"),
    ("coral-touch", "target.tip=[[-171, -10.47], [-0.03, -10.47]]", "target.tip: got [[-171.0"),
    ("spiral", "target.tip=[0.3, 0.3, -0.3]", "target.tip: got [0.3, 0.3, -0.3], a target 9.709"),
    ("reach-under-load", "target.to=[400, -10.3]", "target.to: got [400.0, -10.3], a target"),
    ("floating", "target.radius=100", "target.radius: got 100.0"),
    ("trace-circle", "target.centre=[0.9, -9.9]", "target.centre: got [0.9, -9.9]"),
    ("still-water",
        "target={path='sine', amplitude=[0.0, 100.0], frequency_hz=0.1}",
        "target.amplitude: got [0.0, 100.0], a target 100"),
    ("wave-zone", "flow.1.ramp_time=0",
        'target.tip: got "initial", the pose in the water of t = 0, where flow.1 (waves) is at a'),
    ("reach-under-load", "arm.length=0.6", "control.neural.weights: the policy has not met arm."),
    ("reach-under-load", "sensor.noise_position=1e-3", "control.neural.weights: the policy has"),
    ("still-water", "simulation.time_step=0.5", "simulation.time_step: got 0.5 s, 0.4 time steps"),
    ("tool", "base.channels.tilt.bandwidth_hz=40", "simulation.time_step: got 0.01 s, 2.5 time"),
    ("still-water",
        "base.motion=[{kind='sine', channel='heave', amplitude=1e-3, frequency_hz=30}]",
        "simulation.time_step: got 0.01 s, 3.3 time steps in base.motion.0, 0.033 s"),
    ("floating", "target.period=5e-3", "simulation.time_step: got 0.01 s, 0.5 time steps in the"),
    ("station-keeping", "flow.0.frequency_hz=30", "simulation.time_step: got 0.01 s, 3.3 time"),
    ("gust-front", "flow.1.duration=0.02", "simulation.time_step: got 0.01 s, 2 time steps in f"),
    ("still-water",
        "flow=[{kind='gauss-markov', mean=[0, 0], standard_deviation=0.1, correlation_time=0.02}]",
        "simulation.time_step: got 0.01 s, 2 time steps in the correlation time of flow.0"),
    ("still-water",
        "flow=[{kind='regular-wave', height=0.01, period=0.3}]; simulation.time_step=0.02",
        "simulation.time_step: got 0.02 s, 15 time steps in the waves of flow.0, 0.3 s"),
    ("station-keeping", "flow.1.mean=[1.5, 0]; flow.1.length_scale=0.09", "simulation.time_step"),
]
PLAUSIBLE = [
    ("station-keeping", "arm.length=0.6"),
    ("station-keeping", "water.density=1.2"),
    ("swing-up", "arm.youngs_modulus=7.7e7"),
    ("station-keeping", "base.tilt_deg=-0.5"),
    ("wave-zone", "water.depth=20.0"),
    ("wave-zone", "flow.1.significant_height=1.0"),
    ("station-keeping", "flow.1.mean=[1.0, 0.0]"),
    ("station-keeping", "base.position=[0.0, -5e3]"),
    ("curl", "base.motion=[{kind='sine', channel='heave', amplitude=0.3, frequency_hz=0.2}]"),
    ("still-water", "load=[{kind='tip', force=[-0.6, 0]}]"),
    ("still-water", "load=[{kind='tip', force=[3, 0]}]"),
    ("still-water",
        "chamber=[{drive='volume', offset=8e-3, area=2e-4, bulk_modulus=1e6, max_volume=2e-6}]"),
    ("still-water", "tendon=[{drive='length', offset=8e-3, stiffness=1e4, max_shortening=0.02}]"),
    ("still-water", "tendon=[{offset=8e-3, max_tension=1.0}]"),
    ("floating", "vehicle.volume=0.02"),
    ("tool", "sensor.delay=0.1"),
    ("reach-under-load", "control.start=2"),
    ("still-water", "simulation.time_step=0.02"),
    ("still-water", "target={tip=[0.3, -0.3], frame='base'}"),
    ("reach-under-load", "arm.youngs_modulus=4.4e6"),
    ("reach-under-load", "seed=7"),
]
# fmt: on


def warnings_about(scenario: str | None = None, settings: list[str] = (), **tables) -> list[str]:
    """Return the doubts about a scenario with settings, or of tables."""
    case = crinoid.load(scenario, list(settings)) if scenario else crinoid.Scenario(**tables)
    return plausibility_warnings(Prepared(case))


@pytest.mark.parametrize(("scenario", "odd", "note"), ODD)
def test_an_odd_value_has_a_note_with_its_key(scenario, odd, note):
    found = warnings_about(scenario, odd.split("; "))
    assert [each for each in found if each.startswith(note)], found
    assert all("\n" not in each for each in found)


@pytest.mark.parametrize(("scenario", "value"), PLAUSIBLE)
def test_a_plausible_value_has_no_note(scenario, value):
    assert warnings_about(scenario, [value]) == []


def test_every_rule_has_an_odd_value():
    left = list(RULES)
    for scenario, odd, _ in ODD:
        facts = Prepared(crinoid.load(scenario, odd.split("; "))).facts
        left = [rule for rule in left if not any(True for _ in rule.notes(facts))]
    assert left == []


@pytest.mark.parametrize("built_in", builtin_names())
def test_nothing_is_odd_about_the_built_in_scenarios(built_in):
    for _, case in crinoid.load(built_in).cases():
        assert plausibility_warnings(Prepared(case)) == []


def test_a_rule_compares_a_thread_with_the_sections_along_it():
    tapered = ["arm.radius=[0.02, 0.005]", "arm.youngs_modulus=1e6"]
    chamber = "chamber=[{{span={}, offset=4e-3, area=5e-4, max_pressure=1.2e5}}]"
    for span, strain in (([0.0, 0.1], 0.056), ([0.9, 1.0], 0.764)):
        found = warnings_about("still-water", [*tapered, chamber.format(span)])
        curls = [note for note in found if note.startswith("chamber.0.max_pressure: curls")]
        assert bool(curls) == (strain > 0.5)
        assert not curls or f"stretches it by {100 * strain:.3g}%" in curls[0]
    # along an arm whose stiffness falls with the fourth power of its radius
    given = chamber.format([0.0, 1.0]).replace("5e-4", "2.5e-4").replace("4e-3", "8e-3")
    (found,) = (n for n in warnings_about("still-water", [*tapered, given]) if "curls" in n)
    ends = [1e6 * np.pi / 4 * radius**3 for radius in (0.02, 0.005)]
    length = crinoid.load("still-water").arm.length
    turns = 30.0 * 8e-3 * length / 0.015 / 3 * (1 / ends[1] - 1 / ends[0]) / (2 * np.pi)
    assert float(found.split("into ")[1].split()[0]) == pytest.approx(turns, rel=0.03)


class Whirl(LoadTable):
    kind: Literal["whirl"] = "whirl"
    magnitude: Newtons = Field(ge=0, description="Size of the force.")
    moment: Annotated[float, Quantity("N m")] = Field(default=0.0, description="Moment.")
    period: Seconds = Field(default=1.0, description="Time of a turn; negative: clockwise.")
    frequency_hz: float = Field(default=900.0, description="Has no unit.")

    @property
    def force(self):
        """Not a key."""
        return 1e9

    def build(self, scenario):
        raise AssertionError


@pytest.mark.parametrize(
    ("odd", "note"),
    [
        ({"magnitude": 200.0}, "load.0.magnitude: got 200.0 N (magnitude times L^2 / EI = 796)"),
        ({"moment": 9.0}, "load.0.moment: got 9.0 N m (moment times L / EI = 71.6)"),
        ({"period": 0.02}, "simulation.time_step: got 0.01 s, 2 time steps in load.0, 0.02 s"),
        ({"period": -0.02}, "simulation.time_step: got 0.01 s, 2 time steps in load.0, 0.02 s"),
        ({}, None),
    ],
)
def test_a_new_kind_of_load_is_judged_by_the_units_of_its_keys(monkeypatch, odd, note):
    whirl = SimpleNamespace(load=lambda: Whirl)
    monkeypatch.setattr(kinds, "installed", lambda group: {"whirl": whirl})
    case = crinoid.load("still-water").model_dump(exclude_unset=True)
    found = warnings_about(**case | {"load": [{"kind": "whirl", "magnitude": 0.1} | odd]})
    assert len(found) == (note is not None)
    assert note is None or found[0].startswith(note)


def test_the_defaults_are_plausible():
    pinned, nothing = {"mount": "pinned", "tilt_deg": -90.0}, {"density": 0.0, "gravity": 0.0}
    for tables in ({}, {"arm": {"dimension": 3}}, {"base": pinned}, {"water": nothing}):
        assert warnings_about(**tables) == []


def test_a_note_says_key_value_and_likely_cause():
    assert warnings_about("coral-touch", ["sensor.noise_position=1"]) == [
        "sensor.noise_position: got 1.0 m (noise / arm.length = 2); usual is up to 0.05. "
        "Is it in mm?"
    ]


def test_a_command_gets_warnings_about_what_it_uses_only():
    values = ["sensor.delay=10", "base.tilt_deg=0.785", "water.kinematic_viscosity=1.2"]
    odd = crinoid.load("sampling", values)
    which = {"run": (), "still": AT_REST, "flow": IN_THE_WATER}
    told = {name: plausibility_warnings(Prepared(odd), tables) for name, tables in which.items()}
    tables = {name: {note.split(".")[0] for note in notes} for name, notes in told.items()}
    assert tables["run"] == {"water", "base", "sensor"}
    assert tables["still"] == {"water", "base"}
    assert tables["flow"] == {"water"}


def test_rules_judge_series_from_files_as_they_judge_lists(tmp_path):
    (tmp_path / "path.csv").write_text("time,x,z\n-9,900,0\n0,0.3,-10\n10,0.3,-9.8\n99,800,0\n")
    path = {"path": "file", "file": str(tmp_path / "path.csv")}
    assert warnings_about(target=path, simulation={"duration": 10.0}) == []
    (note,) = warnings_about(target=path, simulation={"duration": 50.0})
    assert note.startswith("target.file: got ")
    assert "a target 800.1 m or more from the base" in note


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


def test_an_odd_arm_or_water_hides_no_other_note():
    for key, value in (("arm.youngs_modulus", "4e3"), ("water.density", "1.025")):
        odd = [f"{key}={value}", "base.channels.slide.max_speed=500", "control.start=60"]
        found = warnings_about("station-keeping", odd)
        assert {each.split("=")[0] for each in odd} <= {note.split(":")[0] for note in found}


def test_tables_of_a_list_with_the_same_fault_have_one_note():
    found = warnings_about("octopus", ["arm.youngs_modulus=1e8"])
    (note,) = (each for each in found if each.startswith("chamber"))
    assert note.startswith("chamber.0.max_pressure: curls")
    assert note.endswith("(19 more of chamber.*.max_pressure)")


def test_the_periods_of_cantilevers_are_those_on_paper():
    bending, mass = np.full(2, 0.3), np.full(2, 1.7)
    scale = math.sqrt(0.3 / 1.7) / 0.8**2 / (2 * math.pi)
    for clamped, roots in ((True, [1.875104, 4.694091, 7.854757]), (False, [3.926602, 7.068583])):
        found = bending_frequencies(0.8, bending, mass, clamped=clamped)[: len(roots)]
        np.testing.assert_allclose(found, np.square(roots) * scale, rtol=1e-4)  # Blevins 2016
    # a cone that ends in a point: Conway, Becker and Dubil 1964
    sharp = bending_frequencies(0.8, np.array([0.3, 0.0]), np.array([1.7, 1e-9]), taper=1e-4)
    assert sharp[0] == pytest.approx(8.719 * scale, rel=0.01)
