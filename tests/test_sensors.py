"""Measurands, against what is known of a shape, a weight and a current."""

import re

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import crinoid
from crinoid.assembly.sensor import build_sensors
from crinoid.elements.contact import SKIN
from crinoid.scenario import Scenario

STATIONS = [0.1, 0.5, 0.9]
FLOW = {"kind": "shear", "velocity": [0.3, 0.0], "reference_depth": 2.0, "exponent": 0.5}
POINTS = [[0.0, 0.0], [0.5, 1.0]]
KINDS = [
    {"kind": "shape", "stations": STATIONS, "noise": 0.2},
    {"kind": "wrench", "noise_force": 0.1, "noise_moment": 0.02, "resolution_force": 0.5},
    {"kind": "current", "points": POINTS},
    {"kind": "current", "name": "upstream", "points": [[-1.0, 0.0]]},
    {"kind": "inclination", "stations": STATIONS, "noise_deg": 1.0, "rate_hz": 20.0},
]


def scenario(**changes):
    tables = {
        "arm": {"nodes": 9, "length": 0.5, "rest_curvature": 1.5},
        "base": {"position": [0.0, -10.0], "tilt_deg": 30.0},
        "water": {"depth": 20.0, "gravity": 9.81},
        "flow": [FLOW],
        "sensors": KINDS,
    }
    return Scenario.from_dict(tables | changes)


def in_space(**changes):
    points = {"points": [[x, 0.0, z] for x, z in POINTS]}
    kinds = [kind | (points if "points" in kind else {}) for kind in KINDS]
    tables = {
        "arm": {"dimension": 3, "nodes": 9, "length": 0.5, "rest_curvature": [0.0, 1.5, 0.7]},
        "base": {"position": [0.0, 0.0, -10.0], "tilt_deg": 30.0},
        "flow": [FLOW | {"velocity": [0.3, 0.0, 0.0]}],
        "sensors": kinds,
    }
    return scenario(**tables | changes)


@pytest.fixture(scope="module", params=[scenario, in_space], ids=["plane", "space"])
def watched(request):
    """Return a system, its state without load, and what each sensor measures there."""
    described = request.param()
    system = crinoid.system(described)
    sensors = build_sensors(described)

    @eqx.filter_jit
    def measured(system):
        state = system.rest()
        return state, {each.name: each.measurand.of(system, state) for each in sensors}

    return system, *measured(system)


def test_the_shape_is_that_of_the_arm_at_rest(watched):
    system, _, values = watched
    expected = [1.5] * 3 if system.forces.axes == 2 else [0.0, 1.5, 0.7] * 3
    np.testing.assert_allclose(values["shape"], expected, atol=1e-9)


def test_the_wrench_is_that_of_the_base(watched):
    system, state, values = watched
    axes = system.forces.axes
    np.testing.assert_allclose(values["wrench"][:axes], state.base_force, rtol=1e-12)
    np.testing.assert_allclose(values["wrench"][axes:], jnp.ravel(state.base_moment), rtol=1e-12)


def test_the_current_is_that_at_the_points(watched):
    system, _, values = watched
    found = np.asarray(values["current"]).reshape(2, system.forces.axes)
    # 10 and 11 m above the bed, 18 m where the velocity is given
    np.testing.assert_allclose(found[:, 0], 0.3 * np.sqrt(np.array([10.0, 11.0]) / 18.0), rtol=1e-9)
    np.testing.assert_allclose(found[:, 1:], 0.0)


def test_the_inclination_follows_the_curvature(watched):
    system, _, values = watched
    if system.forces.axes == 3:  # turned out of the plane by its twist
        assert float(values["inclination"][0]) == pytest.approx(np.deg2rad(30) + 0.075, abs=0.02)
        return
    expected = np.deg2rad(30.0) + 1.5 * 0.5 * np.array(STATIONS)
    np.testing.assert_allclose(values["inclination"], expected, atol=1e-9)


@pytest.mark.parametrize("axes", [2, 3])
def test_contact_is_the_force_of_the_skin_on_the_edges_that_feel(axes):
    # a straight arm of four edges, half of its skin deep in a slanting plane along it
    radius, modulus, normal = 0.02, 5e5, [0.0, 0.6, 0.8] if axes == 3 else [0.0, 1.0]
    deep = np.array([0.0] * (axes - 1) + [-10.0]) - np.array(normal) * radius * (1 + 0.5 * SKIN)
    spans = {"whole": (0.0, 1.0), "half": (0.5, 1.0), "end": (0.9, 1.0), "across": (0.2, 0.51)}
    described = scenario(
        arm={"dimension": axes, "nodes": 5, "radius": radius, "youngs_modulus": modulus},
        base={"position": [0.0] * (axes - 1) + [-10.0]},
        flow=[],
        obstacle=[{"kind": "plane", "position": deep.tolist(), "normal": normal}],
        sensors=[{"kind": "contact", "name": name, "span": spans[name]} for name in spans],
    )
    _, *sensors = build_sensors(described)

    @eqx.filter_jit
    def measured(system):
        state = system.rest()
        return {each.name: each.measurand.of(system, state) for each in sensors}

    pressed = 32 * modulus * radius**2 * 0.5**4
    edges = {"whole": 4, "half": 2, "end": 1, "across": 3}
    for name, force in measured(crinoid.system(described)).items():
        np.testing.assert_allclose(force, edges[name] * pressed * np.array(normal), rtol=1e-9)


def test_contact_without_an_obstacle_is_refused():
    line = (
        'sensors.0.kind: got "contact", where there is nothing to touch; '
        "takes an [[obstacle]] with it"
    )
    with pytest.raises(crinoid.ScenarioError, match=f"^{re.escape(line)}$"):
        scenario(sensors=[{"kind": "contact"}])


@pytest.mark.parametrize("make", [scenario, in_space])
def test_every_value_has_a_name_noise_and_a_resolution(make):
    described = make()
    axes = described.arm.dimension
    sensors = build_sensors(described)
    assert [each.name for each in sensors] == [
        "tip", "shape", "wrench", "current", "upstream", "inclination",
    ]  # fmt: skip
    for sensor in sensors:
        names = [name for name, _ in sensor.measurand.names(axes)]
        assert len(set(names)) == len(names) == sensor.noise.size == sensor.resolution.size
    by_name = {each.name: each for each in sensors}
    np.testing.assert_allclose(by_name["shape"].noise, 0.2)
    moments = 1 if axes == 2 else 3
    np.testing.assert_allclose(by_name["wrench"].noise, [0.1] * axes + [0.02] * moments)
    np.testing.assert_allclose(by_name["wrench"].resolution, [0.5] * axes + [0.0] * moments)
    np.testing.assert_allclose(by_name["inclination"].noise, np.deg2rad(1.0))
    assert float(by_name["inclination"].clock.period) == 0.05


def test_no_two_sensors_have_the_same_noise():
    keys = [each.key for each in build_sensors(scenario())]
    drawn = {np.asarray(jax.random.key_data(key)).tobytes() for key in keys}
    assert len(drawn) == len(keys)


MISTAKES = {
    'sensors.0.kind: got "sonar", takes "contact", "current"': [{"kind": "sonar"}],
    "sensors.0.stations.0: got 1.5, takes": [{"kind": "shape", "stations": [1.5]}],
    "sensors.0.stations: got [], takes a list of": [{"kind": "shape", "stations": []}],
    'sensors.1.name: got "wrench", as sensors.0 is called': [{"kind": "wrench"}] * 2,
    'sensors.0.name: got "Wrench 1", takes': [{"kind": "wrench", "name": "Wrench 1"}],
    'sensors.0.name: got "tip", as the sensor of the tip': [{"kind": "wrench", "name": "tip"}],
    "sensors.0.points: got": [{"kind": "current", "points": [[0.0, 0.0, 1.0]]}],
    "sensors.0.delay: got 1000000.0, takes up to 100 (s)": [{"kind": "wrench", "delay": 1e6}],
    "sensors.0.span: got [0.5, 0.5], takes [a, b] with 0 <= a < b <= 1": [
        {"kind": "contact", "span": [0.5, 0.5]}
    ],
    "sensors.0.rate_hz: got 1000.0, takes up to 100 (Hz)": [{"kind": "wrench", "rate_hz": 1e3}],
}


@pytest.mark.parametrize("line", MISTAKES)
def test_mistakes_are_told_in_one_line(line):
    with pytest.raises(crinoid.ScenarioError) as caught:
        scenario(sensors=MISTAKES[line])
    assert any(each.startswith(line) for each in caught.value.lines), caught.value.lines
