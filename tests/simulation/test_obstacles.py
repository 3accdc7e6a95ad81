"""Scenarios with obstacles, from the file to the result."""

import re
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import crinoid
from crinoid.assembly.prepared import Prepared
from crinoid.results.result import Result
from crinoid.simulation import SimulationError, play
from helpers.builtin import STORED
from helpers.command import succeeded
from helpers.loops import assert_listed

# a heavy arm that leans on the bed, and a ball that falls on it; one number of nodes, one free and
# one led obstacle in all tests, which share their compiled code
BALL = {"position": [0.4, -9.92], "radius": 0.03, "mass": 0.25, "velocity": [0.0, -0.4]}
BED = {"position": [0.0, -10.03], "normal": [0.0, 2.0], "friction": 0.3}
FINGERTIP = {"name": "fingertip", "span": [0.9, 1.0], "resolution": 0.01}
TOUCHED = crinoid.Scenario(
    title="touched",
    arm={"nodes": 5, "density": 1500, "youngs_modulus": 5e5},
    obstacle=[BALL | {"kind": "sphere"}, BED | {"kind": "plane"}],
    sensors=[{"kind": "contact"}, FINGERTIP | {"kind": "contact"}],
    simulation={"duration": 0.3},
)
FELT = [f"{name}.force_{axis}" for name in ("contact", "fingertip") for axis in "xz"]
WEIGHT = (1500 - 1025) * 9.81 * np.pi * 0.02**2 * 0.5


@pytest.fixture(scope="module")
def result() -> Result:
    return crinoid.simulate(TOUCHED)


@pytest.fixture
def here(tmp_path, monkeypatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "touched.toml").write_text(TOUCHED.to_toml())
    return tmp_path


@pytest.mark.slow
def test_variables_of_obstacles_have_units_places_and_running_sums(result):
    data = result.dataset
    without = ("solids", "actuators", "lines", "tool", "vehicle", "vortices", "estimate", "self")
    assert_listed(data, (*without, "hull"))
    assert data.sizes["obstacle"] == 2
    place = data["obstacle_position"].values
    np.testing.assert_allclose(place[0], [[0.4, -9.92], [0.0, -10.03]])
    assert place[-1, 0, 1] < -9.93  # the ball fell
    np.testing.assert_array_equal(place[:, 1], [[0.0, -10.03]] * 16)
    ball, bed = data["contact_time"].values.T
    assert 0 < ball[-1] < 0.3
    # the arm lies there until the ball makes it jump
    np.testing.assert_allclose(bed[:4], data["time"][:4], rtol=1e-12)
    assert bed[-1] < 0.3
    assert (np.diff(ball) >= 0).all()
    closest = data["contact_closest"].values
    assert (np.diff(closest, axis=0) <= 0).all()
    assert (closest <= data["contact_gap"].values).all()
    # the ball pushes down, the bed up
    assert data["contact_impulse"].values[-1, 0, 1] < 0 < data["contact_impulse"].values[-1, 1, 1]
    assert not any("pressed" in note for note in result.notes)


@pytest.mark.slow
def test_the_contact_sensors_read_the_force_of_both_obstacles(result):
    data = result.dataset
    readings = data["sensor_reading"].sel(reading=FELT)
    assert list(readings["reading_unit"].values) == ["N"] * 4
    whole, tip = readings.values[:, :2], readings.values[:, 2:]
    # read every 10 ms, the newest one known is a step old: until the ball comes nothing moves
    still = data["time"].values < 0.07
    force = data["contact_force"].values[still].sum(axis=1)
    np.testing.assert_allclose(whole[still], force, rtol=1e-6, atol=1e-6)
    assert force[0, 1] > 0.2 * WEIGHT
    np.testing.assert_allclose(tip[1:], 0.01 * np.round(tip[1:] / 0.01), atol=1e-12)


@pytest.mark.slow
def test_the_ledger_closes_with_the_work_of_the_contacts():
    faster = TOUCHED.with_values({"obstacle.0.velocity": [0.0, -0.55]})
    energy = crinoid.simulate(faster).dataset["energy"]
    assert energy["kind"].values[-1] == "contact"
    change = energy.sel(kind=STORED).sum("kind")
    works = energy.drop_sel(kind=STORED).sum("kind")
    defect = np.abs((change - change[0]) - works).max()
    scale = float(np.abs(energy.sel(kind="contact")).max())
    assert scale > 0.01
    # forces along the path: a hit makes velocities jump within a step, and the books still balance
    assert float(defect) < 1e-5 * scale


@pytest.mark.slow
def test_a_stopped_run_with_a_free_obstacle_continues_to_the_bit(result, tmp_path):
    crinoid.simulate(TOUCHED.with_values({"simulation.duration": 0.14})).save(tmp_path)
    whole = play(Prepared(TOUCHED), resume=Result.load(tmp_path))
    xr.testing.assert_equal(whole.dataset, result.dataset)


@pytest.mark.slow
def test_equilibrium_leans_on_the_bed(here):
    succeeded("equilibrium", "touched.toml", "--out", "still")
    (time,) = xr.load_dataset(here / "still" / "result.nc")["time"].values
    data = xr.load_dataset(here / "still" / "result.nc").sel(time=time)
    assert not data["velocity"].values.any()
    push, base = data["contact_force"].values, data["base_force"].values
    np.testing.assert_array_equal(push[0], 0.0)
    assert 0.2 * WEIGHT < push[1, 1] < 0.8 * WEIGHT
    # what the bed does not carry hangs on the submarine; at rest there is no friction
    np.testing.assert_allclose(base, [push[1, 0], push[1, 1] - WEIGHT], atol=1e-6)
    np.testing.assert_allclose(push[1, 0], 0.0, atol=1e-12)
    # what the arm feels of it; the last two of its four edges lean on the bed
    felt = data["sensor_reading"].sel(reading=FELT).values
    np.testing.assert_allclose(felt[:2], push[1], rtol=1e-12, atol=1e-12)
    assert 0.2 * push[1, 1] < felt[3] < 0.8 * push[1, 1]


def pressed(speed: float) -> crinoid.Scenario:
    """Return the scenario with a wall that goes its way, past the root that the base holds."""
    wall = {"kind": "plane", "position": [0.0, -9.97], "normal": [0.0, -1.0]}
    wall["velocity"] = [0.0, -speed]
    return TOUCHED.with_values({"obstacle.0.position": [0.3, -12.0], "obstacle.1": wall})


@pytest.mark.release
def test_an_arm_without_room_gets_a_note_and_a_crushed_one_fails():
    run = crinoid.simulate(pressed(0.04))
    depth = -1e3 * float(run.dataset["contact_closest"].values[-1, 1])
    assert depth > 0.2
    (note,) = (note for note in run.notes if "penetrated" in note)
    assert note.startswith(f"obstacle 1 penetrated the arm by {depth:.2g} mm")
    run = play(Prepared(pressed(0.2)))
    assert run.failure
    assert "the largest energy or work" in run.failure
    assert any(note.startswith("obstacle 1 penetrated the arm by 50 mm") for note in run.notes)


@pytest.mark.release
def test_a_hit_that_no_step_resolves_ends_the_run_and_says_so():
    shot = {"kind": "sphere", "position": [0.1, -10.5], "radius": 0.005, "velocity": [0.0, 1e5]}
    with pytest.raises(SimulationError) as caught:
        crinoid.simulate(TOUCHED.with_values({"obstacle.1": shot}))
    reason = str(caught.value)
    assert reason.startswith("failed at t = 0 s: a hit is too hard or too fast for a time step")
    assert re.search("obstacle [01] is nearest to the arm", reason)
