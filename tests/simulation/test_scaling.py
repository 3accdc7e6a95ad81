"""A problem with other units of length, time and mass: under every controller the same motion."""

import re
import tomllib

import numpy as np
import pytest

from crinoid import load, simulate
from crinoid.scenario import Scenario
from crinoid.scenario.model import Model
from crinoid.scenario.quantity import unit_of

pytestmark = pytest.mark.release

LENGTH, TIME, MASS = 2.0, 4.0, 3.0
BASE = {"m": (1, 0, 0), "s": (0, 1, 0), "kg": (0, 0, 1), "N": (1, -2, 1), "Pa": (-1, -2, 1)}
BASE |= {"Hz": (0, -1, 0), "degrees": (0, 0, 0), "1": (0, 0, 0), "": (0, 0, 0)}


def factor(unit):
    """Return by how much a number of a unit such as ``N s/m2`` is larger in the other problem."""
    found = np.zeros(3)
    for sign, part in zip((1, -1), unit.partition("/")[::2], strict=True):
        for name, power in re.findall(r"([A-Za-z]+|1)(\d*)", part):
            found += sign * np.array(BASE[name]) * int(power or 1)
    return float(np.prod(np.array([LENGTH, TIME, MASS]) ** found))


def times(value, ratio):
    if isinstance(value, list):
        return [times(each, ratio) for each in value]
    return value if isinstance(value, (str, bool)) else ratio * value


def in_other_units(found, model):
    """Return a table of TOML with each number in the other units."""
    keys = type(model).model_json_schema()["properties"] if isinstance(model, Model) else {}
    names = {field.alias or name: name for name, field in type(model).model_fields.items()}
    other = {}
    for key, value in found.items():
        part = getattr(model, names.get(key, key))
        if isinstance(value, dict):
            other[key] = in_other_units(value, part)
        elif isinstance(value, list) and value and isinstance(value[0], dict):
            other[key] = [in_other_units(*each) for each in zip(value, part, strict=True)]
        else:
            unit = unit_of(keys[key])
            other[key] = times(value, factor(unit)) if unit else value
    return other


def scaled(scenario):
    """Return the same problem in the other units: defaults of keys as well."""
    return Scenario(**in_other_units(tomllib.loads(scenario.to_toml()), scenario))


SHORT = {
    "arm.nodes": 5,
    "simulation.duration": 1.2,
    "control.compare": False,
    "output.interval": 0.05,
    # defaults that no key writes down are in seconds
    "control.rate_hz": 100.0,
    "sensor.rate_hz": 100.0,
    "control.mpc.horizon": 0.4,
}
METER = {"kind": "current", "points": [[0.0, 0.25]], "noise": 0.005, "rate_hz": 100.0}
SHAPE = {"kind": "shape", "stations": [0.2, 0.6], "rate_hz": 50.0, "delay": 0.02}


@pytest.mark.parametrize(
    ("name", "kind", "values"),
    [
        ("station-keeping", "pid", {"control.start": 0.4}),
        ("station-keeping", "lqg", {"sensors": [SHAPE]}),
        ("trace-circle", "lqg", {}),
        ("trace", "lqg", {"simulation.duration": 0.6}),
        ("wave-zone", "mpc", {}),
        ("station-keeping", "mpc", {"control.mpc.current": "known"}),
        ("station-keeping", "mpc", {"control.mpc.current": "measured", "sensors": [METER]}),
        ("trace-circle", "mpc", {"control.mpc.model": "scheduled"}),
        ("swing-up", "hybrid", {"arm.nodes": 7, "sensors.0.rate_hz": 100.0}),
    ],
)
def test_a_controller_knows_no_units(name, kind, values):
    scenario = load(name).with_values(SHORT | values | {"control.kind": kind})
    other = scaled(scenario)
    assert other.arm.length == LENGTH * scenario.arm.length
    both = (scenario, other)
    found, same = (simulate(each).dataset["tip_error"].values / each.arm.length for each in both)
    assert np.ptp(found) > 1e-4
    np.testing.assert_allclose(same, found, rtol=0, atol=1e-6)
