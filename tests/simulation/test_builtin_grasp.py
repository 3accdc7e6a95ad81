"""An arm winds around a bottle, carries it and sets it down."""

import numpy as np
import pytest

import crinoid

pytestmark = [pytest.mark.release, pytest.mark.usefixtures("optimised")]

RADIUS = 0.035


@pytest.fixture(scope="module")
def result():
    return crinoid.simulate(crinoid.load("wind-around"))


def phases(data):
    """Return when the lift begins, and when the arm begins to let go (s)."""
    time, heave = data["time"].values, data["base_command"].sel(channel="heave").values
    far = data["actuator_command"].sel(input="far").values
    held = far == far.max()
    return time[np.argmax(heave > 1e-6)], time[held][-1]


def edge_radius(data):
    """Return the radius of each edge (m)."""
    diameter = data["diameter"].values
    return 0.25 * (diameter[1:] + diameter[:-1])


def turns(data, instant):
    """Return by how many turns the arm is wound around the bottle at an instant, and its nodes."""
    now = data.sel(time=instant, method="nearest")
    off = (now["position"] - now["obstacle_position"].isel(obstacle=0)).values
    reach = RADIUS + edge_radius(data)
    # an edge touches between its nodes
    edges = 0.5 * (off[1:] + off[:-1])
    wound = np.flatnonzero(np.hypot(*edges[:, :2].T) < reach + 5e-3)
    angle = np.unwrap(np.arctan2(off[:, 1], off[:, 0]))
    return abs(angle[wound[-1] + 1] - angle[wound[0]]) / (2 * np.pi), wound


def test_it_winds_around_the_bottle_lifts_it_and_sets_it_down_elsewhere(result):
    data = result.dataset
    assert data.attrs["status"] == "ok"
    lift, release = phases(data)
    wound, edges = turns(data, lift)
    assert wound > 1.2
    bottle = data["obstacle_position"].isel(obstacle=0)
    height = bottle.sel(axis="z") - float(bottle.sel(axis="z")[0])
    assert float(height.sel(time=slice(lift, release)).max()) > 0.1
    # along with the arm that holds it
    held = slice(lift + 0.5, release)
    nodes = data["position"].isel(node=edges).sel(axis="z").mean("node")
    slip = (bottle.sel(axis="z") - nodes).sel(time=held)
    assert float(slip.max() - slip.min()) < 0.01
    # it stands on the bed at another place, and the arm is gone
    there, moved = bottle[-1].values, np.abs(height.values)
    assert np.hypot(*(there - bottle[0].values)[:2]) > 0.1
    assert moved[-50:].max() < 0.005
    assert float(np.abs(data["obstacle_velocity"].isel(obstacle=0)[-50:]).max()) < 0.1
    assert not data["contact_force"].isel(obstacle=0)[-50:].any()


def test_nothing_passes_through_anything(result):
    data = result.dataset
    assert float(data["contact_closest"][-1].min()) > 0
    # turns lie next to each other: points along edges, those far from each other along the arm
    share = np.linspace(0.0, 1.0, 5)[:-1]
    radius = np.repeat(edge_radius(data), share.size)
    along = np.arange(radius.size) / share.size
    far = np.abs(along[:, None] - along) > 5
    for place in data["position"].values[::5]:
        points = place[:-1, None] + share[:, None] * np.diff(place, axis=0)[:, None]
        points = points.reshape(-1, 3)
        apart = np.linalg.norm(points[:, None] - points, axis=2) - radius[:, None] - radius
        assert apart[far].min() > 0
