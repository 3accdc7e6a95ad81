"""Station keeping and a circle in space show what they are there to show."""

import numpy as np
import pytest

import crinoid
from crinoid.results.errors import tip_error
from helpers.builtin import assert_held, assert_traced, besides_lock_in

pytestmark = [pytest.mark.release, pytest.mark.usefixtures("optimised")]


@pytest.mark.parametrize(
    "changes",
    [{}, {"simulation.time_step": 0.02}, {"seed": 1}],
    ids=["as it is", "long steps", "another draw"],
)
def test_station_keeping_in_space_holds_position_and_direction(changes):
    result = crinoid.simulate(crinoid.load("station-keeping-3d").with_values(changes))
    assert_held(result, ["sway", "heave", "pan", "tilt"])
    if not changes:
        assert besides_lock_in(result) == besides_lock_in(result.uncontrolled) == []
    swing = np.ptp(result.uncontrolled.dataset["tip_position"].values, axis=0)
    assert swing[1] > 0.08
    assert swing[2] > 0.02


def test_an_arm_below_a_measured_sea_is_held():
    result = crinoid.simulate(crinoid.load("buoy-sea"))
    assert tip_error(result).rms < 0.06 * tip_error(result.uncontrolled).rms
    assert tip_error(result.uncontrolled).rms > 0.01


def test_a_circle_in_a_cross_current_is_traced_through_feed_forward():
    assert_traced("trace-circle-3d", **{"water.vortices.model": "none", "control.kind": "pid"})


def test_a_circle_is_traced_in_water_that_sheds_vortices():
    result = crinoid.simulate(crinoid.load("trace-circle-3d", ["control.compare=false"]))
    assert besides_lock_in(result) == []
    assert tip_error(result).rms < 0.2 * 0.05  # of its radius


def test_a_submarine_rides_in_a_swell_and_its_arm_holds_the_tip():
    result = crinoid.simulate(crinoid.load("floating-3d"))
    moved = result.uncontrolled.dataset["tip_position"].sel(time=slice(5.0, None))
    assert np.ptp(moved.sel(axis="y").values) > 0.3  # it rides along
    assert tip_error(result).rms < 0.15 * tip_error(result.uncontrolled).rms


def test_an_arm_that_rests_on_a_reef_holds_its_tip():
    pytest.importorskip("trimesh", reason="needs trimesh")
    result = crinoid.simulate(crinoid.load("reef"))
    data, free = result.dataset, result.uncontrolled.dataset
    assert data.attrs["status"] == "ok"
    # rubbed all along, and never into the rock
    assert float(data["contact_time"][-1, 0]) > 0.9 * float(data["time"][-1])
    assert float(data["contact_closest"][-1].min()) > 0.0
    assert np.ptp(free["tip_position"].sel(axis="y").values) > 0.04
    assert tip_error(result).rms < 0.3 * tip_error(result.uncontrolled).rms
