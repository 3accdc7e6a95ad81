"""Any scenario reads back as it was written."""

import random

import pytest

import crinoid
from crinoid.scenario import Scenario, ScenarioError, builtin_names, json_schema, load
from crinoid.scenario.model import Model
from crinoid.scenario.real_numbers import real_numbers

PLANAR = r"""
title = "quoted \" \n\t\u0001\u007f ä€😀 #"
arm.relaxation = [{ratio = 0.2, time = 0.5}]
water = {coefficients = "literature", depth = 30, vortices = {model = "wake-oscillator"}}
flow = [
  {kind = "regular-wave", height = 0.3, period = 3},
  {kind = "shear", velocity = [0.1, 0], reference_depth = 1},
  {kind = "gauss-markov", mean = [0.1, 0], standard_deviation = 0.02, correlation_time = 2},
  {kind = "gust", velocity = [0.1, 0.1], duration = 1.5},
  {kind = "sine", amplitude = [0, 0.1], frequency_hz = 0.3333333333333333},
  {kind = "measured", file = "a.csv", speed = "s", direction = "d", heading_deg = 9},
]
sensors = [
  {kind = "current", name = "a", points = [[0, -9]]},
  {kind = "shape", name = "b", stations = [0.1, 1]},
  {kind = "wrench", name = "c"},
]
simulation = {integrator = "implicit-euler"}
chamber = [{offset = 0.01, area = 2e-4, max_volume = 1e-5, drive = "volume", bulk_modulus = 1e6}]
tendon = [
  {offset = 0.01, drive = "length", max_shortening = 0.1, stiffness = 500},
  {offset = 0.01, drive = "tension", max_tension = 10, schedule = {time = [0, 1], share = [1, 0]}},
]
target = {path = "sine", frame = "base", amplitude = [0.1, 0], frequency_hz = 0.1}
base = {mount = "pinned", channels = {slide = {}}, motion = [
  {kind = "velocity", channel = "slide", velocity = 0.1},
  {kind = "file", channel = "heave", file = "a.csv", interpolation = "smooth"},
  {kind = "table", channel = "heave", time = [0, 20], value = [0, 0.1]},
]}
obstacle = [
  {kind = "seabed", file = "b.nc", height = "z"},
  {kind = "capsule", position = [1, -9], radius = 0.1, length = 1, velocity = "flow"},
]
control = {kind = "mpc", mpc = {current = "measured"}}
vary = {"arm.length" = [0.4, 0.5], "obstacle.1.velocity" = ["flow", [0.1, 0]]}
"""
SPATIAL = """
arm.dimension = 3
arm.loss_factor = {value = 0.1, band_hz = [0.1, 10]}
arm.fatigue = {slope = 3, intercept = 1e30}
vehicle = {mass = 20, inertia = 1, hold = "free", hull = {length = 0.6, diameter = 0.3}}
control = {kind = "lqg", lqg = {inputs = ["vehicle"]}}
contact.self = true
"""
VESSEL = """
target = {path = "file", file = "a.csv"}
[[base.motion]]
kind = "vessel"
file = "b.csv"
interpolation = "monotone"
columns = {surge = "0"}
[[base.motion]]
kind = "sine"
channel = "tilt"
amplitude_deg = 1
frequency_hz = 0.1
[[flow]]
kind = "waves"
spectrum = {file = "s.nc", heading_deg = 90, select = {time = 3}}
"""
SCENARIOS = {name: Scenario.from_toml(globals()[name]) for name in ("PLANAR", "SPATIAL", "VESSEL")}
SCENARIOS |= {name: load(name) for name in builtin_names()}


def others(scenario, source):
    """Yield the scenario, and some with a few of its numbers changed that are accepted as well."""
    yield scenario
    numbers = [*real_numbers(scenario)]
    for _ in range(8):
        factors = 1.0, -1.0, 0.0, 1e-300, 1e300, *(2 ** source.uniform(-1, 1) for _ in range(9))
        few = source.sample(numbers, 3)
        try:
            yield scenario.with_values({n.key: n.value * source.choice(factors) for n in few})
        except ScenarioError:
            continue


@pytest.mark.parametrize("name", SCENARIOS)
def test_a_scenario_reads_back_as_it_was_written(name):
    for scenario in others(SCENARIOS[name], random.Random(name)):
        text = scenario.to_toml()
        again = Scenario.from_toml(text)
        assert again == scenario, text
        assert again.to_toml() == text


def tables(table):
    """Yield the names of all tables of a scenario."""
    yield type(table).__name__
    for _, value in table:
        for each in value if isinstance(value, tuple) else (value,):
            if isinstance(each, Model):
                yield from tables(each)


def test_every_kind_of_table_is_in_one_of_these_scenarios():
    seen = {name for scenario in SCENARIOS.values() for name in tables(scenario)}
    assert set(json_schema()["$defs"]) - seen == {"ActuatorTable"}  # of packages


def test_what_text_cannot_hold_is_refused_before_it_is_run():
    with pytest.raises(ScenarioError, match="got a scenario that TOML cannot hold; must read back"):
        crinoid.system(Scenario(title="\ud800"))
