"""The built-in scenarios of many steps and nodes show what they are there to show."""

import numpy as np
import pytest

import crinoid
from crinoid.simulation import equilibrium
from helpers.builtin import imbalance

pytestmark = [pytest.mark.release, pytest.mark.usefixtures("optimised")]


def run(name, *changes):
    return crinoid.simulate(crinoid.load(name, changes))


def helix(along):
    """Return the coil without load, from its root (m)."""
    curvature, torsion = 11.0, 6.0
    turn = np.hypot(curvature, torsion)
    radius, angle = curvature / turn**2, turn * along
    # its axis lies along x, the root's principal normal is up
    return np.stack(
        [torsion / turn * along, radius * np.sin(angle), radius * (1 - np.cos(angle))], axis=1
    )


def test_the_coil_at_rest_is_a_helix():
    still = equilibrium(crinoid.load("spiral", ["load.0.force=[0, 0, 0]"])).dataset
    away = still["position"].values[0] - [0.0, 0.0, -10.0] - helix(still["arc_length"].values)
    # a fifth of a percent of the arm: an edge turns by 9 degrees against the next
    assert np.abs(away).max() < 2e-3


def test_the_spiral_unwinds_and_winds_up_again():
    spiral = run("spiral")
    data = spiral.dataset
    assert spiral.notes == []
    pulled = data.isel(time=0)
    assert float(pulled["tip_position"].sel(axis="x")) > 0.95
    np.testing.assert_allclose(data["position"].sel(time=0.48), pulled["position"], atol=1e-6)
    # Drawn out, the moment of the pull about the coil's axis has a part along the arm, which twists
    # it further; at the clamp the arm bends over into the pull, across the coil's own bend.
    bend, twist = pulled["curvature"].sel(bending="kappa_2"), pulled["twist"]
    assert float(bend.isel(node=40)) < 0.25 * 11.0
    assert float(twist.isel(edge=40)) > 1.3 * 6.0
    assert float(np.abs(pulled["curvature"].sel(bending="kappa_1", node=0))) > 10.0
    moving = data.sel(time=slice(0.6, 3.0))
    assert float(np.abs(moving["velocity"]).max()) > 0.5
    assert float(np.abs(moving["curvature"].sel(bending="kappa_1")).isel(node=40).max()) > 0.5
    end = data.isel(time=-1)
    np.testing.assert_allclose(end["curvature"].sel(bending="kappa_2"), 11.0, rtol=0.05)
    np.testing.assert_allclose(end["twist"], 6.0, rtol=0.05)
    assert float(end["tip_error"]) < 0.05 * float(pulled["tip_error"])
    assert imbalance(data) < 0.002
    change = end["energy"] - pulled["energy"]
    assert float(change.sel(kind="elastic")) < -0.3
    assert float(change.sel(kind="drag")) < 5 * float(change.sel(kind="damping"))
    # its steps are short enough
    finer = run("spiral", "simulation.time_step=0.0025").dataset
    assert np.linalg.norm(finer["position"] - data["position"], axis=-1).max() < 0.005


@pytest.fixture(scope="module")
def reach():
    """A hook goes round a pile."""
    return run("reach-around")


@pytest.mark.parametrize("longer_steps", [False, True])
def test_the_tip_reaches_its_places_behind_the_pile(reach, longer_steps):
    result = run("reach-around", "simulation.time_step=0.02") if longer_steps else reach
    assert result.notes == result.uncontrolled.notes == []
    data = result.dataset
    for end in (12.0, 20.0, 31.0, 36.0, 42.0):  # of each time that the target is still (s)
        assert float(data["tip_error"].sel(time=slice(end - 1.0, end)).max()) < 0.01
    # behind the pile as seen from the base, which the arm passes on its port side
    tip, pile = data["tip_position"].isel(time=-1).values, np.array([0.30, -0.03])
    assert tip[0] > pile[0] + 0.05
    assert tip[1] < pile[1] - 0.05
    arm = data["position"].isel(time=-1).values[:, :2] - pile
    assert arm[np.argmin(np.hypot(*arm.T)), 1] > 0.0
    assert float(data["tip_position"].isel(time=0).sel(axis="y")) > 0.2


def test_the_arm_leans_on_the_pile_and_is_not_squeezed(reach):
    data, radius = reach.dataset, 0.02
    touching = data["contact_gap"].isel(obstacle=0).values < 0.05 * radius
    time = data["time"].values
    assert not touching[time < 7.0].any()
    assert touching[time > 9.0].all()
    assert float(data["contact_closest"].min()) > -0.01 * radius
    force = np.linalg.norm(data["contact_force"].isel(obstacle=0).values, axis=-1)
    assert force[time > 9.0].min() > 0.5
    assert force[time > 9.0].max() < 5.0
    # it touches gently: the first kick is that of an arm of 0.8 kg at 7 cm/s
    kick = np.linalg.norm(data["contact_impulse"].isel(obstacle=0).values, axis=-1)
    assert kick[np.searchsorted(time, 7.74)] < 0.06
    assert imbalance(data) < 0.02


def test_friction_on_the_pile_twists_the_arm(reach):
    changes = ["obstacle.0.friction=0.0", "control.compare=false", "simulation.duration=20.0"]
    # held up there: the pile pulls a rough arm down, and a smooth one not at all
    rough, smooth = (
        each.dataset.sel(time=20.0, method="nearest").isel(obstacle=0, edge=0)
        for each in (reach, run("reach-around", *changes))
    )
    assert float(rough["contact_force"].sel(axis="z")) < -0.3
    assert abs(float(smooth["contact_force"].sel(axis="z"))) < 0.05
    assert float(rough["twist"]) > 1.5 * abs(float(smooth["twist"]))
