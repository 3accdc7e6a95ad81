"""Scenarios of closed loops."""

import numpy as np
import xarray as xr

import crinoid
from crinoid.foundation.result_variables import Variable, of_dimension
from crinoid.results.result import Result

# one shape of arm, flows and controller for all tests: they share their compiled code
GAINS = {"slide": {"kp": 0.3, "ki": 2.0}, "tilt": {"kp": 0.3, "ki": 2.0, "kd": 0.05}}
SCENARIO = crinoid.Scenario(
    arm={"nodes": 11, "youngs_modulus": 5e5},
    base={"tilt_deg": -30, "channels": {"slide": {}, "tilt": {}}},
    flow=[
        {"kind": "uniform", "velocity": [0.2, 0.0], "ramp_time": 1.0},
        {"kind": "sine", "amplitude": [0.05, 0.02], "frequency_hz": 0.5},
    ],
    control={"kind": "pid", "pid": GAINS},
    simulation={"duration": 2.0},
)


def of_loop(**values: object) -> crinoid.Scenario:
    """Return the scenario with other values; dots of their keys are written as ``__``."""
    keys = {key.replace("__", "."): value for key, value in values.items()}
    return SCENARIO.with_values(keys)


def assert_equal_runs(one: Result, other: Result) -> None:
    """Compare two runs to the bit, with and without control."""
    for mine, theirs in ((one, other), (one.uncontrolled, other.uncontrolled)):
        xr.testing.assert_equal(mine.dataset, theirs.dataset)
        assert mine.notes == theirs.notes


def assert_listed(dataset: xr.Dataset, without: tuple[str, ...]) -> dict[str, Variable]:
    """Return the listed variables, but for those of parts: all are there, with their units."""
    there = of_dimension(2, without=without)
    assert set(there) == set(dataset.data_vars)
    for name, variable in there.items():
        found = dataset[name]
        assert found.dims == variable.dims, name
        assert found.attrs["long_name"] == variable.meaning
        assert found.attrs.get("units", "") == variable.unit
        assert np.isfinite(found.values).all(), name
    return there
