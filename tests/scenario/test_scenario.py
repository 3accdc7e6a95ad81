"""A scenario says what it takes, refuses the rest in one line, and survives being written."""

import itertools
import json
import math
import pickle
import re
import tomllib
from pathlib import Path

import numpy as np
import pytest

from crinoid.scenario import (
    DistributedLoad,
    Plane,
    Scenario,
    ScenarioError,
    Simulation,
    Target,
    TipLoad,
    UniformFlow,
    builtin_files,
    builtin_names,
    builtin_text,
    json_schema,
    library,
    load,
)
from crinoid.scenario.arm import Arm
from crinoid.scenario.base import Base
from crinoid.scenario.base_motion import TableMotion
from crinoid.scenario.document import anchor, parse, value_at
from crinoid.scenario.kinds import unit_at
from crinoid.scenario.obstacle import Capsule
from crinoid.scenario.quantity import unit_vector
from helpers.refusals import mistake, refused, written_and_answered

MISTAKES = written_and_answered(Path(__file__).with_name("mistakes.txt"))

FULL = """
flow = [
  {kind = "shear", reference_depth = 1, roughness_length = 0.001, ramp_time = 0.5, velocity = [
    0.3, 0]},
  {kind = "gust", velocity = [0.1, 0.1], duration = 1.5},
  {kind = "sine", amplitude = [0, 0.1], frequency_hz = 0.3333333333333333},
  {kind = "gauss-markov", mean = [0.1, 0], standard_deviation = [0.02, 0], correlation_time = 2},
  {kind = "turbulence", mean = [0.1, 0], intensity = 0.1, length_scale = 0.5, modes = 64},
]
[arm]
length = 0.6
radius = [0.02, 0.01]
[base]
position = [0.1, -5]
tilt_deg = -90
motion = [
    {channel = "tilt", kind = "sine", amplitude_deg = 3.0, frequency_hz = 0.1},
    {channel = "heave", kind = "table", time = [0.0, 1.0, 2.0], value = [0.0, 0.1, 0.0]},
]
[base.channels]
slide = {range = [-0.1, 0.3]}
heave = {}
tilt = {range_deg = [0, 45]}
[water]
depth = 20
[[load]]
kind = "distributed"
direction = "tangential"
magnitude = -0.1
[[load]]
kind = "tip"
moment = 1e-3
follower = true
[target]
time = [0, 1]
tip = [[0.6, -5], [0.5, -5.1]]
[simulation]
duration = 2
[vary]
"load.0.magnitude" = [0.25, 1]
"load.0.direction" = ["normal", [0.0, -1.0]]
"""
SPATIAL = """
flow = [{kind = "measured", file = "current.nc"}]
obstacle = [
  {kind = "cylinder", position = [1, 0, -5], axis = [0, 3, 4], radius = 0.1},
  {kind = "plane", position = [0, 0, -9], normal = [0, 0, 2], velocity = "flow"},
]
[arm]
dimension = 3
rest_curvature = [0.1, -0.2, 0.3]
section = {EI = [0.02, 0.01], GJ = 0.005}
[base]
position = [0.1, 0.2, -5]
tilt_deg = -90
pan_deg = 30
roll_deg = 45
channels = {roll = {range_deg = [-10, 20]}, sway = {}, pan = {}, slide = {}}
motion = [
    {channel = "sway", kind = "sine", amplitude = 0.1, frequency_hz = 0.1},
    {channel = "roll", kind = "table", time = [0.0, 2.0], value_deg = [0.0, 90.0]},
]
[target]
time = [0, 1]
tip = [[0.6, 0, -5], [0.5, 0.1, -5.1]]
direction = [[1, 0, 0], [0, 3, 4]]
[control]
kind = "pid"
controlled = ["x", "y", "direction"]
pid = {roll = {kp = 1}, pan = {kp = 1}, slide = {kp = 1}}
[simulation]
duration = 2
"""


@pytest.mark.parametrize(("text", "answer"), MISTAKES["in the plane"])
def test_a_mistake_gives_one_line(text, answer):
    assert mistake(Scenario.from_toml, text) == answer


@pytest.mark.parametrize(("text", "answer"), MISTAKES["in space"])
def test_a_mistake_in_space_gives_one_line(text, answer):
    assert mistake(Scenario.from_toml, f"arm.dimension = 3\n{text}") == answer


def test_mistakes_of_many_cases_give_one_line():
    many = f'vary = {{"arm.length" = {[1.0] * 101}, "arm.density" = {[1.0] * 100}}}'
    line = mistake(Scenario.from_toml, many)
    assert line == "vary: gives 10100 cases; must give at most 10000"


def test_each_vector_of_the_other_dimension_gives_its_line():
    planar = Scenario.from_toml(FULL).to_dict() | {"vary": {}}
    planar["arm"]["dimension"] = 3
    assert [each.key for each in refused(Scenario.from_dict, planar).mistakes] == [
        "base.position",
        *("flow.0.velocity", "flow.1.velocity", "flow.2.amplitude"),
        *("flow.3.mean", "flow.3.standard_deviation", "flow.4.mean"),
        *("load.1.force", "load.1.moment", "target.tip", "target.angle_deg"),
    ]


def test_each_mistake_gives_its_line():
    text = 'arm = {length = -1, nodes = 2}\nwater.depht = 3\nload = [{kind = "push"}]'
    keys = [line.split(":")[0] for line in refused(Scenario.from_toml, text).lines]
    assert keys == ["arm.length", "arm.nodes", "water.depht", "load.0.kind"]


def test_a_file_that_holds_no_scenario_gives_one_line(tmp_path):
    (tmp_path / "broken.toml").write_text("[arm]\nlength = 0..5\n")
    (tmp_path / "binary.toml").write_bytes(b"title = '\xff'")
    for name, words in {
        "broken.toml": "not valid TOML: .*line 2, column 11",
        "binary.toml": ".*byte 9",
        "nothing.toml": "no such file or built-in scenario",
        ".": ".*is a folder; must be a TOML file",
    }.items():
        path = tmp_path / name
        assert re.match(f"{re.escape(str(path))}: {words}", mistake(load, path))


def test_mistakes_in_python_give_the_same_lines():
    text = "got -1.0; must be a number above 0 (m)"
    assert refused(lambda: Scenario(arm={"length": -1.0})).lines == [f"arm.length: {text}"]
    assert str(refused(lambda: Arm(length=-1.0))) == f"length: {text}"
    line = refused(lambda: Scenario(flow=[TipLoad(moment=1.0)])).lines[0]
    assert line.startswith('flow.0.kind: got "tip"; must be "gauss-markov"')


def test_error_survives_pickling():
    error = refused(lambda: Scenario(seed=-1))
    assert pickle.loads(pickle.dumps(error)).lines == error.lines


def test_python_values_round_trip():
    scenario = Scenario(
        arm=Arm(radius=(0.02, 0.01)),
        base=Base(motion=[TableMotion(channel="slide", time=np.arange(3.0), value=np.zeros(3))]),
        load=[DistributedLoad(direction=(0, -1), magnitude=1)],
        flow=(UniformFlow(velocity=np.array([0.1, 0.0])),),
        simulation=Simulation(duration=2.0),
        vary={"flow.0.velocity": [np.array([0.1, 0.0]), (0.2, 0)]},
    )
    assert scenario.flow[0].velocity == (0.1, 0.0)
    assert scenario.base.motion[0].time == (0.0, 1.0, 2.0)
    assert Scenario.from_toml(scenario.to_toml()) == scenario


def test_default_scenario_is_valid_and_says_everything():
    scenario = Scenario()
    document = tomllib.loads(scenario.to_toml())
    assert Scenario.from_dict(document) == scenario == Scenario.from_toml("")
    assert document["arm"]["length"] == 0.5
    assert document["simulation"]["max_halvings"] == 12
    assert "\nposition = [0.0, -10.0]\n" in scenario.to_toml()


def test_a_scenario_cannot_be_changed():
    scenario = Scenario()
    with pytest.raises(ValueError, match="frozen"):
        scenario.arm.length = 1.0
    assert scenario.arm.length == 0.5


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "full.toml"
    path.write_text(FULL)
    return path


def test_overrides_in_one_text_are_refused(path):
    assert mistake(load, path, "seed=3").startswith('overrides: got "seed=3"; must be a list of ')


def test_overrides(path):
    scenario = load(
        path,
        [
            "arm.length = 0.7",
            "load.0.magnitude=0.5",
            "load.0.direction=normal",
            "flow.1.velocity.0=1",
            "control.kind=none",
            "title=no quotes, please",
            "base.channels.slide.max_speed=1.5",
            'vary."load.0.direction"=["tangential"]',
        ],
    )
    assert scenario.arm.length == 0.7
    assert scenario.load[0] == DistributedLoad(direction="normal", magnitude=0.5)
    assert scenario.flow[1].velocity == (1.0, 0.1)
    assert scenario.control.kind == "none"
    assert scenario.title == "no quotes, please"
    assert scenario.base.channels.slide.max_speed == 1.5
    assert len(scenario.cases()) == 2


def test_overrides_make_what_is_missing(path):
    path.write_text("")
    scenario = load(path, ["flow.0.kind=uniform", "flow.0.velocity=[1, 0]", "arm.section.EA=10"])
    assert scenario.flow == (UniformFlow(velocity=(1.0, 0.0)),)
    assert scenario.arm.section.EA == 10.0


def test_the_name_of_a_table_in_a_list_is_its_index():
    named = ["chamber.0.name=lift", "chamber.lift.max_pressure=5e4", "vary={}"]
    scenario = load("reach-pressure", named)
    assert scenario.chamber[0].max_pressure == 5e4
    other = scenario.with_values({"chamber.lift.offset.1": 0.007, "seed": 3})
    assert other == scenario.with_values({"chamber.0.offset.1": 0.007, "seed": 3})
    assert value_at(other.to_dict(), "chamber.lift.offset.1") == 0.007
    assert value_at(other.to_dict(), "chamber.left.offset") is None
    varied = scenario.with_values({"vary": {"chamber.lift.max_pressure": [4e4, 6e4]}})
    assert [case.chamber[0].max_pressure for _, case in varied.cases()] == [4e4, 6e4]
    schema = json_schema()
    for key in ("chamber.lift.max_pressure", "chamber.0.max_pressure"):
        assert unit_at(schema, key) == "Pa"
    twice = {"chamber.0.area": 1e-4, "chamber.lift.area": 2e-4}
    assert mistake(scenario.with_values, twice) == (
        "chamber.lift.area: got chamber.0.area too, which is the same; must name it once"
    )
    assert mistake(load, "reach-pressure", ["chamber.left.area=1e-4"]) == (
        'chamber.left.area: unknown key; must be an index into chamber from 0 to 1, or "lift". '
        "Use 1 to add an entry."
    )


def test_a_scenario_says_its_tables_in_a_few_lines():
    scenario = load("coral-touch", ["vary={'seed'=[1,2],'arm.length'=[0.4,0.5,0.6]}"])
    told = str(scenario).splitlines()
    assert repr(scenario) == str(scenario)
    assert told[0] == f'Scenario of "{scenario.title}"'
    assert {line.split()[0]: line.split(maxsplit=1)[1] for line in told[1:]} == {
        "arm": "0.5 m in the plane, 21 nodes, radius 0.015 m, E = 4e+06 Pa",
        "base": "at [0.0, -10.0] m, clamped",
        "inputs": "slide (m), tilt (rad)",
        "flow": "uniform",
        "also": "obstacle sphere",
        "control": "pid at 100 Hz",
        "time": "20 s in steps of 0.01 s, seed 0",
        "vary": "6 cases over seed, arm.length",
    }
    assert "m, EI = 0.03 N m2" in str(Scenario(arm={"section": {"EI": 0.03}}))
    octopus = str(load("octopus-3d"))
    assert "chamber_4 (share), ... 15 more" in octopus
    hostile = Scenario(title="<b>&")._repr_html_()
    assert "&lt;b&gt;&amp;" in hostile
    assert "<td>0.5 m in the plane" in hostile


@pytest.mark.parametrize(("setting", "answer"), MISTAKES["in a setting"])
def test_a_mistake_in_a_setting_gives_one_line(path, setting, answer):
    assert mistake(load, path, [setting, "vary={}"]) == answer


def test_cases_are_every_combination():
    scenario = Scenario.from_toml(FULL)
    cases = scenario.cases()
    expected = list(itertools.product([0.25, 1], ["normal", [0.0, -1.0]]))
    assert [tuple(values.values()) for values, _ in cases] == expected
    for values, case in cases:
        assert case.load[0].magnitude == values["load.0.magnitude"]
        assert case.load[0].direction in ("normal", (0.0, -1.0))
        assert case.vary == {}
        assert case.arm == scenario.arm
        assert case.cases() == [({}, case)]


def test_cases_may_vary_a_whole_table_or_an_integrator():
    scenario = Scenario(
        vary={
            "load": [[], [{"kind": "tip", "moment": 1.0}]],
            "simulation.integrator": ["newmark", "implicit-euler", "generalized-alpha"],
        }
    )
    cases = [case for _, case in scenario.cases()]
    assert [len(case.load) for case in cases] == [0, 0, 0, 1, 1, 1]
    assert [case.simulation.integrator_options for case in cases[:3]] == [
        {"beta": 0.25, "gamma": 0.5},
        {},
        {"spectral_radius": 0.8},
    ]


def test_rates_and_interval_follow_the_time_step():
    fine, coarse = (
        Scenario(simulation={"time_step": step, "duration": 1.0}) for step in (0.004, 0.05)
    )
    assert (fine.rate_hz(None), fine.control_rate_hz) == (100.0, 100.0)
    assert (coarse.rate_hz(None), coarse.control_rate_hz) == (20.0, 20.0)
    assert (fine.output_steps, coarse.output_steps) == (5, 1)
    assert math.isclose(fine.output_interval, 0.02)
    assert fine.simulation.steps == 250


def test_rate_of_once_a_time_step_passes_in_spite_of_rounding():
    step = 1 / 3 * 0.01
    scenario = Scenario(
        simulation={"time_step": step, "duration": 300 * step}, control={"rate_hz": 300.0}
    )
    assert scenario.control_rate_hz * step == pytest.approx(1.0)


def test_conveniences_are_in_si_units():
    scenario = Scenario.from_toml(FULL)
    limits = scenario.base.channels.present["tilt"].limits
    assert limits.high == pytest.approx(math.pi / 4)
    assert limits.speed == pytest.approx(math.pi / 2)
    assert list(scenario.base.channels.present) == ["slide", "heave", "tilt"]
    assert scenario.base.motion[0].size_si == pytest.approx(math.radians(3))
    assert scenario.base.motion[1].size_si == (0.0, 0.1, 0.0)
    assert scenario.arm.radius == (0.02, 0.01)
    assert scenario.flow[0].power_exponent is None
    assert scenario.target.tip_path == ((0.6, -5.0), (0.5, -5.1))
    assert scenario.target.angle_path_deg is None


def test_conveniences_of_a_spatial_arm_are_in_si_units():
    scenario = Scenario.from_toml(SPATIAL)
    assert scenario.arm.rest_curvature == (0.1, -0.2, 0.3)
    assert scenario.arm.section.EI == (0.02, 0.01)
    assert scenario.base.angles == pytest.approx((math.pi / 6, -math.pi / 2, math.pi / 4))
    assert list(scenario.base.channels.present) == ["slide", "sway", "pan", "roll"]
    assert scenario.base.channels.present["roll"].limits.high == pytest.approx(math.pi / 9)
    assert list(scenario.control.pid.present) == ["slide", "pan", "roll"]
    assert scenario.base.motion[0].size_si == 0.1
    assert scenario.base.motion[1].size_si == pytest.approx((0.0, math.pi / 2))
    assert scenario.flow[0].velocity == ("u", "v", "w")
    assert scenario.target.tip_path == ((0.6, 0.0, -5.0), (0.5, 0.1, -5.1))
    assert scenario.target.direction_path == ((1.0, 0.0, 0.0), (0.0, 0.6, 0.8))
    assert scenario.target.steady_direction is None
    assert Target(direction=(0.0, 0.0, 2.0)).steady_direction == (0.0, 0.0, 1.0)
    assert Target().steady_direction is Target().direction_path is None


def test_obstacles_have_the_axes_of_the_arm():
    pole, floor = Scenario.from_toml(SPATIAL).obstacle
    assert pole.half_axis == pytest.approx((0.0, 600.0, 800.0))
    assert pole.out == floor.half_axis == (0.0, 0.0, 0.0)
    assert floor.out == (0.0, 0.0, 1.0)
    rod = Capsule(position=(0.0, 0.0), radius=0.1, axis=(3.0, 0.0, 4.0), length=2.0)
    assert rod.half_axis == pytest.approx((0.6, 0.8))
    assert rod.out == (0.0, 0.0)
    assert Plane(position=(0.0, 0.0), normal=(0.0, -2.0)).out == (0.0, -1.0)


OPEN = """
load = [{kind = "tip", moment = 1.0}, {kind = "tip", force = [1.0, 0.0]}]
obstacle = [{kind = "sphere", position = [1.0, -10.0], radius = 0.1}]
flow = [{kind = "measured", file = "current.nc"}]
"""


def defaults(case: Scenario) -> tuple:
    """Return everything of a scenario whose default follows the dimension."""
    force, moment = case.load[0].force, case.load[1].moment
    velocities = (case.obstacle[0].velocity, case.flow[0].velocity)
    return (case.base.position, case.control.controlled, force, moment, *velocities)


def test_defaults_follow_the_dimension():
    planar = Scenario.from_toml(OPEN)
    assert defaults(planar) == ((0.0, -10.0), ("x", "z"), (0.0, 0.0), 0.0, (0.0, 0.0), ("u", "w"))
    given = {
        "arm.dimension": 3,
        "load.0.moment": [0.0, -1.0, 0.0],
        "load.1.force": [1.0, 0.0, 0.0],
        "obstacle.0.position": [1.0, 0.0, -10.0],
    }
    spatial = planar.with_values(given)
    nought = (0.0, 0.0, 0.0)
    expected = ((0.0, 0.0, -10.0), ("x", "y", "z"), nought, nought, nought, ("u", "v", "w"))
    assert defaults(spatial) == expected
    # what was left out goes on following the dimension, but what was given or written does not
    longer = spatial.with_values({"arm.length": 0.7})
    back = {
        "arm.dimension": 2,
        "load.0.moment": 1.0,
        "load.1.force": [1.0, 0.0],
        "obstacle.0.position": [1.0, -10.0],
    }
    assert defaults(longer.with_values(back)) == defaults(planar)
    with pytest.raises(ScenarioError, match=r"base\.position: got \[0\.0, 0\.0, -10\.0\]"):
        Scenario.from_toml(longer.to_toml()).with_values(back)


def test_values_of_the_caller_stay_as_they_are():
    values = {"flow": [{"kind": "uniform", "velocity": [0.1, 0.0]}], "flow.0.velocity": [0.3, 0.0]}
    assert Scenario().with_values(values).flow[0].velocity == (0.3, 0.0)
    assert values["flow"][0]["velocity"] == [0.1, 0.0]


def test_a_default_may_be_changed_in_part():
    assert Scenario().with_values({"base.position.1": -5.0}).base.position == (0.0, -5.0)
    spatial = Scenario(arm={"dimension": 3}).with_values({"base.position.1": -5.0})
    assert spatial.base.position == (0.0, -5.0, -10.0)


def test_the_dimension_may_be_set_and_varied(path):
    path.write_text("[base]\ntilt_deg = -45.0")
    spatial = load(path, ["arm.dimension=3", "base.pan_deg=10"])
    assert spatial.base.position == (0.0, 0.0, -10.0)
    assert spatial == Scenario.from_toml(spatial.to_toml())
    both = load(path, ["vary={'arm.dimension' = [2, 3]}"])
    assert Scenario.from_toml(both.to_toml()) == both
    for study in (both, Scenario.from_toml(both.to_toml())):
        cases = [case for _, case in study.cases()]
        assert [len(case.base.position) for case in cases] == [2, 3]
        assert cases == [Scenario.from_toml(case.to_toml()) for case in cases]


def test_a_controller_can_be_switched_off_with_its_feed_forward():
    controlled = Scenario(
        base={"channels": {"slide": {}}},
        control={"kind": "pid", "pid": {"slide": {"kp": 1.0}}},
        target={"path": "line", "velocity": [0.01, 0.0], "feed_forward": True},
    )
    assert controlled.driven == ("slide",)
    idle = controlled.with_values(controlled.idle_values)
    assert (idle.control.acts, idle.driven, idle.control.gains) == (False, (), {})
    assert idle.control.pid == controlled.control.pid


def test_schema_describes_every_key():
    schema = json_schema()
    text = json.dumps(schema)
    tables = [schema, *schema["$defs"].values()]
    keys = [key for table in tables for key in table["properties"].items()]
    assert [name for name, key in keys if not key.get("description")] == []
    assert schema["$schema"].endswith("2020-12/schema")
    assert schema["$defs"]["Arm"]["properties"]["length"]["unit"] == "m"
    references = {part.split('"')[0] for part in text.split('"#/$defs/')[1:]}
    assert references == set(schema["$defs"])


def test_built_in_scenarios_load():
    assert builtin_names()
    for name in builtin_names():
        scenario = load(name)
        document = parse(builtin_text(name))
        anchor(document, Path(library.__file__).parent / "library")
        assert scenario == Scenario.from_dict(document)
        assert scenario.title
        assert all(path.is_file() for path in builtin_files(name))


def test_unknown_built_in_scenario():
    near = f"{builtin_names()[0]}s"
    with pytest.raises(ScenarioError, match=f"did you mean {builtin_names()[0]}"):
        load(near)
    with pytest.raises(ScenarioError, match=r"^nowhere: no such built-in scenario"):
        builtin_text("nowhere")


@pytest.mark.parametrize("size", [5e-324, 1e-200, 1.0, 1e200, 1.7e308])
def test_a_unit_vector_has_a_length_of_one_however_long_the_vector_is(size):
    np.testing.assert_allclose(unit_vector((size, -size, size)), np.array([1, -1, 1]) / 3**0.5)


def test_opposite_directions_are_refused_however_long_they_are():
    time = {"time": [0.0, 1.0]}
    for size in (1e-200, 1e200):
        target = {"direction": [[size, 0.0, 0.0], [-size, 0.0, 0.0]], **time}
        with pytest.raises(
            ScenarioError, match=r"target.direction.1: got .*; must differ from the opposite"
        ):
            Scenario(arm={"dimension": 3}, target=target)
        target = {"direction": [[size, 0.0, 0.0], [0.0, size, 0.0]], **time}
        assert Scenario(arm={"dimension": 3}, target=target).target.direction_path[1] == (0, 1, 0)
