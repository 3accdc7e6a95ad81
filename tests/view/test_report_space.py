"""The figures of an arm in space: what is on paper is where it is in space."""

from itertools import combinations

import numpy as np
import pytest
from matplotlib.collections import LineCollection

from crinoid.results.errors import angle_between
from crinoid.results.result import Result
from crinoid.results.scene.bodies import obstacle_body
from crinoid.results.scene.clip import within_box
from crinoid.results.scene.mount import find_mount
from crinoid.results.scene.projection import ABOVE, AHEAD, OBLIQUE, SIDE, perspective
from crinoid.view.figures.charts.drive import drive_chart
from crinoid.view.figures.charts.tip import tip_chart
from crinoid.view.figures.paper import draw_chart
from crinoid.view.figures.shape import draw_bending
from crinoid.view.figures.sheet import draw_sheet
from crinoid.view.figures.surroundings import tool_facets
from helpers.figures import assert_drawn, assert_report, quick_and_release
from helpers.made_results import of_runs
from helpers.spatial_result import HIGH, LOW, among_obstacles, among_solids, curling_arm, frame
from helpers.studies import save

PROJECTIONS = {"from above": ABOVE, "from the side": SIDE, "from ahead": AHEAD}


pytestmark = [pytest.mark.usefixtures("coarse"), pytest.mark.filterwarnings("error")]


ODD = {
    "hanging, failed": {"tilt_deg": -80.0, "moving_target": True, "status": "failed at t = 12 s"},
    "straight up, nothing moves": {"tilt_deg": 90.0, "bend": (0.0, 0.0), "twist": 0.0}
    | {"driven": False, "flow": (0.0, 0.0, 0.0)},
    "one record": {"records": 1, "duration": 0.0},
    "two nodes, a millimetre across the view": {"nodes": 2, "length": 1e-3, "pan_deg": 90.0},
}


@pytest.mark.parametrize("name", quick_and_release(ODD, quick=1))
def test_odd_runs_are_drawn(name, tmp_path):
    run = Result(curling_arm(**{"records": 7} | ODD[name]))
    charts = [
        lambda run, of=of: draw_chart(of(run), run.dataset, run.title)
        for of in (tip_chart, drive_chart)
    ]
    assert_drawn(run, tmp_path, draw_sheet, draw_bending, *charts)


def test_a_result_of_shapes_alone_is_drawn(tmp_path):
    few = curling_arm(records=5)[["position", "tip_position", "tip_target", "tip_error"]]
    save(few.drop_vars(["diameter", "arc_length"]), tmp_path / "result.nc")
    assert_report(tmp_path)


def test_solids_and_a_hull_are_drawn(tmp_path):
    assert_drawn(Result(among_solids(records=7)), tmp_path, draw_sheet)


@pytest.mark.slow
def test_obstacles_and_the_uncontrolled_run_are_drawn(tmp_path):
    save(among_obstacles(records=9), tmp_path / "result.nc")
    save(among_obstacles(records=9, driven=False), tmp_path / "uncontrolled.nc")
    assert_report(tmp_path, "contact.png")


@pytest.mark.parametrize(("pan", "tilt"), [(0.0, -80.0), (30.0, 20.0), (120.0, -45.0)])
def test_the_hull_points_along_the_base(pan, tilt):
    data = curling_arm(records=5, pan_deg=pan, tilt_deg=tilt)
    for record in (0, 3):
        pose = dict(zip(data["channel"].values, data["base_pose"].values[record], strict=True))
        expected = frame(np.deg2rad(pan) + pose["pan"], np.deg2rad(tilt) + pose["tilt"], 0.0)[:, 0]
        np.testing.assert_allclose(find_mount(Result(data)).direction[record], expected, atol=1e-15)


@pytest.mark.parametrize("tilt", [0.0, -80.0])
def test_the_sheet_shows_the_arm_over_time(tilt):
    data = curling_arm(records=9, tilt_deg=tilt)
    found = {axes.get_title(loc="left"): axes for axes in draw_sheet(Result(data)).axes}
    for name, view in PROJECTIONS.items():
        axes = found[name]
        lines = (each for each in axes.collections if isinstance(each, LineCollection))
        coloured = (each for each in lines if each.get_array() is not None)
        shapes = next(each for each in coloured if len(each.get_segments()) == 9)
        expected = view.paper(data["position"].values)
        drawn = np.array(shapes.get_segments())
        pieces = (drawn.shape[1] - 1) // (data.sizes["node"] - 1)
        np.testing.assert_allclose(drawn[:, ::pieces], expected, atol=1e-12)
        np.testing.assert_array_equal(shapes.get_array(), data["time"].values)
        low, high = np.transpose([axes.get_xlim(), axes.get_ylim()])
        assert np.all((expected > low) & (expected < high))


@pytest.mark.slow
def test_no_text_of_the_sheet_lies_over_another_or_off_the_page():
    sheet = draw_sheet(
        of_runs(among_obstacles(records=9), among_obstacles(records=9, driven=False))
    )
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
    boxes = [(text.get_text(), text.get_window_extent()) for text in texts if text.get_text()]
    assert len(boxes) > 70
    assert all(page.x0 <= box.x0 and box.x1 <= page.x1 for _, box in boxes)
    for (words, box), (others, other) in combinations(boxes, 2):
        assert not box.overlaps(other), (words, others)


def test_a_point_is_where_its_line_to_the_eye_meets_the_paper():
    view, middle = perspective(LOW, HIGH), (LOW + HIGH) / 2
    eye = middle + view.far * view.toward
    points = np.random.default_rng(0).uniform(LOW, HIGH, (50, 3))
    share = (middle - points) @ view.toward / ((eye - points) @ view.toward)
    met = points + share[:, None] * (eye - points)
    np.testing.assert_allclose(view.paper(points), OBLIQUE.paper(met), atol=1e-12)
    order = np.argsort(view.depth(points))
    np.testing.assert_array_equal(order, np.argsort(-np.linalg.norm(eye - points, axis=1)))


@pytest.mark.parametrize(
    ("position", "radius", "area"),
    # half of the second is in the box
    [([0.2, 0.1, -10], 0.1, 0.04), ([0.2, 0, -9.5], 0.3, 0.18), ([0, 3.5, -10], 2.0, 0.0)],
)
def test_the_part_of_a_sphere_within_the_box_is_seen(position, radius, area):
    table = f'obstacle = [{{kind="sphere", position={position}, radius={radius}}}]\n'
    scene = Result(among_obstacles(records=3, obstacles=table, drift=0.0)).scene
    body = obstacle_body(scene.members[0].obstacles[0], scene, scene.members[0])
    low, high = np.array([-1.0, -1.0, -10.3]), np.array([1.4, 1.0, -9.5])
    facets = within_box(body.transform(body.shape.mesh(0.025).facets, 0), low, high)
    one, other = facets[:, 2] - facets[:, 0], facets[:, 3] - facets[:, 1]
    found = 0.5 * np.linalg.norm(np.cross(one, other), axis=1).sum()
    assert found == pytest.approx(np.pi * area, rel=0.02)
    assert ((facets >= low - 1e-12) & (facets <= high + 1e-12)).all()


@pytest.mark.parametrize("until", [None, 1.0])
def test_a_tool_is_a_ball_of_its_volume_beyond_the_last_tip_that_held_it(until):
    data = curling_arm(records=5, duration=2.0)
    data.attrs["scenario"] += "[tool]\nmass = 1.0\nvolume = 4.2e-6\noffset = 0.03\n"
    data["tool_held"] = "time", np.where(data["time"] < (until or 9.0), 1.0, 0.0)
    before, tip = data["position"].values[-1 if until is None else 1, -2:]
    ahead = (tip - before) / np.linalg.norm(tip - before)
    ball = tool_facets(Result(data).scene.members[0]).reshape(-1, 3) - (tip + 0.03 * ahead)
    along, distance = ball @ ahead, np.linalg.norm(ball, axis=1)
    np.testing.assert_allclose(distance[along > 1e-9], (3 * 4.2e-6 / 4 / np.pi) ** (1 / 3))
    assert along.min() == pytest.approx(-0.03)  # its stem begins at the tip


def test_bending_shows_the_numbers_of_the_result_over_the_arm_at_rest():
    made = curling_arm(records=5)
    arc, curvature = made["arc_length"].values, made["curvature"].values
    expected = [(arc, curvature[..., 0]), (arc, curvature[..., 1])]
    expected.append(((arc[1:] + arc[:-1]) / 2, made["twist"].values))
    for data in (made, made.assign(position=1.3 * made["position"])):
        for axes, (place, values) in zip(draw_bending(Result(data)).axes, expected, strict=False):
            segments = np.array(axes.collections[0].get_segments())
            np.testing.assert_allclose(segments[..., 0], np.tile(place, (5, 1)), atol=1e-12)
            np.testing.assert_allclose(segments[..., 1], values)


def test_small_angles_between_directions_are_exact():
    angle = np.array([0.0, 1e-9, 0.3, np.pi / 2, np.pi])
    one = np.tile([1.0, 0.0, 0.0], (5, 1))
    other = np.column_stack([np.cos(angle), 0.6 * np.sin(angle), 0.8 * np.sin(angle)])
    np.testing.assert_allclose(angle_between(one, other), angle, rtol=1e-12, atol=1e-15)
