"""The built-in scenarios show what they are there to show."""

import re
from pathlib import Path

import numpy as np
import pytest

import crinoid
from crinoid.metrics import settling_time, tip_error
from crinoid.scenario import builtin_names


def test_every_built_in_scenario_loads_and_has_a_title():
    # the page that lists them
    readme = Path(__file__).resolve().parents[1].joinpath("README.md").read_text("utf-8")
    listed = re.findall(r"^\| `([\w-]+)` \|", readme, re.M)
    assert sorted(listed) == builtin_names()
    for name in builtin_names():
        assert crinoid.load(name).title, name


@pytest.mark.parametrize(
    ("mean", "intensity", "length_scale"),
    [(0.3, 0.2, 0.5), (0.1, 0.3, 0.2), (0.5, 0.3, 0.2), (0.5, 0.3, 2.0), (0.1, 0.1, 2.0)],
)
def test_station_keeping_holds_the_tip_in_turbulence_of_many_kinds(mean, intensity, length_scale):
    keys = {"mean": [mean, 0.0], "intensity": intensity, "length_scale": length_scale}
    scenario = crinoid.load("station-keeping")
    result = crinoid.simulate(scenario.with_values({f"flow.0.{k}": v for k, v in keys.items()}))
    held, free = tip_error(result), tip_error(result.uncontrolled)
    assert held.rms <= 0.20 * free.rms
    # better than an arm that is only set once where the mean current carries it
    assert held.rms < free.fluctuation
    tilt = result.dataset["base_pose"].sel(channel="tilt").values
    assert np.abs(tilt).max() < np.deg2rad(45)
    assert result.dataset.attrs["status"] == "ok"


@pytest.mark.parametrize(
    ("name", "ratio", "moved"),
    [("tidal-channel", 0.10, 0.02), ("gust-front", 0.20, 0.02), ("wave-zone", 0.35, 0.02)],
)
def test_moving_water_is_held_off(name, ratio, moved):
    result = crinoid.simulate(crinoid.load(name))
    held, free = tip_error(result), tip_error(result.uncontrolled)
    assert free.rms > moved
    assert held.rms < ratio * free.rms
    assert held.maximum < 0.5 * free.maximum
    assert result.notes == result.uncontrolled.notes == []


@pytest.fixture(scope="module")
def strike():
    """Debris hits the arm."""
    return crinoid.simulate(crinoid.load("debris-strike"))


def test_after_every_hit_the_tip_is_back_within_three_seconds(strike):
    data = strike.dataset
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


def test_debris_does_not_sink_into_the_arm_and_the_books_balance(strike):
    data, radius = strike.dataset, 0.015
    assert float(data["contact_closest"].min()) > -0.01 * radius
    change = data["energy"] - data["energy"].isel(time=0)
    stored = change.sel(kind=["kinetic", "elastic", "potential"]).sum("kind")
    works = change.drop_sel(kind=["kinetic", "elastic", "potential"])
    defect = float(np.abs(stored - works.sum("kind")).max())
    assert defect < 0.02 * float(np.abs(works).max())
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
