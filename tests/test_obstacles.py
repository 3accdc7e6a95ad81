"""Scenarios with obstacles, from the file to the result, the figures and the command line."""

from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner
from typer.testing import Result as Ended

import crinoid
from crinoid.assembly.prepared import Prepared
from crinoid.cli.app import app
from crinoid.dynamics import Outcome
from crinoid.result import Result
from crinoid.simulation import SimulationError, play
from crinoid.simulation.failure import nearness
from made_results import case_rows

# a heavy arm that leans on the bed, and a ball that falls on it; one number of nodes, one free and
# one led obstacle in all tests, which share their compiled code
TOUCHED = """
title = "touched"
[arm]
nodes = 5
density = 1500
youngs_modulus = 5e5
[[obstacle]]
kind = "sphere"
position = [0.4, -9.92]
radius = 0.03
mass = 0.25
velocity = [0.0, -0.4]
[[obstacle]]
kind = "plane"
position = [0.0, -10.03]
normal = [0.0, 2.0]
friction = 0.3
[[sensors]]
kind = "contact"
[[sensors]]
kind = "contact"
name = "fingertip"
span = [0.9, 1.0]
resolution = 0.01
[simulation]
duration = 0.3
"""
FELT = [f"{name}.force_{axis}" for name in ("contact", "fingertip") for axis in "xz"]
WEIGHT = (1500 - 1025) * 9.81 * np.pi * 0.02**2 * 0.5


def scenario(values: dict[str, object] | None = None) -> crinoid.Scenario:
    return crinoid.Scenario.from_toml(TOUCHED).with_values(values or {})


@pytest.fixture(scope="module")
def result() -> Result:
    return crinoid.simulate(scenario())


@pytest.fixture
def here(tmp_path, monkeypatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "touched.toml").write_text(TOUCHED)
    return tmp_path


def call(*arguments: object) -> Ended:
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def test_every_variable_of_the_obstacles_has_units_and_dimensions(result):
    vectors, numbers = ("time", "obstacle", "axis"), ("time", "obstacle")
    expected = {
        "obstacle_position": (vectors, "m"),
        "obstacle_velocity": (vectors, "m s-1"),
        "contact_force": (vectors, "N"),
        "contact_impulse": (vectors, "N s"),
        "contact_time": (numbers, "s"),
        "contact_gap": (numbers, "m"),
        "contact_closest": (numbers, "m"),
    }
    assert result.dataset.sizes["obstacle"] == 2
    for name, (dims, units) in expected.items():
        variable = result.dataset[name]
        assert variable.dims == dims, name
        assert variable.attrs["units"] == units, name
        assert variable.attrs["long_name"], name
        assert np.isfinite(variable.values).all(), name


def test_places_are_in_the_world_and_sums_run_from_the_start(result):
    data = result.dataset
    np.testing.assert_allclose(data["obstacle_position"].values[0], [[0.4, -9.92], [0.0, -10.03]])
    assert data["obstacle_position"].values[-1, 0, 1] < -9.93  # the ball fell
    np.testing.assert_array_equal(data["obstacle_position"].values[:, 1], [[0.0, -10.03]] * 16)
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


def test_the_ledger_closes_with_the_work_of_the_contacts():
    faster = scenario({"arm.nodes": 9, "obstacle.0.velocity": [0.0, -0.5]})
    energy = crinoid.simulate(faster).dataset["energy"]
    assert energy["kind"].values[-1] == "contact"
    stored = ["kinetic", "elastic", "potential"]
    change = energy.sel(kind=stored).sum("kind")
    works = energy.sum("kind") - change
    defect = np.abs((change - change[0]) - works).max()
    scale = float(np.abs(energy.sel(kind="contact")).max())
    assert scale > 0.01
    # forces along the path: a hit makes velocities jump within a step, and the books still balance
    assert float(defect) < 1e-5 * scale


def test_a_run_with_a_free_obstacle_goes_on_as_if_it_had_not_stopped(result, tmp_path):
    crinoid.simulate(scenario({"simulation.duration": 0.14})).save(tmp_path)
    whole = play(Prepared(scenario()), resume=Result.load(tmp_path))
    assert set(whole.dataset.variables) == set(result.dataset.variables)
    for name in result.dataset.variables:
        np.testing.assert_array_equal(whole.dataset[name], result.dataset[name], str(name))


def test_equilibrium_leans_on_the_bed(here):
    ended = call("equilibrium", "touched.toml", "--out", "still")
    assert ended.exit_code == 0, ended.output
    assert "force of obstacle 1" in ended.stdout
    assert "force of obstacle 0" not in ended.stdout
    with xr.open_dataset(here / "still" / "result.nc") as data:
        push, base = data["contact_force"].values[0], data["base_force"].values[0]
        np.testing.assert_array_equal(push[0], 0.0)
        assert 0.2 * WEIGHT < push[1, 1] < 0.8 * WEIGHT
        # what the bed does not carry hangs on the submarine; at rest there is no friction
        np.testing.assert_allclose(base, [push[1, 0], push[1, 1] - WEIGHT], atol=1e-6)
        np.testing.assert_allclose(push[1, 0], 0.0, atol=1e-12)
        # what the arm feels of it; the last two of its four edges lean on the bed
        felt = data["sensor_reading"].sel(reading=FELT).values[0]
        np.testing.assert_allclose(felt[:2], push[1], rtol=1e-12, atol=1e-12)
        assert 0.2 * push[1, 1] < felt[3] < 0.8 * push[1, 1]
    assert "contact.png" in call("report", "still").stdout


def test_an_overlap_is_a_mistake_and_nothing_is_written(here):
    inside = (
        "--set",
        "obstacle.0.position=[0.1875, -10.0]",
        "--set",
        "obstacle.1.position=[0,-10]",
    )
    for command in ("run", "equilibrium"):
        ended = call(command, "touched.toml", *inside)
        assert ended.exit_code == 2
        lines = ended.stderr.strip().splitlines()
        assert lines == [
            "crinoid: obstacle.0.position: lies 50 mm inside the arm without load, takes a "
            "position clear of it",
            "crinoid: obstacle.1.position: lies 20 mm inside the arm without load, takes a "
            "position clear of it",
        ]
    ended = call("run", "touched.toml", "--set", "vary.'obstacle.0.radius'=[0.03, 0.07]")
    assert ended.exit_code == 2
    assert ended.stderr.startswith(
        "crinoid: vary: case obstacle.0.radius = 0.07: obstacle.0.position: lies "
    )
    assert sorted(path.name for path in here.iterdir()) == ["touched.toml"]


def test_a_study_over_a_radius_is_run_told_and_drawn(here):
    (here / "touched.toml").write_text(TOUCHED + '[vary]\n"obstacle.0.radius" = [0.02, 0.04]\n')
    ended = call("run", "touched.toml", "--out", "cases")
    assert ended.exit_code == 0, ended.output
    assert [row["obstacle.0.radius"] for row in case_rows(here / "cases")] == ["0.02", "0.04"]
    closest = []
    for case in ("case-01", "case-02"):
        with xr.open_dataset(here / "cases" / case / "result.nc") as data:
            closest.append(data["contact_gap"].values[0, 0])
    # at first the balls are as far from the arm as their radii differ
    assert closest[0] - closest[1] == pytest.approx(0.02, abs=1e-4)
    drawn = call("report", "cases")
    assert drawn.exit_code == 0, drawn.output
    for case in ("case-01", "case-02"):
        assert (here / "cases" / case / "contact.png").stat().st_size > 10_000


def test_the_table_sums_up_the_contacts(here, result):
    ended = call("run", "touched.toml")
    assert ended.exit_code == 0, ended.output
    rows = {
        cells[1].strip(): cells[2].strip()
        for line in ended.stdout.splitlines()
        if len(cells := line.split("\u2502")) == 4
    }
    assert (
        rows["longest time in contact"]
        == f"obstacle 1: {result.dataset['contact_time'].values[-1, 1]:.3g} s"
    )
    force = np.linalg.norm(result.dataset["contact_force"], axis=2).max(axis=0)
    most = int(force.argmax())
    assert rows["largest contact force"] == f"obstacle {most}: {force[most]:.3g} N"
    gap = result.dataset["contact_closest"].values[-1]
    assert rows["smallest gap"] == f"obstacle {gap.argmin()}: {1e3 * gap.min():.3g} mm"


def pressed(speed: float) -> crinoid.Scenario:
    """Return the scenario with a wall that goes its way, past the root that the base holds."""
    wall = {
        "kind": "plane",
        "position": [0.0, -9.97],
        "normal": [0.0, -1.0],
        "velocity": [0.0, -speed],
    }
    return scenario({"obstacle.0.position": [0.3, -8.0], "obstacle.1": wall})


def test_an_arm_without_room_gets_a_note():
    run = crinoid.simulate(pressed(0.04))
    depth = -1e3 * float(run.dataset["contact_closest"].values[-1, 1])
    assert depth > 0.2
    noted = [note for note in run.notes if "pressed" in note]
    assert len(noted) == 1
    assert noted[0].startswith(f"obstacle 1 pressed {depth:.2g} mm into the arm")


def test_an_arm_that_is_crushed_fails_and_tells_of_the_wall():
    run = play(Prepared(pressed(0.2)))
    assert run.failure
    assert "the largest energy or work" in run.failure
    assert any(note.startswith("obstacle 1 pressed 50 mm") for note in run.notes)


def test_a_run_with_room_gets_no_note(result):
    assert not any("pressed" in note for note in result.notes)


def test_a_hit_that_no_step_resolves_ends_the_run_and_says_so():
    shot = {
        "obstacle.1": {
            "kind": "sphere",
            "position": [0.1, -10.5],
            "radius": 0.005,
            "velocity": [0.0, 1e5],
        }
    }
    with pytest.raises(SimulationError) as caught:
        crinoid.simulate(scenario(shot))
    told = str(caught.value)
    assert told.startswith("failed at t = 0 s: a hit is too hard or too fast for a time step")
    assert "obstacle 0 is nearest to the arm" in told or "obstacle 1 is nearest" in told
    for remedy in ("simulation.time_step", "simulation.max_halvings", "slower obstacles"):
        assert remedy in told


def test_no_distance_that_is_told_is_negative():
    assert nearness(2, 0.0123) == "obstacle 2 is nearest to the arm with 12.3 mm between them"
    assert nearness(2, -0.0123) == "obstacle 2 is pressed 12.3 mm into the arm"


def test_an_imbalance_past_the_tip_is_that_of_a_free_obstacle():
    system = crinoid.system(scenario())

    def worst(row: int) -> str:
        nothing = Outcome.of_nothing(converged=False)
        outcome = Outcome(
            nothing.converged,
            nothing.iterations,
            jnp.asarray(0.5),
            jnp.asarray(2.0),
            jnp.asarray(row),
            nothing.resolved,
            nothing.folded,
            nothing.error,
        )
        return outcome.imbalance(system.reference.nodes, system.forces.free)

    among = "is out of balance by 0.5 N among forces of up to 2 N"
    assert worst(4) == f"node 4 {among}"
    assert worst(5) == f"obstacle 0 {among}"
