"""The perspective of the figures in space, what it shows of bodies, and what hides what."""

import math
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from crinoid.view.figures.arm import draw_arm, mount_facets
from crinoid.view.figures.sheet import fit_scene
from crinoid.view.figures.surroundings import tool_facets
from crinoid.view.scene.clip import box_corners, clipped_outline, obstacle_facets, within_box
from crinoid.view.scene.data import find_obstacles, tool_held
from crinoid.view.scene.projection import ABOVE, AHEAD, OBLIQUE, SIDE, perspective
from helpers.spatial_result import HIGH, LOW, among_obstacles, curling_arm, frame

MIDDLE = (LOW + HIGH) / 2


def obstacles_of(*tables):
    """Obstacles beside an arm at rest, of tables of a scenario."""
    text = f"obstacle = [{', '.join(f'{{{table}}}' for table in tables)}]\n"
    return find_obstacles(among_obstacles(records=3, obstacles=text, drift=0.0))


def area(facets):
    one, other = facets[:, 2] - facets[:, 0], facets[:, 3] - facets[:, 1]
    return 0.5 * np.linalg.norm(np.cross(one, other), axis=1).sum()


# ---------------------------------------------------------------- perspective


def test_a_point_is_where_its_line_to_the_eye_meets_the_paper():
    view = perspective(LOW, HIGH)
    assert view.far > 3.0  # beyond the box, whose longest side is 1 m
    eye = MIDDLE + view.far * view.toward
    rng = np.random.default_rng(0)
    points = rng.uniform(LOW, HIGH, (50, 3))
    share = (MIDDLE - points) @ view.toward / ((eye - points) @ view.toward)
    met = points + share[:, None] * (eye - points)
    np.testing.assert_allclose(view.paper(points), OBLIQUE.paper(met), atol=1e-12)
    lines = view.far * view.sight(points)
    np.testing.assert_allclose(lines, eye - points, atol=1e-12)
    order = np.argsort(view.depth(points))
    np.testing.assert_array_equal(order, np.argsort(-np.linalg.norm(eye - points, axis=1)))


def test_an_eye_at_infinity_sees_a_parallel_projection():
    rng = np.random.default_rng(1)
    points = rng.uniform(LOW, HIGH, (20, 3))
    away = replace(perspective(LOW, HIGH), far=math.inf)
    np.testing.assert_allclose(away.paper(points), OBLIQUE.paper(points), atol=1e-14)
    for view in (SIDE, ABOVE, AHEAD, OBLIQUE, away):
        flat = np.array([view.across, view.up])
        np.testing.assert_allclose(view.paper(points), points @ flat.T, atol=1e-14)
        np.testing.assert_array_equal(view.sight(points), np.tile(view.toward, (20, 1)))
        np.testing.assert_array_equal(view.depth(points), points @ view.toward)


def test_the_sides_of_the_box_behind_are_drawn_and_the_panel_holds_it():
    axes = Figure().add_subplot()
    view = fit_scene(axes, LOW, HIGH).view
    eye = MIDDLE + view.far * view.toward
    panes = [patch.get_xy()[:4] for patch in axes.patches]
    assert len(panes) == 3
    corners = box_corners(LOW, HIGH)
    farthest = corners[np.argmax(np.linalg.norm(corners - eye, axis=1))]
    for pane in panes:  # all of them have the farthest corner
        assert np.linalg.norm(pane - view.paper(farthest), axis=1).min() < 1e-12
    low, high = np.transpose([axes.get_xlim(), axes.get_ylim()])
    assert ((view.paper(corners) > low) & (view.paper(corners) < high)).all()


# ---------------------------------------------------------------- bodies in the box


def test_only_the_part_of_a_large_sphere_in_the_box_shows():
    # a cap of height 0.1 m comes into the box from above; its area is 2 pi R h
    (sphere,) = obstacles_of('kind="sphere", position=[0.2, 0.0, -7.6], radius=2.0')
    low, high = np.array([-1.0, -1.0, -10.3]), np.array([1.4, 1.0, -9.5])
    facets = obstacle_facets(sphere, low, high)
    assert (facets >= low - 1e-12).all()
    assert (facets <= high + 1e-12).all()
    assert area(facets) == pytest.approx(2 * np.pi * 2.0 * 0.1, rel=0.02)
    distance = np.linalg.norm(facets - sphere.path[-1], axis=2)
    np.testing.assert_allclose(distance, 2.0, rtol=2e-3)
    view = perspective(low, high)
    outline, box = clipped_outline(sphere, low, high, view), view.paper(box_corners(low, high))
    assert (outline > box.min(axis=0)).all()
    assert (outline < box.max(axis=0)).all()


def test_a_body_outside_the_box_is_not_seen():
    tables = (
        'kind="sphere", position=[0.2, 3.0, -10.0], radius=2.0',
        'kind="cylinder", position=[0.2, 3.0, -10.0], radius=2.0, axis=[1.0, 0.0, 0.3]',
        'kind="capsule", position=[0.2, 0.0, -12.0], radius=0.5, length=2.0',
        'kind="plane", position=[0.0, 0.0, -11.0], normal=[0.0, 0.0, 1.0]',
    )
    for body in obstacles_of(*tables):
        assert clipped_outline(body, LOW, HIGH, OBLIQUE).size == 0


def test_bodies_within_the_box_are_seen_whole():
    tables = (
        'kind="sphere", position=[0.2, 0.1, -10.0], radius=0.1',
        'kind="capsule", position=[0.2, 0.0, -9.9], radius=0.05, length=0.3, axis=[1.0, 0.5, 0.2]',
        'kind="cylinder", position=[0.2, 0.0, 3.0], radius=0.05, axis=[0.0, 0.0, 1.0]',
    )
    shares = 2 * 0.1**2, 2 * 0.05**2 + 0.05 * 0.3, 0.05**2 + 0.05 * (HIGH[2] - LOW[2])
    expected = 2 * np.pi * np.array(shares)
    for body, exact in zip(obstacles_of(*tables), expected, strict=True):
        assert area(obstacle_facets(body, LOW, HIGH)) == pytest.approx(exact, rel=0.015)


def test_an_aslant_thick_cylinder_whose_axis_misses_the_box_is_seen():
    (pile,) = obstacles_of(
        'kind="cylinder", position=[0.2, 0.0, -11.0], radius=0.8, axis=[1.0, 0.3, 0.1]'
    )
    facets = obstacle_facets(pile, LOW, HIGH)
    distance = np.linalg.norm(facets - pile.nearest(-1, facets), axis=2)
    np.testing.assert_allclose(distance, 0.8, rtol=2e-3)
    assert np.ptp(facets[..., 0]) == pytest.approx(1.0)  # from one side of the box to the other


def test_facets_are_cut_at_the_sides_of_a_box():
    square = np.array([[[0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0]]], dtype=float)
    cut = within_box(square, np.array([-1.0, -1.0, -1.0]), np.array([1.0, 3.0, 1.0]))
    assert area(cut) == pytest.approx(2.0)
    assert cut[..., 0].max() == 1.0
    # a corner taken off, which leaves five
    turned = square @ np.array([[1, 1, 0], [-1, 1, 0], [0, 0, 1]]) / np.sqrt(2)
    high = np.array([3.0, np.sqrt(8) - 0.5, 1.0])
    assert area(within_box(turned, -high, high)) == pytest.approx(4.0 - 0.25)
    assert within_box(square, np.full(3, 5.0), np.full(3, 6.0)).shape == (0, 4, 3)


# ---------------------------------------------------------------- what hides what


@pytest.mark.parametrize(("view", "axis"), [(SIDE, 1), (ABOVE, 2), (AHEAD, 0)])
def test_an_obstacle_behind_the_arm_does_not_hide_it(view, axis):
    toward = view.toward[axis]
    for side, hidden in ((0.1, True), (-0.1, False)):
        place = curling_arm(records=3)["position"].values[-1, 15]
        place[axis] += side * toward
        text = f'[[obstacle]]\nkind = "sphere"\nposition = {place.tolist()}\nradius = 0.05\n'
        scene = among_obstacles(records=3, obstacles=text, drift=0.0)
        axes = Figure().add_subplot()
        draw_arm(axes, scene, LOW, HIGH, view)
        (ball,) = (patch for patch in axes.patches if patch.get_label() == "obstacle")
        (arm,) = (c for c in axes.collections if c.get_label() == "arm at the end")
        assert isinstance(arm, PolyCollection)
        assert (ball.get_zorder() > arm.get_zorder()) == hidden


@pytest.mark.parametrize("tilt", [-80.0, 0.0, 25.0])
def test_the_hull_is_a_level_ellipsoid_through_the_root_whose_ray_is_the_arm(tilt):
    data = curling_arm(records=3, tilt_deg=tilt, driven=False)
    carried = data.assign_attrs(scenario=data.attrs["scenario"] + "[vehicle]\nmass = 9.0\n")
    plate, *_ = (facets for facets, _, name in mount_facets(data) if name == "base")
    along = (plate - data["position"].values[-1, 0]) @ frame(0.0, np.deg2rad(tilt), 0.0)[:, 0]
    assert along.max() == pytest.approx(0.0, abs=1e-12)  # the arm leaves the top of the plate
    assert along.min() < -0.01
    data = carried
    hull, *_ = (facets for facets, _, name in mount_facets(data) if name == "submarine")
    half = np.array([0.34, 0.075, 0.075]) * 0.5
    middle = (hull.min(axis=(0, 1)) + hull.max(axis=(0, 1))) / 2
    np.testing.assert_allclose(np.sum(((hull - middle) / half) ** 2, axis=2), 1.0)
    ray = data["position"].values[-1, 0] - middle
    assert np.sum((ray / half) ** 2) == pytest.approx(1.0)
    normal = ray / half**2
    expected = frame(0.0, np.deg2rad(tilt), 0.0)[:, 0]
    np.testing.assert_allclose(normal / np.linalg.norm(normal), expected, atol=1e-9)


# ---------------------------------------------------------------- a tool


@pytest.mark.parametrize("until", [None, 1.0])
def test_a_tool_is_a_ball_of_its_volume_beyond_the_last_tip_that_held_it(until):
    data = curling_arm(records=5, duration=2.0)
    assert not tool_held(data).any()
    assert len(tool_facets(data)) == 0
    data.attrs["scenario"] += "[tool]\nmass = 1.0\nvolume = 4.2e-6\noffset = 0.03\n"
    data["tool_held"] = "time", np.where(data["time"] < (until or 9.0), 1.0, 0.0)
    data["tool_held"][0] = 0.0
    np.testing.assert_array_equal(tool_held(data), [False, True, *[until is None] * 3])
    last = -1 if until is None else 1
    before, tip = data["position"].values[last, -2:]
    ahead = (tip - before) / np.linalg.norm(tip - before)
    ball = tool_facets(data).reshape(-1, 3) - (tip + 0.03 * ahead)
    along, distance = ball @ ahead, np.linalg.norm(ball, axis=1)
    np.testing.assert_allclose(distance[along > 1e-9], (3 * 4.2e-6 / 4 / np.pi) ** (1 / 3))
    assert along.min() == pytest.approx(-0.03)  # its stem begins at the tip
    axes = Figure().add_subplot()
    draw_arm(axes, data, LOW, HIGH, SIDE)
    labels = [patch.get_label() for patch in axes.patches]
    assert ("tool" if until is None else "tool, where it was released") in labels
