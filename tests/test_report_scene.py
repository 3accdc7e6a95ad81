"""The perspective of the figures in space, what it shows of bodies, and what hides what."""

import math
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure

from crinoid.report.arm import draw_arm, hull_outline
from crinoid.report.charts.tool import held
from crinoid.report.finals import draw_finals_in_space, lay_out
from crinoid.report.obstacles import WALL
from crinoid.report.scene import solid_outline, solid_surface
from crinoid.report.sheet import fit_scene
from crinoid.report.solids import find_bodies
from crinoid.report.surface import box_corners, within_box
from crinoid.report.tool import surface
from crinoid.report.view import ABOVE, AHEAD, OBLIQUE, SIDE, convex_outline, perspective
from spatial_arm import among_obstacles, curling_arm

LOW, HIGH = np.array([-0.3, -0.4, -10.3]), np.array([0.7, 0.4, -9.5])
MIDDLE = (LOW + HIGH) / 2


def bodies(*tables):
    """Obstacles beside an arm at rest, of tables of a scenario."""
    text = "".join(f"[[obstacle]]\n{table}\n" for table in tables)
    return find_bodies(among_obstacles(records=3, obstacles=text, drift=0.0))


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


def test_parallel_edges_of_the_box_meet_far_away():
    view = perspective(LOW, HIGH)
    for axis in range(3):
        other = [a for a in range(3) if a != axis]
        starts = np.tile(LOW, (4, 1))
        starts[[1, 3], other[0]] = HIGH[other[0]]
        starts[[2, 3], other[1]] = HIGH[other[1]]
        ends = starts.copy()
        ends[:, axis] = HIGH[axis]
        begin, end = view.paper(starts), view.paper(ends)
        along = end - begin
        # lines p with n (p - begin) = 0, all through one point
        normal = np.column_stack([-along[:, 1], along[:, 0]])
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        point, *_ = np.linalg.lstsq(normal, np.sum(normal * begin, axis=1), rcond=None)
        np.testing.assert_allclose(normal @ point, np.sum(normal * begin, axis=1), atol=1e-9)


def test_what_is_near_is_larger_on_paper():
    view = perspective(LOW, HIGH)
    nearness = np.array([-0.5, -0.1, 0.0, 0.3])
    places = MIDDLE + nearness[:, None] * view.toward
    for way in (view.across, view.up):
        lengths = np.linalg.norm(
            view.paper(places + 0.1 * np.array(way)) - view.paper(places), axis=1
        )
        np.testing.assert_allclose(lengths, 0.1 * view.far / (view.far - nearness), rtol=1e-9)
        assert (np.diff(lengths) > 0.0).all()


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


def test_a_large_sphere_is_seen_as_far_as_it_is_in_the_box():
    # a cap of height 0.1 m comes into the box from above; its area is 2 pi R h
    (sphere,) = bodies('kind = "sphere"\nposition = [0.2, 0.0, -7.6]\nradius = 2.0')
    low, high = np.array([-1.0, -1.0, -10.3]), np.array([1.4, 1.0, -9.5])
    facets = solid_surface(sphere, low, high)
    assert (facets >= low - 1e-12).all()
    assert (facets <= high + 1e-12).all()
    assert area(facets) == pytest.approx(2 * np.pi * 2.0 * 0.1, rel=0.02)
    distance = np.linalg.norm(facets - sphere.path[-1], axis=2)
    np.testing.assert_allclose(distance, 2.0, rtol=2e-3)
    view = perspective(low, high)
    outline, box = solid_outline(sphere, low, high, view), view.paper(box_corners(low, high))
    assert (outline > box.min(axis=0)).all()
    assert (outline < box.max(axis=0)).all()


def test_a_body_outside_the_box_is_not_seen():
    tables = (
        'kind = "sphere"\nposition = [0.2, 3.0, -10.0]\nradius = 2.0',
        'kind = "cylinder"\nposition = [0.2, 3.0, -10.0]\nradius = 2.0\naxis = [1.0, 0.0, 0.3]',
        'kind = "capsule"\nposition = [0.2, 0.0, -12.0]\nradius = 0.5\nlength = 2.0',
        'kind = "plane"\nposition = [0.0, 0.0, -11.0]\nnormal = [0.0, 0.0, 1.0]',
    )
    for body in bodies(*tables):
        assert solid_outline(body, LOW, HIGH, OBLIQUE).size == 0


def test_bodies_within_the_box_are_seen_whole():
    tables = (
        'kind = "sphere"\nposition = [0.2, 0.1, -10.0]\nradius = 0.1',
        'kind = "capsule"\nposition = [0.2, 0.0, -9.9]\nradius = 0.05\nlength = 0.3\n'
        "axis = [1.0, 0.5, 0.2]",
        'kind = "cylinder"\nposition = [0.2, 0.0, 3.0]\nradius = 0.05\naxis = [0.0, 0.0, 1.0]',
    )
    pi, tall = np.pi, HIGH[2] - LOW[2]
    expected = (
        4 * pi * 0.1**2,
        4 * pi * 0.05**2 + 2 * pi * 0.05 * 0.3,
        2 * pi * 0.05**2 + 2 * pi * 0.05 * tall,
    )
    for body, exact in zip(bodies(*tables), expected, strict=True):
        assert area(solid_surface(body, LOW, HIGH)) == pytest.approx(exact, rel=0.015)


def test_an_aslant_thick_cylinder_whose_axis_misses_the_box_is_seen():
    (pile,) = bodies(
        'kind = "cylinder"\nposition = [0.2, 0.0, -11.0]\nradius = 0.8\naxis = [1.0, 0.3, 0.1]'
    )
    facets = solid_surface(pile, LOW, HIGH)
    np.testing.assert_allclose(
        np.linalg.norm(facets - pile.nearest(-1, facets), axis=2), 0.8, rtol=2e-3
    )
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
def test_what_is_behind_the_arm_does_not_hide_it(view, axis):
    toward = view.toward[axis]
    data = curling_arm(records=3)
    middle = data["position"].values[-1, 15]
    for side, hidden in ((0.1, True), (-0.1, False)):
        place = middle.copy()
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
def test_the_hull_in_the_plane_is_half_an_ellipse(tilt):
    data = curling_arm(records=3, tilt_deg=tilt, driven=False)
    drawn = hull_outline(data, SIDE) - SIDE.paper(data["position"].values[-1, 0])
    angle = np.deg2rad(tilt)
    along = drawn @ [np.cos(angle), np.sin(angle)]
    across = drawn @ [-np.sin(angle), np.cos(angle)]
    long = 0.16 * 0.5
    round_part = along > -long + 1e-9
    assert round_part.sum() > 20
    level = (along / long + 1) ** 2 + (across / (0.45 * long)) ** 2
    np.testing.assert_allclose(level[round_part], 1.0)
    assert np.ptp(across) == pytest.approx(0.9 * long)
    assert along.min() == pytest.approx(-long)


# ---------------------------------------------------------------- a tool


@pytest.mark.parametrize("until", [None, 1.0])
def test_a_tool_is_a_ball_of_its_volume_beyond_the_tip_where_it_was_last(until):
    data = curling_arm(records=5, duration=2.0)
    data.attrs["scenario"] += "[tool]\nmass = 1.0\nvolume = 4.2e-6\noffset = 0.03\n"
    data["tool_held"] = "time", np.where(data["time"] < (until or 9.0), 1.0, 0.0)
    data["tool_held"][0] = 0.0
    np.testing.assert_array_equal(held(data), [False, True, *[until is None] * 3])
    last = -1 if until is None else 1
    before, tip = data["position"].values[last, -2:]
    ahead = (tip - before) / np.linalg.norm(tip - before)
    ball = surface(data).reshape(-1, 3) - (tip + 0.03 * ahead)
    along, distance = ball @ ahead, np.linalg.norm(ball, axis=1)
    np.testing.assert_allclose(distance[along > 0], (3 * 4.2e-6 / 4 / np.pi) ** (1 / 3))
    assert along.min() == pytest.approx(-0.03)  # its stem begins at the tip
    axes = Figure().add_subplot()
    draw_arm(axes, data, LOW, HIGH, SIDE)
    labels = [patch.get_label() for patch in axes.patches]
    assert ("tool" if until is None else "tool, where it was let go") in labels


def test_without_a_tool_none_is_drawn():
    data = curling_arm(records=3)
    assert not held(data).any()
    assert len(surface(data)) == 0


# ---------------------------------------------------------------- a study


def test_the_views_of_a_study_show_obstacles_and_walls():
    finals = [(among_obstacles(records=3, drift=0.0).isel(time=[-1]), (0.2, 0.3, 0.4, 1.0))]
    figure = Figure(figsize=(8.0, 12.0))
    draw_finals_in_space(figure, finals, lay_out(finals, 8.0), 1.0)
    found = {axes.get_title(loc="left"): axes for axes in figure.axes}
    fields = {
        name: [p for p in axes.patches if p.get_facecolor() == to_rgba(WALL)]
        for name, axes in found.items()
    }
    assert {name: len(patches) for name, patches in fields.items()} == {
        "from above": 1,
        "from the side": 0,
        "from ahead": 0,
        "in perspective": 0,
    }
    corner = found["in perspective"]
    edges = [p for p in corner.patches if not p.get_fill()]
    assert len(edges) == 3  # sphere, capsule and bed; the pole is out of the box
    low, high = np.transpose([corner.get_xlim(), corner.get_ylim()])
    for edge in edges:
        assert len(convex_outline(edge.get_xy())) > 3
        assert ((edge.get_xy() > low) & (edge.get_xy() < high)).all()
