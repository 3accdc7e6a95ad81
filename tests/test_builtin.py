"""The built-in scenarios show what they are there to show."""

import numpy as np
import pytest

import crinoid
from crinoid.metrics import settling_time, tip_error
from crinoid.scenario import builtin_names


def test_every_built_in_scenario_loads_and_has_a_title():
    assert set(builtin_names()) >= {"still-water", "constant-load", "station-keeping"}
    for name in builtin_names():
        assert crinoid.load(name).title, name


def test_station_keeping_holds_the_tip():
    result = crinoid.simulate(crinoid.load("station-keeping"))
    held, free = tip_error(result), tip_error(result.uncontrolled)
    assert held.rms <= 0.20 * free.rms
    # better than an arm that is only set once where the mean current carries it
    assert held.rms < free.fluctuation
    tilt = result.dataset["base_pose"].sel(channel="tilt").values
    assert np.abs(tilt).max() < np.deg2rad(45)
    assert result.dataset.attrs["status"] == "ok"


def test_still_water_lets_a_bent_arm_go_and_moves_its_tip():
    result = crinoid.simulate(crinoid.load("still-water"))
    assert result.notes == result.uncontrolled.notes == []
    free = result.uncontrolled.dataset
    height = free["tip_position"].sel(axis="z") + 10.0
    bent = float(height.sel(time=0.4, method="nearest"))
    assert bent > 0.1
    np.testing.assert_allclose(height.sel(time=slice(0, 0.49)), bent, rtol=1e-6)
    # it swings through and dies down in the viscous water
    assert float(height.sel(time=slice(0.5, 4.0)).min()) < -0.02
    assert float(np.abs(height.sel(time=slice(9.0, 10.0))).max()) < 0.05 * bent
    stepped = result.dataset["tip_error"].sel(time=slice(10.02, None))
    size = float(np.hypot(0.05, 0.1))
    assert float(stepped[0]) == pytest.approx(size, rel=0.05)
    assert float(stepped.sel(time=slice(18.0, None)).max()) < 0.05 * size


@pytest.mark.parametrize("number", [1, 4, 8])
def test_constant_load_is_held_off(number):
    _, case = crinoid.load("constant-load").cases()[number]
    result = crinoid.simulate(case)
    held, free = tip_error(result), tip_error(result.uncontrolled)
    assert free.steady > 0.05
    assert held.steady < 0.02 * free.steady
    settled = settling_time(result)
    assert settled is not None
    assert settled < 10.0
