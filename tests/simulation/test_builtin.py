"""The built-in scenarios in the plane show what they are there to show."""

import re

import numpy as np
import pytest

import crinoid
from crinoid.results.errors import angle_error, tip_error
from crinoid.scenario import builtin_names
from helpers.builtin import STORED, assert_held, assert_traced, besides_lock_in, imbalance
from helpers.paths import ROOT

pytestmark = pytest.mark.release

LARGER = {
    name: gains.model_dump() | {key: 1.5 * getattr(gains, key) for key in ("kp", "ki", "kd")}
    for name, gains in crinoid.load("station-keeping").control.pid.present.items()
}


def test_the_reference_lists_every_built_in_scenario():
    page = ROOT.joinpath("docs", "reference", "built-in.md").read_text("utf-8")
    listed = re.findall(r"^\| `([\w-]+)` \|", page, re.M)
    assert sorted(listed) == builtin_names()


CHANGES = {
    "none": {},
    "long steps": {"seed": 1, "simulation.time_step": 0.02},
    "higher swell": {"seed": 3, "flow.0.amplitude": [0.35, 0.0]},
    "rougher": {"seed": 4, "flow.1.intensity": 1.0},
    # gains with room: 1.5 times as large
    "larger gains": {f"control.pid.{name}": gains for name, gains in LARGER.items()},
}


@pytest.mark.parametrize("changes", CHANGES.values(), ids=CHANGES.keys())
def test_station_keeping_holds_position_and_angle_with_both_channels(changes):
    result = crinoid.simulate(crinoid.load("station-keeping").with_values(changes))
    assert_held(result, ["slide", "tilt"])
    if not changes:
        assert besides_lock_in(result) == besides_lock_in(result.uncontrolled) == []
        # pushed both ways
        free = result.uncontrolled.dataset["tip_position"].sel(axis="x")
        assert float(free.min()) < -0.04
        assert float(free.max()) > 0.04


# each holds its coordinate well, and lets the other go
ALONE = {
    "tilt": ({"kp": 0.5, "ki": 5.0, "kd": 0.04, "derivative_filter_hz": 0.7}, "x"),
    "slide": ({"kp": 0.05, "ki": 2.0}, "x"),
}


@pytest.mark.parametrize(("name", "alone"), ALONE.items())
def test_one_channel_alone_does_clearly_worse(name, alone):
    gains, coordinate = alone
    changes = {"control.pid": {name: gains}, "control.controlled": [coordinate]}
    changes |= {"target.judged_from": 0.0}
    result = crinoid.simulate(crinoid.load("station-keeping").with_values(changes))
    off, free = (angle_error(run) for run in (result, result.uncontrolled))
    assert tip_error(result).rms < 0.5 * tip_error(result.uncontrolled).rms
    assert off.rms > 0.3 * free.rms


@pytest.mark.parametrize(
    ("name", "ratio"),
    [
        ("tidal-channel", 0.10),
        ("gust-front", 0.20),
        ("wave-zone", 0.06),
        ("ship-motion", 0.08),
        ("ship-wake", 0.08),
        ("ship-rao", 0.15),
    ],
)
def test_moving_water_and_a_moving_ship_are_held_off(name, ratio):
    result = crinoid.simulate(crinoid.load(name))
    held, free = tip_error(result), tip_error(result.uncontrolled)
    assert free.rms > 0.02
    assert held.rms < ratio * free.rms
    assert held.maximum < 0.5 * free.maximum
    assert besides_lock_in(result) == besides_lock_in(result.uncontrolled) == []


def test_the_arm_grips_a_tool_holds_it_and_releases_it():
    result = crinoid.simulate(crinoid.load("tool"))
    data, free = result.dataset, result.uncontrolled.dataset
    assert result.notes == []
    time, error = data["time"].values, data["tip_error"].values
    assert error[(time > 1.0) & (time < 4.0)].max() < 1e-3
    assert error[(time >= 4.0) & (time < 6.0)].max() > 0.02  # it sags,
    assert error[(time > 10.0) & (time < 14.0)].max() < 1e-3  # is brought back up,
    assert error[(time >= 14.0) & (time < 16.0)].max() > 0.02  # springs up,
    assert error[time > 18.5].max() < 1e-3  # and settles
    # the work of the tool on the arm that nobody corrects: its weight times the depth it sank by
    work = free["energy"].sel(kind="tool").values
    sunk = -10.0 - free["tip_position"].sel(axis="z").values
    weight = (0.2 - 1025.0 * 5e-5) * 9.81
    during = (time > 13.5) & (time < 14.0)
    assert free["tip_error"].values[during].mean() > 0.06
    assert work[during].mean() == pytest.approx(weight * (sunk[during] - sunk[0]).mean(), rel=0.02)
    assert np.ptp(work[time > 14.1]) == 0.0
    assert imbalance(data) < 0.02


def test_a_submarine_that_floats_is_pushed_by_its_arm_and_held_by_its_thrusters():
    result = crinoid.simulate(crinoid.load("floating"))
    data = result.dataset
    assert result.notes == []
    pose, thrust = data["vehicle_pose"].values, data["thruster_force"].values
    assert 0.005 < np.abs(pose[:, :2]).max() < 0.03  # m
    assert 0.5 < np.rad2deg(np.ptp(pose[:, 2])) < 10.0
    assert np.abs(thrust).max() < 30.0  # its limit
    # it swings with the circle of the arm, and against the reaction
    settled = data["time"].values > 8.0
    assert np.corrcoef(data["base_force"].values[settled, 0], thrust[settled, 0])[0, 1] < -0.9
    root = data["position"].isel(node=0).values - [0.0, -10.0]
    turned = np.stack([np.cos(pose[:, 2]), np.sin(pose[:, 2])], axis=1)
    slide = 0.3 + data["base_pose"].values[:, 0]
    expected = pose[:, :2] + slide[:, None] * turned - [0.3, 0.0]
    np.testing.assert_allclose(root, expected, rtol=0, atol=1e-12)
    held, free = tip_error(result), tip_error(result.uncontrolled)
    assert held.rms < 0.3 * free.rms
    assert imbalance(data) < 0.02


def test_debris_hits_the_arm_whose_tip_is_back_within_three_seconds():
    data = crinoid.simulate(crinoid.load("debris-strike")).dataset
    time, error = data["time"].values, data["tip_error"].values
    touched = data["contact_time"].values > 0
    assert touched[-1].all()
    hits = time[touched.argmax(axis=0)]
    assert np.diff(hits).min() > 3.5
    largest = []
    for hit, end in zip(hits, [*hits[1:], time[-1]], strict=True):
        largest.append(error[(time >= hit) & (time < end)].max())
        assert error[(time >= hit + 3.0) & (time < end)].max() < 0.02 * 0.5
    assert max(largest) > 0.02  # of which at least one was hard
    assert min(largest) > 0.005
    # debris does not sink into the arm
    radius = 0.015
    assert float(data["contact_closest"].min()) > -0.01 * radius
    assert imbalance(data) < 0.02
    change = data["energy"] - data["energy"].isel(time=0)
    works = change.drop_sel(kind=STORED)
    # every ball was held up by the arm, and then carried on by the water
    assert float(np.abs(works.sel(kind="contact")).max()) > 0.01
    speed = np.linalg.norm(data["obstacle_velocity"].values, axis=-1)
    assert speed.min(axis=0).max() < 0.7 * 0.3
    assert speed[-1].min() > 0.8 * 0.3


def test_a_coral_is_touched_gently_and_leant_on():
    result = crinoid.simulate(crinoid.load("coral-touch"))
    data = result.dataset
    force = np.linalg.norm(data["contact_force"].isel(obstacle=0).values, axis=-1)
    time = data["time"].values
    assert force[time < 5.0].max() == 0.0
    assert force.max() < 0.5
    rest = force[time > 17.0]
    assert 0.1 < rest.mean() < 1.0
    assert np.ptp(rest) < 0.02 * rest.mean()
    # it leans: the force points away from the coral, and the tip is still
    assert float(data["contact_force"].isel(obstacle=0, time=-1).sel(axis="x")) < 0.0
    assert float(np.abs(data["velocity"].isel(node=-1, time=-1)).max()) < 1e-3
    assert float(result.uncontrolled.dataset["contact_time"].max()) == 0.0


def test_still_water_lets_a_bent_arm_go_and_moves_its_tip():
    result = crinoid.simulate(crinoid.load("still-water"))
    assert besides_lock_in(result) == besides_lock_in(result.uncontrolled) == []
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
    late = result.dataset["tip_error"].sel(time=slice(10.0, None))
    assert float(late.max()) < 0.05 * free.maximum


def test_a_circle_in_a_cross_current_is_traced_through_feed_forward():
    assert_traced("trace-circle")


def test_the_chamber_curls_the_arm_up():
    changes = {"simulation.duration": 4.0, "arm.nodes": 11}
    result = crinoid.simulate(crinoid.load("curl").with_values(changes))
    data = result.dataset
    assert result.status == "ok"
    # against its weight in water to more than half a circle
    curvature, arc = data["curvature"].values[-1], data["arc_length"].values
    assert np.trapezoid(curvature, arc) > np.pi / 2
    height = data["tip_position"].sel(axis="z").values
    assert height[-1] > height[0] + 0.1
    # its lag of 0.3 s after the end of a ramp of 2 s
    expected = 1 - 0.15 * (1 - np.exp(-2 / 0.3)) * np.exp(-1.5 / 0.3)
    assert float(data["actuator_state"].sel(input="curl")[-1]) == pytest.approx(expected, rel=1e-6)
    assert float(data["energy"].sel(kind="actuation")[-1]) > 0
