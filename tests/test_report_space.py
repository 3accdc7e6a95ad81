"""The figures of an arm in space: what is on paper is where it is in space."""

import warnings
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib import image
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from crinoid.metrics import angle_between
from crinoid.report import write_report
from crinoid.report.bending import draw_bending
from crinoid.report.charts.drive import drive_chart
from crinoid.report.charts.tip import tip_chart
from crinoid.report.current import find_current
from crinoid.report.page.file import PAGE
from crinoid.report.paper import draw_chart
from crinoid.report.run import Run, base_direction
from crinoid.report.scene import Scene, solid_surface
from crinoid.report.sheet import draw_sheet
from crinoid.report.solids import find_bodies
from crinoid.report.style import STYLE
from crinoid.report.surface import AROUND, cut_box, tube
from crinoid.report.view import ABOVE, AHEAD, OBLIQUE, SIDE, convex_outline, in_space
from spatial_arm import among_obstacles, curling_arm, frame
from test_report import FIGURES, assert_shows_something, save, study_row, write_study

PROJECTIONS = {"from above": ABOVE, "from the side": SIDE, "from ahead": AHEAD}


@pytest.fixture(autouse=True)
def _no_warning():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        yield


@pytest.fixture
def _coarse(monkeypatch):
    """Draw with fewer dots: what is asserted does not depend on them."""
    monkeypatch.setitem(STYLE, "savefig.dpi", 80)


def panels(figure):
    """Panels of a sheet by the view, those of each run in turn."""
    found = {name: [] for name in [*PROJECTIONS, "in perspective"]}
    for axes in figure.axes:
        if axes.get_title(loc="left") in found:
            found[axes.get_title(loc="left")].append(axes)
    return found


# ---------------------------------------------------------------- files


ODD = {
    "hanging": {"tilt_deg": -80.0},
    "straight up": {"tilt_deg": 90.0, "bend": (0.0, 0.0), "driven": False},
    "straight, nothing moves": {
        "bend": (0.0, 0.0),
        "twist": 0.0,
        "driven": False,
        "flow": (0.0, 0.0, 0.0),
    },
    "one record": {"records": 1, "duration": 0.0},
    "two nodes": {"nodes": 2},
    "a millimetre across the view": {"length": 1e-3, "pan_deg": 90.0, "flow": (0.0, 0.3, 0.0)},
    "failed": {"moving_target": True, "status": "failed at t = 12 s: no step"},
}


@pytest.mark.usefixtures("_coarse")
@pytest.mark.parametrize("name", ODD)
def test_odd_runs_are_drawn(name, tmp_path):
    run = Run(curling_arm(**{"records": 7} | ODD[name]))
    charts = (
        lambda run: draw_chart(tip_chart(run), run),
        lambda run: draw_chart(drive_chart(run), run),
    )
    for draw in (draw_sheet, draw_bending, *charts):
        with mpl.rc_context(STYLE):
            draw(run).savefig(tmp_path / "figure.png")
        assert_shows_something(tmp_path / "figure.png")


@pytest.mark.usefixtures("_coarse")
def test_a_result_of_shapes_alone_is_drawn(tmp_path):
    few = curling_arm(records=5)[["position", "tip_position", "tip_target", "tip_error"]]
    save(few.drop_vars(["diameter", "arc_length"]), tmp_path / "result.nc")
    for path in write_report(tmp_path):
        assert_shows_something(path)


def test_obstacles_and_the_uncontrolled_run_are_drawn(tmp_path):
    save(among_obstacles(records=9), tmp_path / "result.nc")
    save(among_obstacles(records=9, driven=False), tmp_path / "uncontrolled.nc")
    written = write_report(tmp_path)
    assert [path.name for path in written] == [*FIGURES, "contact.png", PAGE]
    for path in written:
        assert_shows_something(path)
    high, wide = image.imread(tmp_path / "shape.png").shape[:2]
    assert wide == pytest.approx(7.4 * 200, abs=2)  # a page is 8.3 x 11.7 inches
    assert high < 12.0 * 200


@pytest.mark.usefixtures("_coarse")
def test_a_study_in_space_is_drawn_with_each_of_its_cases(tmp_path):
    write_study(tmp_path, [study_row(1), study_row(2)])
    for number in (1, 2):
        data = among_obstacles(records=3, bend=(1.0 * number, 2.0))
        save(data, tmp_path / f"case-{number:02d}" / "result.nc")
    written = write_report(tmp_path)
    names = [Path("cases.png")]
    names += [
        Path(f"case-{n:02d}") / name for n in (1, 2) for name in [*FIGURES, "contact.png", PAGE]
    ]
    assert [path.relative_to(tmp_path) for path in written] == [*names, Path(PAGE)]
    assert_shows_something(tmp_path / "cases.png")


# ---------------------------------------------------------------- views


def test_views_are_right_handed_and_of_true_length():
    for view in (SIDE, ABOVE, AHEAD, OBLIQUE):
        rows = np.array([view.across, view.up, view.toward])
        np.testing.assert_allclose(rows @ rows.T, np.eye(3), atol=1e-15)
        assert np.linalg.det(rows) == pytest.approx(1.0)
    assert OBLIQUE.axes == []
    assert (SIDE.labels, ABOVE.labels, AHEAD.labels) == (
        ["x (m)", "z (m)"],
        ["x (m)", "y (m)"],
        ["y (m)", "z (m)"],
    )


def test_views_look_from_starboard_from_above_and_from_ahead():
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
        np.testing.assert_allclose(base_direction(data, record), expected, atol=1e-15)


def test_the_sheet_has_one_scale_and_its_views_line_up():
    figure = draw_sheet(Run(curling_arm(records=9), curling_arm(records=9, driven=False)))
    found = panels(figure)
    assert {name: len(axes) for name, axes in found.items()} == dict.fromkeys(found, 2)
    wide, tall = figure.get_size_inches()
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
def test_the_sheet_shows_the_arm_over_time_where_it_was(tilt):
    data = curling_arm(records=9, tilt_deg=tilt)
    found = panels(draw_sheet(Run(data)))
    for name, view in PROJECTIONS.items():
        (axes,) = found[name]
        shapes = next(
            lines
            for lines in axes.collections
            if isinstance(lines, LineCollection)
            and len(lines.get_segments()) == 9
            and lines.get_array() is not None
        )
        expected = view.paper(data["position"].values)
        np.testing.assert_allclose(np.array(shapes.get_segments()), expected)
        np.testing.assert_array_equal(shapes.get_array(), data["time"].values)
        low, high = np.transpose([axes.get_xlim(), axes.get_ylim()])
        assert np.all((expected > low) & (expected < high))


def test_no_text_of_the_sheet_lies_over_another_or_off_the_page():
    figure = draw_sheet(Run(among_obstacles(records=9), among_obstacles(records=9, driven=False)))
    figure.draw_without_rendering()
    page, texts = figure.bbox, list(figure.texts)
    for axes in figure.axes:
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


def support(points, directions):
    """Reach of points along directions."""
    return (points @ directions.T).max(axis=0)


def test_silhouettes_are_those_of_the_bodies_in_space():
    data = among_obstacles(records=3)
    low, high = np.array([-0.3, -0.4, -10.3]), np.array([0.7, 0.4, -9.5])
    turn = np.linspace(0, 2 * np.pi, 60)
    directions = np.column_stack([np.cos(turn), np.sin(turn)])
    rng = np.random.default_rng(0)
    ball = rng.normal(size=(40000, 3))
    ball /= np.linalg.norm(ball, axis=1, keepdims=True)
    sphere, _, capsule, _ = find_bodies(data)
    for body in (sphere, capsule):
        ends = np.concatenate(
            [body.solid.radius * ball + s * body.solid.half_axis for s in (-1, 1)]
        )
        points = body.path[-1] + ends
        for view in (SIDE, ABOVE, AHEAD, OBLIQUE):
            drawn = support(body.outline(-1, low, high, view), directions)
            np.testing.assert_allclose(
                drawn, support(view.paper(points), directions), atol=0.01 * body.solid.radius
            )
    assert np.linalg.norm(capsule.solid.half_axis) == pytest.approx(0.1)


def test_a_pole_is_a_circle_from_its_end_and_a_band_from_the_side():
    pole = find_bodies(among_obstacles(records=3))[1]
    low, high = np.array([-0.3, -0.4, -10.3]), np.array([0.7, 0.4, -9.5])
    circle = pole.outline(-1, low, high, ABOVE) - pole.path[-1, :2]
    np.testing.assert_allclose(np.linalg.norm(circle, axis=1), 0.02, rtol=1e-9)
    band = pole.outline(-1, low, high, SIDE)
    assert np.ptp(band[:, 0]) == pytest.approx(0.04)
    assert band[:, 1].min() < low[2]
    assert band[:, 1].max() > high[2]


def test_a_wall_is_hatched_from_its_edge_and_a_field_from_its_front():
    data = among_obstacles(records=3)
    found = panels(draw_sheet(Run(data)))
    hatches = {
        name: [patch for patch in found[name][0].patches if patch.get_hatch()]
        for name in PROJECTIONS
    }
    assert {name: len(patches) for name, patches in hatches.items()} == {
        "from above": 0,
        "from the side": 1,
        "from ahead": 1,
    }
    for name in ("from the side", "from ahead"):
        top = hatches[name][0].get_xy()[:, 1].max()
        assert top == pytest.approx(-10.2)  # solid below the bed


def test_an_obstacle_far_behind_the_arm_is_left_out():
    near = '[[obstacle]]\nkind = "sphere"\nposition = [0.3, 0.1, -10.0]\nradius = 0.05\n'
    far = near.replace("0.1, -10.0", "5.0, -10.0")

    def patches(obstacles):
        data = among_obstacles(records=3, obstacles=obstacles, drift=0.0)
        return [len(panels(draw_sheet(Run(data)))[name][0].patches) for name in PROJECTIONS]

    # from the side it would stand across the arm; elsewhere it is off the panel
    side = list(PROJECTIONS).index("from the side")
    assert patches(near)[side] == patches(far)[side] + 1


def test_a_box_is_cut_by_a_plane_and_knows_what_is_behind():
    low, high = np.zeros(3), np.array([1.0, 2.0, 3.0])
    cut, behind = cut_box(np.array([0.0, 0.0, 1.0]), np.array([9.0, 9.0, 1.0]), low, high)
    assert len(cut) == len(behind) == 4
    np.testing.assert_allclose(cut[:, 2], 1.0)
    assert np.all(behind[:, 2] == 0.0)
    area = convex_outline(ABOVE.paper(cut))
    x, y = area.T
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
    facets = tube(position, data["diameter"].values, director)
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


def test_what_is_near_is_drawn_over_what_is_far():
    low, high = np.full(3, -1.0), np.full(3, 1.0)
    axes = Figure().add_subplot()
    scene = Scene(axes, low, high, OBLIQUE)
    near, far = 0.5 * OBLIQUE.toward, -0.5 * OBLIQUE.toward
    side = 0.1 * np.array(OBLIQUE.across)
    for place, colour in ((near, "red"), (far, "blue"), (0 * near, "green")):
        scene.add_line(np.stack([place - side, place + side]), colour)
    scene.draw()
    edges = axes.collections[-1].get_edgecolor()
    order = [tuple(np.round(edge[:3], 1)) for edge in edges]
    assert order == [(0.0, 0.0, 1.0), (0.0, 0.5, 0.0), (1.0, 0.0, 0.0)]


def test_an_endless_pole_ends_at_the_box():
    low, high = np.array([-0.3, -0.4, -10.3]), np.array([0.7, 0.4, -9.5])
    pole = find_bodies(among_obstacles(records=3))[1]
    heights = solid_surface(pole, low, high)[..., 2]
    assert (heights.min(), heights.max()) == (pytest.approx(low[2]), pytest.approx(high[2]))


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


def test_bending_shows_the_numbers_of_the_result():
    data = curling_arm(records=5)
    figure = draw_bending(Run(data))
    arc = data["arc_length"].values
    expected = {
        "kappa_1": (arc, data["curvature"].values[..., 0]),
        "kappa_2": (arc, data["curvature"].values[..., 1]),
        "twist": ((arc[1:] + arc[:-1]) / 2, data["twist"].values),
    }
    rows = [axes for axes in figure.axes if axes.get_ylabel().endswith("/m)")]
    assert len(rows) == 3
    for axes, (place, values) in zip(rows, expected.values(), strict=True):
        segments = np.array(axes.collections[0].get_segments())
        np.testing.assert_allclose(segments[..., 0], np.tile(place, (5, 1)), atol=1e-12)
        np.testing.assert_allclose(segments[..., 1], values)
        assert axes.get_xlim() == (0.0, pytest.approx(0.5))


def rows_of(figure):
    """Panels of the figure of bending by the row, those of each run in turn."""
    names = ["kappa_1", "kappa_2", "twist"]
    columns = [axes for axes in figure.axes if axes.get_subplotspec() is not None]
    return {
        name: [axes for axes in columns if axes.get_subplotspec().rowspan.start == row]
        for row, name in enumerate(names)
    }


def test_runs_beside_each_other_are_bent_to_one_scale_that_cuts_neither():
    run = Run(curling_arm(records=5), curling_arm(records=5, bend=(0.0, 2.2), twist=1e-14))
    for name, panels_of_row in rows_of(draw_bending(run)).items():
        limits = [axes.get_ylim() for axes in panels_of_row]
        assert limits[0] == limits[1]
        for axes, (_, data) in zip(panels_of_row, run.members, strict=True):
            values = data["twist"] if name == "twist" else data["curvature"].sel(bending=name)
            assert axes.get_ylim()[0] <= float(values.min())
            assert axes.get_ylim()[1] >= float(values.max())
    # what is nothing in all runs is drawn as such, round-off and all
    straight = curling_arm(records=5, bend=(0.0, 2.2), twist=1e-14)
    for data in (straight, curling_arm(records=5, bend=(0.0, 2.2), twist=0.0)):
        for axes in rows_of(draw_bending(Run(straight, data)))["twist"]:
            assert axes.get_ylim() == (-1.0, 1.0)


def test_bending_is_drawn_over_the_arm_at_rest_however_it_starts():
    data = curling_arm(records=3)
    stretched = data.assign(position=1.3 * data["position"])
    for axes in (panel for row in rows_of(draw_bending(Run(stretched))).values() for panel in row):
        assert axes.get_xlim() == (0.0, 0.5)


def test_angles_between_directions_are_exact_where_they_are_small():
    angle = np.array([0.0, 1e-9, 0.3, np.pi / 2, np.pi])
    one = np.tile([1.0, 0.0, 0.0], (5, 1))
    other = np.column_stack([np.cos(angle), 0.6 * np.sin(angle), 0.8 * np.sin(angle)])
    np.testing.assert_allclose(angle_between(one, other), angle, rtol=1e-12, atol=1e-15)
