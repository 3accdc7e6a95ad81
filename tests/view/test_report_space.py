"""The figures of an arm in space: what is on paper is where it is in space."""

import numpy as np
import pytest
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from PIL import Image

from crinoid.results.errors import angle_between
from crinoid.view.figures.charts.drive import drive_chart
from crinoid.view.figures.charts.tip import tip_chart
from crinoid.view.figures.paper import draw_chart
from crinoid.view.figures.perspective import PerspectivePlot
from crinoid.view.figures.run import Run
from crinoid.view.figures.shape import draw_bending
from crinoid.view.figures.sheet import draw_sheet
from crinoid.view.figures.surroundings import find_current
from crinoid.view.scene.bodies import rigid_bodies
from crinoid.view.scene.clip import convex_outline, cut_box, obstacle_facets, obstacle_outline
from crinoid.view.scene.data import ToolBall, find_obstacles, in_space
from crinoid.view.scene.mesh import AROUND, arm_attitudes, tube
from crinoid.view.scene.mount import base_directions
from crinoid.view.scene.projection import ABOVE, AHEAD, OBLIQUE, SIDE
from crinoid.view.scene.scene import build_scene
from helpers.figures import assert_drawn, assert_report, quick_and_slow
from helpers.spatial_result import (
    HIGH,
    LOW,
    among_obstacles,
    among_solids,
    curling_arm,
    frame,
)
from helpers.studies import save

PROJECTIONS = {"from above": ABOVE, "from the side": SIDE, "from ahead": AHEAD}


pytestmark = [pytest.mark.usefixtures("coarse"), pytest.mark.filterwarnings("error")]


@pytest.fixture(scope="module")
def scene():
    return among_obstacles(records=3)


@pytest.fixture(scope="module")
def sheet():
    """Sheet of a run among obstacles, and of that without control."""
    return draw_sheet(Run(among_obstacles(records=9), among_obstacles(records=9, driven=False)))


def panels(figure):
    """Panels of a sheet by the view, those of each run in turn."""
    found = {name: [] for name in [*PROJECTIONS, "in perspective"]}
    for axes in figure.axes:
        if axes.get_title(loc="left") in found:
            found[axes.get_title(loc="left")].append(axes)
    return found


# ---------------------------------------------------------------- files


ODD = {
    "hanging, failed": {
        "tilt_deg": -80.0,
        "moving_target": True,
        "status": "failed at t = 12 s: no",
    },
    "straight up, nothing moves": {"tilt_deg": 90.0, "bend": (0.0, 0.0), "twist": 0.0}
    | {"driven": False, "flow": (0.0, 0.0, 0.0)},
    "one record": {"records": 1, "duration": 0.0},
    "two nodes, a millimetre across the view": {"nodes": 2, "length": 1e-3, "pan_deg": 90.0},
}


@pytest.mark.parametrize("name", quick_and_slow(ODD, quick=1))
def test_odd_runs_are_drawn(name, tmp_path):
    run = Run(curling_arm(**{"records": 7} | ODD[name]))
    charts = [lambda run, of=of: draw_chart(of(run), run) for of in (tip_chart, drive_chart)]
    assert_drawn(run, tmp_path, draw_sheet, draw_bending, *charts)


def test_a_result_of_shapes_alone_is_drawn(tmp_path):
    few = curling_arm(records=5)[["position", "tip_position", "tip_target", "tip_error"]]
    save(few.drop_vars(["diameter", "arc_length"]), tmp_path / "result.nc")
    assert_report(tmp_path)


def test_solids_and_a_hull_are_drawn(tmp_path):
    run = Run(among_solids(records=7))
    assert_drawn(run, tmp_path, draw_sheet)
    (side,) = panels(draw_sheet(run))["from the side"]
    rock = next(text for text in side.texts if text.get_text() == "0")
    assert rock.xy == pytest.approx([0.35, -10.1])


@pytest.mark.slow
def test_obstacles_and_the_uncontrolled_run_are_drawn_on_one_page(tmp_path):
    save(among_obstacles(records=9), tmp_path / "result.nc")
    save(among_obstacles(records=9, driven=False), tmp_path / "uncontrolled.nc")
    assert_report(tmp_path, "contact.png")
    with Image.open(tmp_path / "shape.png") as drawn:
        wide, high = np.divide(drawn.size, drawn.info["dpi"])
    assert wide == pytest.approx(7.4, abs=0.01)  # a page is 8.3 x 11.7 inches
    assert high < 12.0


# ---------------------------------------------------------------- views


def test_views_are_right_handed_from_starboard_above_and_ahead():
    for view in (SIDE, ABOVE, AHEAD, OBLIQUE):
        rows = np.array([view.across, view.up, view.toward])
        np.testing.assert_allclose(rows @ rows.T, np.eye(3), atol=1e-15)
        assert np.linalg.det(rows) == pytest.approx(1.0)
    assert OBLIQUE.axes == []
    labels = [" ".join(view.labels) for view in (SIDE, ABOVE, AHEAD)]
    assert labels == ["x (m) z (m)", "x (m) y (m)", "y (m) z (m)"]
    np.testing.assert_array_equal(SIDE.toward, [0, -1, 0])
    np.testing.assert_array_equal(ABOVE.toward, [0, 0, 1])
    np.testing.assert_array_equal(AHEAD.toward, [1, 0, 0])
    assert OBLIQUE.paper(np.array([0.0, 0.0, 1.0]))[0] == 0.0  # what stands upright stays so


@pytest.mark.parametrize(("pan", "tilt"), [(0.0, -80.0), (30.0, 20.0), (120.0, -45.0)])
def test_the_hull_points_along_the_base(pan, tilt):
    data = curling_arm(records=5, pan_deg=pan, tilt_deg=tilt)
    for record in (0, 3):
        pose = dict(zip(data["channel"].values, data["base_pose"].values[record], strict=True))
        expected = frame(np.deg2rad(pan) + pose["pan"], np.deg2rad(tilt) + pose["tilt"], 0.0)[:, 0]
        np.testing.assert_allclose(base_directions(data)[record], expected, atol=1e-15)


def test_the_sheet_has_one_scale_and_its_views_line_up(sheet):
    found = panels(sheet)
    assert {name: len(axes) for name, axes in found.items()} == dict.fromkeys(found, 2)
    wide, tall = sheet.get_size_inches()
    scales = []
    for name in PROJECTIONS:
        for axes in found[name]:
            box = axes.get_position()
            scales += [box.width * wide / np.ptp(axes.get_xlim())]
            scales += [box.height * tall / np.ptp(axes.get_ylim())]
    np.testing.assert_allclose(scales, scales[0], rtol=1e-12)
    for above, side, ahead in zip(*(found[name] for name in PROJECTIONS), strict=True):
        assert above.get_xlim() == side.get_xlim()
        assert ahead.get_ylim() == side.get_ylim()
        assert above.get_position().x0 == pytest.approx(side.get_position().x0)
        assert ahead.get_position().y0 == pytest.approx(side.get_position().y0)
        assert above.get_position().y0 > side.get_position().y1
        assert ahead.get_position().x0 > side.get_position().x1
    for axes in found.values():  # the runs compare at a glance
        assert axes[0].get_xlim() == axes[1].get_xlim()
        assert axes[0].get_ylim() == axes[1].get_ylim()


@pytest.mark.parametrize("tilt", [0.0, -80.0])
def test_the_sheet_shows_the_arm_over_time(tilt):
    data = curling_arm(records=9, tilt_deg=tilt)
    found = panels(draw_sheet(Run(data)))
    for name, view in PROJECTIONS.items():
        (axes,) = found[name]
        lines = (each for each in axes.collections if isinstance(each, LineCollection))
        coloured = (each for each in lines if each.get_array() is not None)
        shapes = next(each for each in coloured if len(each.get_segments()) == 9)
        expected = view.paper(data["position"].values)
        np.testing.assert_allclose(np.array(shapes.get_segments()), expected)
        np.testing.assert_array_equal(shapes.get_array(), data["time"].values)
        low, high = np.transpose([axes.get_xlim(), axes.get_ylim()])
        assert np.all((expected > low) & (expected < high))


def test_no_text_of_the_sheet_lies_over_another_or_off_the_page(sheet):
    sheet.draw_without_rendering()
    page, texts = sheet.bbox, list(sheet.texts)
    for axes in sheet.axes:
        texts.append(axes._left_title)
        texts += [text for text in axes.texts if text.get_bbox_patch() is None]  # no obstacle's
        for axis in (axes.xaxis, axes.yaxis) if axes.axison else ():
            low, high = sorted(axis.get_view_interval())
            shown = [tick for tick in axis.get_major_ticks() if low <= tick.get_loc() <= high]
            texts += [axis.label, *(tick.label1 for tick in shown if tick.label1.get_visible())]
            texts += [tick.label2 for tick in shown if tick.label2.get_visible()]
    texts = [text for text in texts if text.get_text()]
    boxes = [text.get_window_extent() for text in texts]
    assert len(boxes) > 70
    for index, box in enumerate(boxes):
        words = texts[index].get_text()
        assert page.x0 <= box.x0, words
        assert box.x1 <= page.x1, words
        for other, text in zip(boxes[:index], texts[:index], strict=True):
            assert not box.overlaps(other), (words, text.get_text())


# ---------------------------------------------------------------- bodies


def test_silhouettes_are_those_of_the_bodies_in_space(scene):
    turn = np.linspace(0, 2 * np.pi, 60)
    directions = np.stack([np.cos(turn), np.sin(turn)])
    ball = np.random.default_rng(0).normal(size=(40000, 3))
    ball /= np.linalg.norm(ball, axis=1, keepdims=True)
    sphere, _, capsule, _ = find_obstacles(scene)
    for body in (sphere, capsule):
        ends = [body.radius * ball + s * body.half_axis[-1] for s in (-1, 1)]
        points = body.path[-1] + np.concatenate(ends)
        for view in (SIDE, ABOVE, AHEAD, OBLIQUE):
            drawn, expected = obstacle_outline(body, -1, LOW, HIGH, view), view.paper(points)
            reach, wanted = ((each @ directions).max(axis=0) for each in (drawn, expected))
            np.testing.assert_allclose(reach, wanted, atol=0.01 * body.radius)
    assert np.linalg.norm(capsule.half_axis[-1]) == pytest.approx(0.1)


def test_a_free_capsule_that_turns_is_drawn_turned(scene):
    capsule = find_obstacles(scene)[2]
    first = capsule.half_axis[0] / np.linalg.norm(capsule.half_axis[0])
    across = np.cross(first, [0.3, 0.5, 0.8])
    angle = np.array([0.0, 0.7, 1.9])[:, None]
    turned = np.cos(angle) * first + np.sin(angle) * across / np.linalg.norm(across)
    axes = np.tile([1.0, 0.0, 0.0], (3, 4, 1))
    axes[:, 2] = turned
    data = scene.assign(obstacle_axis=(("time", "obstacle", "axis"), axes))
    capsule = find_obstacles(data)[2]
    np.testing.assert_allclose(capsule.half_axis, 0.1 * turned, atol=1e-12)
    whole = build_scene([("", data)], 10, 10)
    (body,) = (x for x in rigid_bodies(whole, whole.members[0]) if x.name == "obstacle 2")
    for record in range(3):
        ends = body.transform(body.shape.half * np.array([[-1.0, 0, 0], [1.0, 0, 0]]), record)
        expected = capsule.path[record] + np.outer([-0.1, 0.1], turned[record])
        np.testing.assert_allclose(ends, expected, atol=1e-9)
    ball = np.random.default_rng(0).normal(size=(40000, 3))
    ball *= capsule.radius / np.linalg.norm(ball, axis=1, keepdims=True)
    points = np.concatenate([ball + end for end in ends])
    around = np.linspace(0, 2 * np.pi, 60)
    directions = np.stack([np.cos(around), np.sin(around)])
    for view in (SIDE, ABOVE, AHEAD, OBLIQUE):
        drawn, wanted = obstacle_outline(capsule, -1, LOW, HIGH, view), view.paper(points)
        reach, expected = ((each @ directions).max(axis=0) for each in (drawn, wanted))
        np.testing.assert_allclose(reach, expected, atol=0.01 * capsule.radius)


def test_a_tool_is_drawn_with_its_radius():
    table = {"mass": 0.2, "volume": 5e-5, "offset": 0.03}
    assert ToolBall.of(table | {"radius": 0.07}) == ToolBall(0.07, 0.03)
    assert 4 / 3 * np.pi * ToolBall.of(table).radius ** 3 == pytest.approx(5e-5)


def test_an_endless_pole_is_a_circle_from_its_end_and_a_band_that_ends_at_the_box(scene):
    pole = find_obstacles(scene)[1]
    circle = obstacle_outline(pole, -1, LOW, HIGH, ABOVE) - pole.path[-1, :2]
    np.testing.assert_allclose(np.linalg.norm(circle, axis=1), 0.02, rtol=1e-9)
    band = obstacle_outline(pole, -1, LOW, HIGH, SIDE)
    assert np.ptp(band[:, 0]) == pytest.approx(0.04)
    assert band[:, 1].min() < LOW[2]
    assert band[:, 1].max() > HIGH[2]
    heights = obstacle_facets(pole, LOW, HIGH)[..., 2]
    assert (heights.min(), heights.max()) == (pytest.approx(LOW[2]), pytest.approx(HIGH[2]))


def test_a_wall_is_hatched_from_its_edge_and_a_field_from_its_front(sheet):
    found = panels(sheet)
    hatched = [[p for p in found[name][0].patches if p.get_hatch()] for name in PROJECTIONS]
    tops = [[p.get_xy()[:, 1].max() for p in each] for each in hatched]
    assert tops == [[], [pytest.approx(-10.2)], [pytest.approx(-10.2)]]  # below the bed


def test_an_obstacle_far_behind_the_arm_is_left_out():
    patches = []
    for y in (0.1, 5.0):  # from the side both would stand across the arm
        ball = f'obstacle = [{{kind="sphere", position=[0.3, {y}, -10.0], radius=0.05}}]\n'
        data = among_obstacles(records=3, obstacles=ball, drift=0.0)
        patches.append(len(panels(draw_sheet(Run(data)))["from the side"][0].patches))
    assert patches[0] == patches[1] + 1


def test_a_plane_cuts_a_box_and_parts_its_corners():
    low, high = np.zeros(3), np.array([1.0, 2.0, 3.0])
    cut, behind = cut_box(np.array([0.0, 0.0, 1.0]), np.array([9.0, 9.0, 1.0]), low, high)
    assert len(cut) == len(behind) == 4
    np.testing.assert_allclose(cut[:, 2], 1.0)
    assert np.all(behind[:, 2] == 0.0)
    x, y = convex_outline(ABOVE.paper(cut)).T
    assert 0.5 * abs(x @ np.roll(y, 1) - y @ np.roll(x, 1)) == pytest.approx(2.0)
    out = np.array([1.0, 1.0, 1.0]) / np.sqrt(3)
    cut, behind = cut_box(out, np.array([0.5, 0.0, 0.0]), low, high)
    assert len(cut) == 3
    np.testing.assert_allclose(np.sort(cut.ravel())[-3:], 0.5)
    np.testing.assert_array_equal(behind, [[0, 0, 0]])
    assert len(cut_box(out, np.array([9.0, 9.0, 9.0]), low, high)[0]) == 0


def test_a_tube_is_as_thick_as_the_arm_and_begins_at_its_director():
    data = curling_arm(records=3, twist=12.0)
    position, director = in_space(data, "position")[-1], in_space(data, "director")[-1]
    attitude = arm_attitudes(position[None], director[None])[0]
    facets = tube(position, data["diameter"].values / 2, attitude).facets
    edges = len(position) - 1
    rings = facets.reshape(edges + 2, AROUND, 4, 3)[1:-1]  # without the ends
    off = rings[:, :, 0] - position[:-1, None]
    radius = data["diameter"].values[:-1] / 2
    np.testing.assert_allclose(np.linalg.norm(off, axis=2), radius[:, None] * np.ones(AROUND))
    middle = rings[:, 0].mean(axis=1) - (position[1:] + position[:-1]) / 2
    middle /= np.linalg.norm(middle, axis=1, keepdims=True)
    assert np.sum(middle * director, axis=1).min() > 0.99
    turned = np.arccos(np.clip(np.sum(middle[0] * middle[-1]), -1, 1))
    assert turned > 1.0  # the arm does twist


def test_near_lines_cover_far_ones():
    low, high = np.full(3, -1.0), np.full(3, 1.0)
    axes = Figure().add_subplot()
    scene = PerspectivePlot(axes, low, high, OBLIQUE)
    near, far = 0.5 * OBLIQUE.toward, -0.5 * OBLIQUE.toward
    side = 0.1 * np.array(OBLIQUE.across)
    for place, colour in ((near, "red"), (far, "blue"), (0 * near, "green")):
        scene.add_line(np.stack([place - side, place + side]), colour)
    scene.draw()
    edges = axes.collections[-1].get_edgecolor()
    order = [tuple(np.round(edge[:3], 1)) for edge in edges]
    assert order == [(0.0, 0.0, 1.0), (0.0, 0.5, 0.0), (1.0, 0.0, 0.0)]


# ---------------------------------------------------------------- quantities


@pytest.mark.parametrize("flow", [(0.2, 0.0, 0.0), (0.0, 0.3, 0.0), (0.1, 0.1, 0.2)])
def test_water_has_one_scale_in_all_views(flow):
    data = curling_arm(records=9, flow=flow)
    scales = [find_current(data, view).scale for view in (SIDE, ABOVE, AHEAD)]
    np.testing.assert_allclose(scales, scales[0], rtol=1e-12)
    mean = find_current(data, ABOVE).mean
    along = mean / np.linalg.norm(mean, axis=1, keepdims=True)
    heading = np.array(flow[:2]) / np.linalg.norm(flow[:2])
    np.testing.assert_allclose(along, np.tile(heading, (len(along), 1)), atol=1e-12)


def rows_of(figure):
    """Panels of the figure of bending by the row, those of each run in turn."""
    names = ["kappa_1", "kappa_2", "twist"]
    columns = [axes for axes in figure.axes if axes.get_subplotspec() is not None]
    return {
        name: [axes for axes in columns if axes.get_subplotspec().rowspan.start == row]
        for row, name in enumerate(names)
    }


def test_bending_shows_the_numbers_of_the_result_over_the_arm_at_rest():
    made = curling_arm(records=5)
    arc, curvature = made["arc_length"].values, made["curvature"].values
    expected = {
        "kappa_1": (arc, curvature[..., 0]),
        "kappa_2": (arc, curvature[..., 1]),
        "twist": ((arc[1:] + arc[:-1]) / 2, made["twist"].values),
    }
    stretched = made.assign(position=1.3 * made["position"])
    for data in (made, stretched):
        for name, (axes,) in rows_of(draw_bending(Run(data))).items():
            place, values = expected[name]
            segments = np.array(axes.collections[0].get_segments())
            np.testing.assert_allclose(segments[..., 0], np.tile(place, (5, 1)), atol=1e-12)
            np.testing.assert_allclose(segments[..., 1], values)
            assert axes.get_ylabel().endswith("/m)")
            assert axes.get_xlim() == (0.0, pytest.approx(0.5))


def test_two_runs_share_a_scale_of_bending_that_cuts_neither():
    run = Run(curling_arm(records=5), curling_arm(records=5, bend=(0.0, 2.2), twist=1e-14))
    for name, panels_of_row in rows_of(draw_bending(run)).items():
        limits = [axes.get_ylim() for axes in panels_of_row]
        assert limits[0] == limits[1]
        for axes, (_, data) in zip(panels_of_row, run.members, strict=True):
            values = data["twist"] if name == "twist" else data["curvature"].sel(bending=name)
            assert axes.get_ylim()[0] <= float(values.min())
            assert axes.get_ylim()[1] >= float(values.max())
    # what is nothing in all runs is drawn as such, round-off and all
    straight = run.uncontrolled
    for data in (straight, straight.assign(twist=0.0 * straight["twist"])):
        for axes in rows_of(draw_bending(Run(straight, data)))["twist"]:
            assert axes.get_ylim() == (-1.0, 1.0)


def test_small_angles_between_directions_are_exact():
    angle = np.array([0.0, 1e-9, 0.3, np.pi / 2, np.pi])
    one = np.tile([1.0, 0.0, 0.0], (5, 1))
    other = np.column_stack([np.cos(angle), 0.6 * np.sin(angle), 0.8 * np.sin(angle)])
    np.testing.assert_allclose(angle_between(one, other), angle, rtol=1e-12, atol=1e-15)
