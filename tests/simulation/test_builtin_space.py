"""Station keeping and a circle in space show what they are there to show."""

import numpy as np
import pytest

import crinoid
from helpers.builtin import assert_held, assert_traced, besides_lock_in

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("optimised")]


@pytest.mark.parametrize(
    "changes",
    [{}, {"seed": 1, "simulation.time_step": 0.02}, {"seed": 2}],
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


def test_a_circle_in_a_cross_current_is_traced_through_feed_forward():
    assert_traced("trace-circle-3d")
