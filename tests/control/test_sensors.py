"""Measurands, against what is known of a shape, a weight and a current."""

import equinox as eqx
import jax
import numpy as np
import pytest

import crinoid
from crinoid.assembly.control_loop import build_sensors
from crinoid.foundation.fixed_numbers import SKIN
from crinoid.scenario import Scenario
from helpers.refusals import refused

STATIONS = [0.1, 0.5, 0.9]
FLOW = {"kind": "shear", "velocity": [0.3, 0.0], "reference_depth": 2.0, "exponent": 0.5}
POINTS = [[0.0, 0.0], [0.5, 1.0]]
KINDS = [
    {"kind": "shape", "stations": STATIONS, "noise": 0.2},
    {"kind": "wrench", "noise_force": 0.1, "noise_moment": 0.02, "resolution_force": 0.5},
    {"kind": "current", "points": POINTS},
    {"kind": "current", "name": "upstream", "points": POINTS},
    {"kind": "inclination", "stations": STATIONS, "noise_deg": 1.0, "rate_hz": 20.0},
]


AXES = pytest.mark.parametrize("axes", [2, 3])


def vector(axes, x, z):
    return [x, z] if axes == 2 else [x, 0.0, z]


def scenario(axes=2, **changes):
    curvature = 1.5 if axes == 2 else [0.0, 1.5, 0.7]
    points = {"points": [vector(axes, *point) for point in POINTS]}
    tables = {
        "arm": {"dimension": axes, "nodes": 9, "length": 0.5, "rest_curvature": curvature},
        "base": {"position": vector(axes, 0.0, -10.0), "tilt_deg": 30.0},
        "water": {"depth": 20.0, "gravity": 9.81},
        "flow": [FLOW | {"velocity": vector(axes, 0.3, 0.0)}],
        "sensors": [kind | (points if "points" in kind else {}) for kind in KINDS],
    }
    return Scenario.from_dict(tables | changes)


@eqx.filter_jit
def measured(system, sensors):
    state = system.rest()
    return state, {name: each.of(system, state) for name, each in sensors.items()}


def watch(described):
    """Return an arm's state without load, and what each sensor but that of the tip measures."""
    sensors = {each.name: each.measurand for each in build_sensors(described)[1:]}
    return measured(crinoid.system(described), sensors)


@AXES
def test_sensors_measure_shape_wrench_current_and_inclination(axes):
    state, values = watch(scenario(axes))
    shape = [1.5] * 3 if axes == 2 else [0.0, 1.5, 0.7] * 3
    np.testing.assert_allclose(values["shape"], shape, atol=1e-9)
    wrench = np.concatenate([state.base_force, np.ravel(state.base_moment)])
    np.testing.assert_allclose(values["wrench"], wrench, rtol=1e-12)
    flow = np.asarray(values["current"]).reshape(2, axes)
    # 10 and 11 m above the bed, 18 m where the velocity is given
    np.testing.assert_allclose(flow[:, 0], 0.3 * np.sqrt(np.array([10.0, 11.0]) / 18.0), rtol=1e-9)
    np.testing.assert_allclose(flow[:, 1:], 0.0)
    leaning = np.deg2rad(30.0) + 1.5 * 0.5 * np.array(STATIONS)
    if axes == 2:
        np.testing.assert_allclose(values["inclination"], leaning, atol=1e-9)
    else:  # turned out of the plane by its twist
        assert float(values["inclination"][0]) == pytest.approx(leaning[0], abs=0.02)


@pytest.mark.slow
@AXES
def test_contact_is_the_force_of_the_skin_on_the_edges_that_feel(axes):
    # a straight arm of four edges, half of its skin deep in a slanting plane along it
    radius, modulus, normal = 0.02, 5e5, [0.0, 0.6, 0.8] if axes == 3 else [0.0, 1.0]
    base = np.array(vector(axes, 0.0, -10.0))
    deep = base - np.array(normal) * radius * (1 + 0.5 * SKIN)
    spans = {"whole": (0.0, 1.0), "half": (0.5, 1.0), "end": (0.9, 1.0), "across": (0.2, 0.51)}
    described = scenario(
        axes,
        arm={"dimension": axes, "nodes": 5, "radius": radius, "youngs_modulus": modulus},
        base={"position": base.tolist()},
        flow=[],
        obstacle=[{"kind": "plane", "position": deep.tolist(), "normal": normal}],
        sensors=[{"kind": "contact", "name": name, "span": spans[name]} for name in spans],
    )
    pressed = 32 * modulus * radius**2 * 0.5**4
    edges = {"whole": 4, "half": 2, "end": 1, "across": 3}
    for name, force in watch(described)[1].items():
        np.testing.assert_allclose(force, edges[name] * pressed * np.array(normal), rtol=1e-9)


@AXES
def test_every_value_has_a_name_noise_and_a_resolution(axes):
    by_name = {each.name: each for each in build_sensors(scenario(axes))}
    assert list(by_name) == ["tip", "shape", "wrench", "current", "upstream", "inclination"]
    for sensor in by_name.values():
        names = [name for name, _ in sensor.measurand.names(axes)]
        assert len(set(names)) == len(names) == sensor.noise.size == sensor.resolution.size
    np.testing.assert_allclose(by_name["shape"].noise, 0.2)
    moments = 1 if axes == 2 else 3
    np.testing.assert_allclose(by_name["wrench"].noise, [0.1] * axes + [0.02] * moments)
    np.testing.assert_allclose(by_name["wrench"].resolution, [0.5] * axes + [0.0] * moments)
    np.testing.assert_allclose(by_name["inclination"].noise, np.deg2rad(1.0))
    assert float(by_name["inclination"].clock.period) == 0.05
    # no two have the same noise
    keys = {np.asarray(jax.random.key_data(each.key)).tobytes() for each in by_name.values()}
    assert len(keys) == len(by_name)


MISTAKES = {
    'sensors.0.kind: got "sonar"; must be "contact", "current"': [{"kind": "sonar"}],
    "sensors.0.stations.0: got 1.5; must": [{"kind": "shape", "stations": [1.5]}],
    "sensors.0.stations: got []; must be a list of": [{"kind": "shape", "stations": []}],
    'sensors.1.name: got "wrench"; must differ from the name of sensors.0': [{"kind": "wrench"}]
    * 2,
    'sensors.0.name: got "Wrench 1"; must': [{"kind": "wrench", "name": "Wrench 1"}],
    'sensors.0.name: got "tip"; must differ from': [{"kind": "wrench", "name": "tip"}],
    "sensors.0.points: got": [{"kind": "current", "points": [[0.0, 0.0, 1.0]]}],
    "sensors.0.delay: got 1000000.0; must be at most 100 (s)": [{"kind": "wrench", "delay": 1e6}],
    "sensors.0.span: got [0.5, 0.5]; must be [a, b]": [{"kind": "contact", "span": [0.5, 0.5]}],
    "sensors.0.rate_hz: got 1000.0; must be at most 100 (Hz)": [{"kind": "wrench", "rate_hz": 1e3}],
    'sensors.0.kind: got "contact"; must have an obstacle to touch. Add an [[obstacle]].': [
        {"kind": "contact"}
    ],
}


@pytest.mark.parametrize("line", MISTAKES)
def test_a_mistake_is_refused_in_one_line(line):
    lines = refused(Scenario.from_dict, {"sensors": MISTAKES[line]}).lines
    assert any(each.startswith(line) for each in lines), lines
