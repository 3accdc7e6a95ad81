"""Equilibria over a number of a scenario, against solutions on paper; branches, failures, files."""

import csv
import re
from functools import cache

import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr
from scipy.special import ellipk

import crinoid
from crinoid.analysis.curve import Curve
from crinoid.analysis.equilibria import CURVE, curve_table, find_equilibria
from crinoid.scenario import ScenarioError
from helpers.command import call, succeeded

LENGTH, EI = 0.5, 1e5 * np.pi / 4 * 0.02**4
OFFSET, FRICTION = 0.008, 0.3
TENSION = 1.5 * EI / (OFFSET * LENGTH)
"""Bends the arm by 1.5 rad without friction (N)."""


def arm(nodes=21, EA=1e5, **tables):
    """Return an arm in a vacuum that does not stretch."""
    section = {"section": {"EA": EA}, "youngs_modulus": 1e5, "radius": 0.02, "length": LENGTH}
    return crinoid.Scenario(
        arm=section | {"nodes": nodes}, water={"density": 0.0, "gravity": 0.0}, **tables
    )


CHAMBER = {"area": 1e-4, "offset": 0.01, "angle_deg": 180.0, "max_pressure": 5e4}
BELLOWS = arm(chamber=[CHAMBER])


def rubbing(**tendon):
    usual = {"offset": OFFSET, "friction": FRICTION, "max_tension": TENSION}
    return arm(tendon=[usual | tendon])


COLUMN = arm(load=[{"kind": "tip", "force": [0.0, 0.0]}])


@cache
def pushed():
    """Return a column under a load at its tip, beyond the buckling load and back."""
    critical = np.pi**2 * EI / (4 * LENGTH**2)
    vary = f"load.0.force.0={-0.8 * critical}:{-1.4 * critical}:4"
    return critical, crinoid.equilibria(COLUMN, vary)


def test_a_chamber_bends_the_arm_by_its_moment_over_its_stiffness():
    found = crinoid.equilibria(BELLOWS, "chamber.0.pressure=0:5e4:3")
    pressure = found["chamber.0.pressure"]
    curvature = pressure.values * 1e-4 * 0.01 / EI
    assert pressure.attrs["units"] == "Pa"
    assert found.sizes == {"branch": 1, "chamber.0.pressure": 3, "axis": 2, "node": 21}
    np.testing.assert_allclose(found["max_curvature"][0], curvature, rtol=1e-3, atol=1e-6)
    np.testing.assert_allclose(found["tip_turn"][0], curvature * LENGTH, rtol=1e-3, atol=1e-6)
    # a circle from the root
    rise = found["tip_position"].sel(axis="z")[0] + 10.0
    exact = (1 - np.cos(curvature[1:] * LENGTH)) / curvature[1:]
    np.testing.assert_allclose(rise[1:], exact, rtol=2e-3)
    assert found.attrs["status"] == "ok"


@pytest.mark.slow
def test_a_tendon_with_friction_bends_the_arm_more_on_the_way_back():
    found = crinoid.equilibria(rubbing(), f"tendon.0.tension=0:{TENSION}:11")
    share = np.linspace(0, 1, 11)
    bent = FRICTION * OFFSET * TENSION / EI
    pulled = np.log(1 + bent * LENGTH * share) / FRICTION
    # from the root as far as T_1 / (1 - mu k s) meets T_0 / (1 + mu k s); the rest sticks
    with np.errstate(divide="ignore"):
        meets = np.minimum((1 / share - 1) / (2 * bent), LENGTH)
    sticks = np.where(meets < LENGTH, (1 + bent * LENGTH) / (1 + bent * meets), 1.0)
    back = np.log(sticks / (1 - bent * share * meets)) / FRICTION
    turn = found["tip_turn"]
    np.testing.assert_allclose(turn.sel(branch="forward"), pulled, rtol=5e-3, atol=1e-6)
    # the sliding in which friction turns round, 2e-4 of the tendon, turns the tip by 0.0125 rad
    np.testing.assert_allclose(turn.sel(branch="backward"), back, rtol=1e-2, atol=1e-6)
    assert (found["status"] == "ok").all()


@pytest.mark.release
def test_an_arm_that_buckled_follows_the_elastica_and_straightens_again():
    critical, found = pushed()
    turn = found["tip_turn"].values[0]
    assert found.sizes["branch"] == 1
    assert abs(turn[0]) < 1e-6
    # the load over the critical one by the turn of the tip: (2 K(sin(a / 2)) / pi)^2
    exact = (2 * ellipk(np.sin(turn[2:] / 2) ** 2) / np.pi) ** 2
    load = -found["load.0.force.0"].values[2:] / critical
    np.testing.assert_allclose(load, exact, rtol=5e-3)


@pytest.mark.release
def test_an_arm_snaps_at_the_same_load_from_either_side():
    critical, _ = pushed()
    column = COLUMN.with_values({"load.0.force.0": -1.3 * critical})
    found = crinoid.equilibria(column, "load.0.force.1=0.05:-0.05:11")
    forward, backward = found["tip_turn"].values
    np.testing.assert_allclose(forward[::-1], -backward, atol=1e-4)
    assert forward[5] > 1.0
    assert backward[5] < -1.0
    np.testing.assert_allclose(forward[[0, -1]], backward[[0, -1]], atol=1e-4)


@pytest.mark.release
def test_in_space_the_turn_is_an_angle_between_tangents():
    chamber = CHAMBER | {"angle_deg": 30.0}
    spatial = BELLOWS.with_values({"arm.dimension": 3, "base.position": [0.0, 0.0, -10.0]})
    found = crinoid.equilibria(
        spatial.with_values({"chamber.0": chamber}), "chamber.0.pressure=5e4,2e4"
    )
    curvature = np.array([5e4, 2e4]) * 1e-4 * 0.01 / EI
    np.testing.assert_allclose(found["max_curvature"][0], curvature, rtol=1e-3)
    np.testing.assert_allclose(found["tip_turn"][0], curvature * LENGTH, rtol=1e-3)


@pytest.mark.release
def test_values_of_another_structure_start_from_the_arm_without_load():
    found = crinoid.equilibria(COLUMN, "arm.nodes=5,21")
    assert found.sizes["branch"] == 1
    assert "no way back" in found.attrs["notes"]
    assert found["status"].values.tolist() == [["ok", "ok"]]


def test_what_was_found_before_an_interruption_is_kept():
    curve = Curve.of(BELLOWS, ["chamber.0.pressure=0:5e4:3"])
    done = []
    found = find_equilibria(
        curve, stop=lambda: len(done) == 2, report=lambda *each: done.append(each)
    )
    assert done == [(1, 5), (2, 5)]
    assert found.attrs["status"] == "interrupted: 2 of 3 equilibria are found"
    assert np.isfinite(found["tip_turn"].values).tolist() == [[True, True, False]]
    rows = list(csv.DictReader(curve_table(found).splitlines()))
    assert [row["chamber.0.pressure (Pa)"] for row in rows] == ["0.0", "25000.0"]


@pytest.fixture
def bellows(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "bellows.toml").write_text(BELLOWS.to_toml())
    return tmp_path


def test_the_command_writes_a_table_a_file_and_a_figure(bellows):
    vary = ("--vary", "chamber.0.pressure=0:5e4:3")
    succeeded("equilibrium", "bellows.toml", *vary, "--out", "out")
    assert {path.name for path in (bellows / "out").iterdir()} == {CURVE, "curve.csv", "curve.png"}
    table = list(csv.DictReader((bellows / "out" / "curve.csv").open()))
    data = xr.load_dataset(bellows / "out" / CURVE)
    numbers = [float(row["tip_turn (rad)"]) for row in table]
    np.testing.assert_array_equal(numbers, data["tip_turn"][0])
    succeeded("report", "out")


@pytest.mark.slow
def test_values_without_an_equilibrium_are_named_and_the_others_kept(bellows):
    # the last tension shortens the arm to less than nothing; with friction it is compiled above
    soft = rubbing(max_tension=200.0).with_values({"arm.section.EA": 100.0})
    (bellows / "soft.toml").write_text(soft.to_toml())
    vary = ("--vary", "tendon.0.tension=0,20,200")
    ended = call("equilibrium", "soft.toml", *vary, "--out", "x")
    assert ended.exit_code == 3
    assert re.search("equilibria were not found .no equilibrium near the last one", ended.stderr)
    found = xr.load_dataset(bellows / "x" / CURVE)
    assert np.isfinite(found["tip_turn"].values[0]).tolist() == [True, True, False]
    assert str(found["status"].values[0, 2]).startswith("failed: no equilibrium")


def test_a_schedule_adds_to_a_constant_pressure():
    schedule = {"time": [0.0, 1.0], "share": [0.1, 0.3]}
    held = BELLOWS.with_values({"chamber.0.pressure": 1e4, "chamber.0.schedule": schedule})
    (valve,) = crinoid.system(held).actuators
    np.testing.assert_allclose(valve.scheduled(jnp.asarray(0.5)), [0.4])
    threads = crinoid.parameters(held).actuator[0]
    assert (float(threads.max_pressure[0]), float(threads.area[0])) == (5e4, 1e-4)
    with pytest.raises(ScenarioError, match=r"chamber\.0\.pressure: got 1000\.0; must be 2000 to"):
        held.with_values({"chamber.0.min_pressure": 2e3, "chamber.0.pressure": 1e3})
    winch = {"drive": "length", "max_shortening": 0.01, "stiffness": 1e3, "tension": 1.0}
    with pytest.raises(ScenarioError, match=r"tension: got 1\.0; must be left out with drive"):
        arm(tendon=[{"offset": OFFSET, **winch}])
