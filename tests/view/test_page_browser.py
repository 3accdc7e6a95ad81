"""The page of a run in a browser: it plays, it can be turned, and it tells what the result has."""

import csv
from pathlib import Path

import numpy as np
import pytest

from crinoid.results.result import Result
from crinoid.view.page.study import write_study
from crinoid.view.page.write import write_run
from helpers.browsing import Opened
from helpers.made_results import of_runs
from helpers.pages import HOSTILE
from helpers.planar_result import swaying_arm
from helpers.spatial_result import among_obstacles, among_solids, curling_arm
from helpers.studies import COLUMNS, grid, save, study_of_rows, study_row

pytestmark = pytest.mark.slow


class Shown(Opened):
    """The page of a result or a study."""

    def __init__(self, browser, path, wide=1200, high=800, **more):
        ready, calm = "html[data-ready=yes]", {"reduced_motion": "reduce"}
        super().__init__(browser, path.as_uri(), ready, wide, high, **calm, **more)

    def picture(self):
        """Return what the canvas shows."""
        return self.ask(
            "() => { crinoid.show(true); return document.getElementById('scene').toDataURL(); }"
        )

    def told(self, panel):
        """Return the numbers next to a chart, in its unit."""
        texts = self.ask(
            """(name) => crinoid.charts.panels.find((p) => p.said.name === name)
            .entries.map((entry) => entry.told.textContent)""",
            panel,
        )
        return [float(text.replace("\N{MINUS SIGN}", "-")) for text in texts]


@pytest.fixture(scope="module")
def spatial(tmp_path_factory):
    run = of_runs(among_obstacles(records=121), curling_arm(records=121, driven=False))
    return run, write_run(run, tmp_path_factory.mktemp("spatial") / "report.html")


@pytest.fixture(scope="module")
def shown(browser, spatial):
    with Shown(browser, spatial[1]) as opened:
        yield opened


def test_a_page_opens_without_a_complaint_and_asks_for_nothing(shown, spatial):
    assert shown.complaints == []
    assert shown.requests == [spatial[1].as_uri()]
    assert shown.ask("() => document.querySelector('.stage').classList.contains('drawn')")


def test_all_nodes_are_drawn_where_the_result_has_them(shown, spatial):
    result = spatial[0].dataset
    assert shown.ask("() => crinoid.scene.members.map((each) => each.points.length)") == [93, 93]
    for record in (0, 50, 120):
        shown.ask("(time) => crinoid.go(time)", float(result["time"][record]))
        points = shown.ask("() => [...crinoid.scene.members[0].points]")
        found = np.reshape(points, (-1, 3))
        np.testing.assert_allclose(found, result["position"].values[record], atol=1e-4)


def test_numbers_under_the_cursor_are_those_of_the_result(shown, spatial):
    result, other = spatial[0].dataset, spatial[0].uncontrolled.dataset
    for record in (0, 37, 120):
        shown.ask("(time) => crinoid.go(time)", float(result["time"][record]))
        errors = [1e3 * float(data["tip_error"][record]) for data in (result, other)]
        np.testing.assert_allclose(shown.told("tip_error"), errors, rtol=1e-3, atol=1e-4)
        force = result["base_force"].values[record]
        np.testing.assert_allclose(shown.told("base_force"), force, rtol=1e-3, atol=1e-6)
    clock = shown.page.text_content("#clock")
    assert clock == f"{float(result['time'][120]):.2f} s"


def test_a_chart_that_is_dragged_moves_the_animation(shown):
    plot = shown.page.locator(".plot").first
    plot.scroll_into_view_if_needed()
    box = plot.bounding_box()
    left, right = box["x"] + 58, box["x"] + box["width"] - 10
    for share in (0.25, 0.6):
        shown.page.mouse.move(left, box["y"] + 40)
        shown.page.mouse.down()
        shown.page.mouse.move(left + share * (right - left), box["y"] + 40)
        shown.page.mouse.up()
        assert shown.ask("() => crinoid.time") == pytest.approx(share * 12.0, abs=0.1)
    cursor = shown.page.locator(".cursor").first.bounding_box()
    assert cursor["x"] == pytest.approx(left + 0.6 * (right - left), abs=2.0)


def test_it_plays_pauses_and_steps(shown):
    shown.ask("() => crinoid.go(1)")
    shown.page.click("#play")
    shown.page.wait_for_function("() => crinoid.time > 1.2", timeout=30_000)
    shown.page.click("#play")
    stopped = shown.ask("() => crinoid.time")
    shown.page.wait_for_timeout(200)
    assert shown.ask("() => crinoid.time") == stopped
    shown.ask("() => crinoid.go(1)")
    shown.page.focus("#scene")
    shown.page.keyboard.press("ArrowRight")
    assert shown.ask("() => crinoid.time") == pytest.approx(1.1, abs=1e-6)
    shown.page.keyboard.press("ArrowLeft")
    assert shown.ask("() => crinoid.time") == pytest.approx(1.0, abs=1e-6)
    shown.page.keyboard.press("End")
    assert shown.ask("() => crinoid.time") == 12.0


def test_scrubbing_turning_and_colours_change_the_picture(shown):
    shown.ask("() => crinoid.go(2)")
    pictures = [shown.picture()]
    shown.ask("() => crinoid.go(9)")
    pictures.append(shown.picture())
    box = shown.page.locator("#scene").bounding_box()
    middle = (box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    before = shown.ask("() => crinoid.scene.camera.yaw")
    shown.page.mouse.move(*middle)
    shown.page.mouse.down()
    shown.page.mouse.move(middle[0] + 80, middle[1] + 20)
    shown.page.mouse.up()
    assert shown.ask("() => crinoid.scene.camera.yaw") == pytest.approx(before - 32.0)
    pictures.append(shown.picture())
    for name in ("Side", "Above", "Ahead"):
        shown.page.click(f"text={name}")
        pictures.append(shown.picture())
    for label, option in [("Colour", "tension"), ("Without control", "beside"), ("Follow", "tip")]:
        shown.page.select_option(f"label.pick:has-text('{label}') select", option)
        pictures.append(shown.picture())
    assert len(set(pictures)) == len(pictures) - 1  # what is followed is there already
    assert shown.ask("() => crinoid.scene.drawn.parts") == 2
    assert shown.complaints == []


def test_folded_charts_are_laid_out_when_they_open_and_charts_are_saved(shown, spatial):
    folded = shown.page.locator("details.chart").first
    assert folded.locator(".plot").first.is_hidden()
    shown.page.set_viewport_size({"width": 900, "height": 800})
    folded.locator("summary").click()
    shown.page.wait_for_function(
        """() => crinoid.charts.panels.filter(({ said }) => said.name.startsWith("energy"))
        .every(({ view, plot }) => view.bbox.width === plot.clientWidth)""",
        timeout=10_000,
    )
    shown.page.set_viewport_size({"width": 1200, "height": 800})
    saved = {}
    for kind in ("CSV", "PNG"):
        with shown.page.expect_download() as download:
            shown.page.locator(f".panel button:text('{kind}')").first.click()
        assert download.value.suggested_filename == f"tip_error.{kind.lower()}"
        saved[kind] = Path(download.value.path()).read_bytes()
    assert saved["PNG"].startswith(b"\x89PNG")
    head, *rows = csv.reader(saved["CSV"].decode().splitlines())
    assert head == ["time (s)", "with control (mm)", "without control (mm)"]
    found, data = np.array(rows, float), spatial[0].dataset
    np.testing.assert_allclose(found[:, 1], 1e3 * data["tip_error"].values, rtol=1e-5, atol=1e-7)
    assert shown.complaints == []


def test_the_submarine_is_whole_in_the_frame_of_all(browser, tmp_path):
    path = write_run(Result(among_solids(records=5)), tmp_path / "report.html")
    with Shown(browser, path) as opened:
        half = {}
        for framed in ("arm", "all"):
            opened.page.select_option("label.pick:has-text('Frame') select", framed)
            opened.ask("() => crinoid.preset('side')")
            half[framed], hulls, centre, across, aspect = opened.ask(
                """() => { const { camera, hulls } = crinoid.scene;
                const { half, centre, axes } = camera;
                return [half, hulls, centre, axes.across, crinoid.aspect()]; }"""
            )
            away = np.abs((np.array(hulls) - centre) @ across)
            assert (away.max() < half[framed] * aspect) == (framed == "all")
        assert half["all"] > half["arm"]
        assert opened.complaints == []


def test_arrows_of_the_water_have_a_scale_of_their_speed(shown, spatial):
    shown.ask("() => crinoid.overlay()")
    speed = float(shown.page.text_content("#speeds span").split()[1])
    scale, pixels = shown.ask(
        """() => [crinoid.scene.water.scale,
        crinoid.scene.canvas.clientHeight / (2 * crinoid.scene.camera.half)]"""
    )
    wide = shown.page.locator("#speeds i").bounding_box()["width"]
    assert wide == pytest.approx(speed / scale * pixels, abs=1.0)


def test_a_base_that_travels_far_is_followed(browser, tmp_path):
    data = swaying_arm()
    for name in ("position", "tip_position", "tip_target"):
        data[name] = data[name] + data["time"] * (data["axis"] == "x") * 0.5
        data[name] = data[name].transpose("time", ..., "axis")
    with Shown(browser, write_run(Result(data), tmp_path / "report.html")) as opened:
        assert opened.ask("() => crinoid.scene.follow") == "root"
        away = "() => crinoid.scene.camera.centre[0] - crinoid.scene.members[0].now.root[0]"
        before, half = opened.ask(away), opened.ask("() => crinoid.scene.camera.half")
        assert half < 1.0  # m: all of the way is 10 m
        opened.ask("() => crinoid.go(19)")
        assert opened.ask(away) == pytest.approx(before, abs=1e-3)
        assert opened.complaints == []


def test_one_instant_does_not_play_and_a_hostile_title_does_nothing(browser, tmp_path):
    data = swaying_arm(records=1, duration=0.0).assign_attrs(title=HOSTILE, notes=HOSTILE)
    with Shown(browser, write_run(Result(data), tmp_path / "report.html")) as opened:
        assert opened.page.is_disabled("#play")
        assert opened.page.title() == HOSTILE
        assert opened.page.text_content("h1") == HOSTILE
        assert opened.page.locator("img").count() == 0
        assert (opened.complaints, len(opened.requests)) == ([], 1)


WITHOUT_WEBGL = """const canvas = HTMLCanvasElement.prototype, get = canvas.getContext;
canvas.getContext = function (kind, ...rest) {
  return kind === 'webgl2' ? null : get.call(this, kind, ...rest);
};"""


def test_without_webgl_the_page_has_a_picture_and_charts(browser, tmp_path):
    path = write_run(Result(swaying_arm(records=41)), tmp_path / "report.html")
    with Shown(browser, path, script=WITHOUT_WEBGL) as opened:
        page = opened.page
        assert page.is_visible(".still svg polyline >> nth=0")
        assert not page.is_visible("#scene")
        assert "cannot draw the animation" in page.text_content("#trouble")
        page.evaluate("() => crinoid.go(5)")
        assert page.text_content(".entry b") not in ("", "\N{EN DASH}")


def test_a_notebook_s_animation_moves_within_its_frame(browser, tmp_path):
    data = among_obstacles(records=21, duration=4.0, nodes=9).assign_attrs(title=HOSTILE)
    path = tmp_path / "cell.html"
    path.write_text(f"<meta charset=utf-8>{Result(data)._repr_html_()}", encoding="utf-8")
    with Opened(browser, path.as_uri(), "iframe", reduced_motion="reduce") as opened:
        (frame,) = opened.page.frames[1:]
        frame.wait_for_selector("html[data-ready=yes]", timeout=60_000)
        frame.evaluate("() => crinoid.play(false)")  # a frame hears late that motion is to be less
        picture = "document.getElementById('scene').toDataURL()"
        images = [frame.evaluate(f"() => {{ crinoid.go({t}); return {picture}; }}") for t in (0, 3)]
        assert images[0] != images[1]
        assert frame.text_content("#clock") == "3.000 s"
        assert opened.complaints == []


def test_a_study_sorts_names_the_case_under_the_cursor_and_opens_it(browser, tmp_path):
    cases = grid(tmp_path)
    save(swaying_arm(records=5), tmp_path / "case-05" / "result.nc")
    write_run(Result(swaying_arm(records=5)), tmp_path / "case-05" / "report.html")
    path = write_study(cases, tmp_path, tmp_path)
    with Shown(browser, path) as opened:
        page, names = opened.page, "[...document.querySelectorAll('tbody td:first-child')]"
        shown = f"() => {names}.map((each) => each.textContent)"
        assert opened.ask(shown) == [f"case-0{n}" for n in range(1, 7)]
        page.click("th:has-text('settling') button")
        page.click("th:has-text('settling') button")
        assert opened.ask(shown) == [f"case-0{n}" for n in range(6, 0, -1)]
        assert page.get_attribute("th:has-text('settling')", "aria-sort") == "descending"
        left, top = opened.ask("() => crinoid.where(4)")
        plot = page.locator("#plot").bounding_box()
        page.mouse.move(plot["x"] + left, plot["y"] + top)
        assert page.text_content("#said").startswith("case-05 · youngs_modulus 400000")
        assert opened.ask("() => document.querySelector('tr.on').dataset.case") == "4"
        assert "Largest: case-06 · youngs_modulus 400000" in page.text_content("#extremes")
        page.select_option("#measure", label="settling time")
        page.select_option("#over", label="kind")
        page.wait_for_function("crinoid.view.kind === 'lines'")
        low, high = opened.ask("() => [crinoid.where(0)[1], crinoid.where(4)[1]]")
        assert high < low  # 3 s is drawn below 7 s
        assert not opened.complaints
        assert opened.requests == [path.as_uri()]
        page.mouse.click(plot["x"] + opened.ask("() => crinoid.where(4)[0]"), plot["y"] + high)
        page.wait_for_url("**/case-05/report.html")


def test_means_a_rounding_beyond_all_values_have_the_colour_of_the_end(browser, tmp_path):
    # the page has eight digits of a value: below the mean of the equal ones, and above that of two
    values = [0.148912345678, 0.177634567894, 0.177634567894, 0.269987654324]
    levels = [1e5, 2e5, 2e5, 3e5]
    rows = [
        study_row(number, **{"arm.youngs_modulus": level, "rms_error": value})
        for number, (level, value) in enumerate(zip(levels, values, strict=True), start=1)
    ]
    path = write_study(study_of_rows(tmp_path, rows), tmp_path, tmp_path)
    with Shown(browser, path) as opened:
        assert opened.page.locator("tbody tr").count() == 4
        assert opened.complaints == []


def test_a_study_without_measures_names_its_cases(browser, tmp_path):
    rows = [
        study_row(number, status="failed at t = 0 s", **dict.fromkeys(COLUMNS, ""))
        for number in (1, 2)
    ]
    path = write_study(study_of_rows(tmp_path, rows), tmp_path, tmp_path)
    with Shown(browser, path) as opened:
        opened.page.hover("tbody tr >> nth=1")
        assert opened.page.text_content("#said").startswith("case-02")
        assert opened.complaints == []


def test_a_cell_of_several_cases_leaves_only_these_in_the_table(browser, tmp_path):
    keys = ("arm.youngs_modulus", "flow.0.velocity", "seed")
    levels = [dict(zip(keys, (1e5 * (n % 2), n % 3, n % 4), strict=True)) for n in range(1, 13)]
    rows = [study_row(number, **values) for number, values in enumerate(levels, start=1)]
    path = write_study(study_of_rows(tmp_path, rows), tmp_path, tmp_path)
    with Shown(browser, path, color_scheme="dark") as opened:
        at = opened.ask("() => crinoid.where(3)")
        plot = opened.page.locator("#plot").bounding_box()
        opened.page.mouse.click(plot["x"] + at[0], plot["y"] + at[1])
        found = "[...document.querySelectorAll('tbody tr')].map((e) => +e.dataset.case)"
        assert opened.ask(f"() => {found}") == [3, 9]  # 4 % 2, 4 % 3
        assert opened.page.text_content("#only span").startswith("2 cases · youngs_modulus 0")
        opened.page.click("#only button")
        assert opened.page.locator("tbody tr").count() == 12
        assert not opened.complaints
