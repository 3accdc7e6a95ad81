"""The page of a run: what it holds, how large it is, and that text stays text."""

import json
import re
from html import escape

import numpy as np
import pytest
from bokeh.document import Document

from crinoid.results.drives import actuator_drives
from crinoid.results.reading import with_shapes
from crinoid.results.report_error import ReportError
from crinoid.results.result import Result
from crinoid.results.scene.mount import find_mount
from crinoid.results.scene.scene import build_scene
from crinoid.scenario.library import load
from crinoid.view.figures.charts.chart import Trace
from crinoid.view.figures.charts.drive import drive_chart
from crinoid.view.figures.charts.of_run import charts_of
from crinoid.view.page.parts import Pack
from crinoid.view.page.plots import RECORDS, extreme_instants, plots_of
from crinoid.view.page.repeat import repeat_command
from crinoid.view.page.scene import page_scene, scene_of, still_of
from crinoid.view.page.write import page_of
from helpers.figures import assert_report
from helpers.made_results import of_runs
from helpers.pages import HOSTILE, Tags, positions, unpacked
from helpers.planar_result import swaying_arm, with_threads
from helpers.spatial_result import among_obstacles, among_solids, curling_arm
from helpers.studies import save


@pytest.mark.parametrize("rows", [1, 7, 400])
def test_packed_numbers_come_back_to_half_a_step(rows):
    rng = np.random.default_rng(0)
    some = np.cumsum(rng.normal(0.0, 0.3, (rows, 5)), axis=0)
    few, wild = rng.uniform(-1.0, 1.0, (rows, 3)), 1e3 * rng.normal(size=(rows, 2))
    pack = Pack()
    said = [pack.add(some, 1e-3), pack.add(few, 0.01), pack.add(wild, 1e-3)]
    assert [each["wide"] for each in said][1:] == [1, 4 if rows > 1 else said[2]["wide"]]
    for each, values in zip(said, (some, few, wild), strict=True):
        found = unpacked(pack.text(), each)
        np.testing.assert_allclose(found, values, atol=0.5001 * each["step"])


def test_the_scene_holds_the_arm_where_the_result_has_it():
    data = among_obstacles(records=61)
    table, numbers, left_out = scene_of(page_scene(Result(data)))
    (member,) = table["members"]
    assert member["nodes"] == data.sizes["node"]
    assert not left_out
    found, step = positions(numbers, member, 61)
    np.testing.assert_allclose(found, data["position"].values, atol=step)
    kappa = np.linalg.norm(data["curvature"].values, axis=-1)
    shade = unpacked(numbers, member["fields"]["curvature"])
    np.testing.assert_allclose(shade, kappa, atol=member["fields"]["curvature"]["step"])
    ahead = unpacked(numbers, member["ahead"])
    np.testing.assert_allclose(ahead, find_mount(Result(data)).direction, atol=1e-4)
    kinds = [body["kind"] for body in member["bodies"]]
    assert kinds == ["sphere", "cylinder", "capsule", "plane"]


def test_the_scene_holds_solids_a_capsule_that_turns_and_a_hull():
    data = among_solids(records=5)
    table, numbers, _ = scene_of(page_scene(Result(data)))
    (member,) = table["members"]
    _, bed, capsule = member["bodies"]
    points, facets = (data[name].values for name in ("surface_point", "surface_facet"))
    found = unpacked(numbers, bed["points"])
    np.testing.assert_allclose(found, points[6:], atol=bed["points"]["step"])
    own = facets[data["facet_obstacle"].values == 1] - 6
    np.testing.assert_array_equal(unpacked(numbers, bed["facets"]), own)
    half = unpacked(numbers, capsule["half"])
    axis = data["obstacle_axis"].values[:, 2]
    np.testing.assert_allclose(half, 0.1 * axis, atol=capsule["half"]["step"])
    assert member["capsule"] == "held"
    assert member["sizes"]["hull"] == pytest.approx([0.22, 0.08])


def test_the_arms_distance_from_a_plane_is_its_height():
    wall = 'obstacle = [{kind="plane", position=[0.0, 0.0, -10.05], normal=[0.0, 0.0, 2.0]}]\n'
    data = among_obstacles(records=3, nodes=5, obstacles=wall)
    (moving,) = build_scene(Result(data), 10, 10).members
    (field,) = (each for each in moving.fields if each.name == "distance")
    height = data["position"].values[..., 2] + 10.05 - data["diameter"].values / 2
    np.testing.assert_allclose(field.values, np.clip(height, 0.0, 0.25 * 0.5), atol=1e-12)


def test_a_trace_of_many_values_keeps_its_extremes_and_stays_small():
    rng = np.random.default_rng(1)
    time, values, other = np.arange(1_000_000.0), rng.normal(size=1_000_000), np.zeros(1_000_000)
    values[123_457], other[765_432] = 40.0, -3.0
    traces = tuple(Trace("", time, each, "ink") for each in (values, other))
    chosen = extreme_instants(traces[0], traces)
    assert chosen.size <= RECORDS + 2
    assert {0, 123_457, 765_432, 999_999} <= set(chosen.tolist())
    assert values[chosen].min() == values.min()
    np.testing.assert_array_equal(chosen, extreme_instants(traces[1], traces))


def test_half_a_minute_in_space_at_50_instants_a_second_is_below_3_megabytes():
    rng, time, runs = np.random.default_rng(0), np.linspace(0.0, 30.0, 1501), []
    for driven in (True, False):
        made = curling_arm(records=31, duration=30.0, nodes=101, driven=driven).interp(time=time)
        made["position"] += 2e-4 * rng.normal(size=made["position"].shape)
        runs.append(made)
    text = page_of(of_runs(*runs))
    assert len(text.encode()) < 3e6
    assert re.search(r"shows \d+ of 1501 saved instants", text)


@pytest.mark.usefixtures("coarse")
def test_a_run_that_ends_in_nan_has_figures_and_a_page_up_to_there(tmp_path):
    broken = swaying_arm(status="diverged at 18 s")
    for name in ("position", "tip_position", "tip_error", "energy", "base_force"):
        broken[name][180:] = np.nan
    save(broken, tmp_path / "result.nc")
    text = assert_report(tmp_path)[-1].read_text("utf-8")
    assert "planar arm · 21 nodes · 17.9 s" in text
    assert '<p class="status">diverged at 18 s</p>' in text
    note = "21 saved instants are left out: at these the arm has no shape to draw."
    assert f"<li>{escape(note)}</li>" in text


UNFIT = [("base_servo", np.nan), ("flow_velocity", np.nan), ("tip_target", np.nan)]
UNFIT += [("position", 1e40), ("position", 1e200), ("position", 0.0)]  # no edge points anywhere


@pytest.mark.parametrize(("name", "value"), UNFIT)
def test_the_animation_leaves_out_instants_that_lack_a_number(name, value):
    broken = swaying_arm(records=40)
    broken[name][[3, 20, 21]] = value
    space = build_scene(Result(broken), 100, 50)
    (moving,) = space.members
    np.testing.assert_array_equal(moving.time, np.delete(broken["time"], [3, 20, 21]))
    table, _, left_out = scene_of(space)
    assert len(table["members"][0]["time"]) == 37
    assert left_out == ["3 instants are left out: at these a number is not finite, or too large."]
    assert with_shapes(Result(broken), "made").dataset.sizes["time"] == (
        37 if name == "position" else 40
    )
    broken[name][:] = value
    with pytest.raises(ReportError, match="no instant can be drawn"):
        build_scene(Result(broken), 100, 50)


@pytest.fixture(scope="module")
def plain():
    """Text and tags of a small page."""
    data = swaying_arm(records=5, status="stopped at 1 s: x", seed=7)
    text = page_of(Result(data.assign_attrs(notes="the first\nthe second")))
    return text, Tags(text)


def test_a_user_s_words_stay_text(plain):
    data = swaying_arm(records=5, status=f"stopped at 1 s: {HOSTILE}").assign_attrs(
        title=HOSTILE, notes=f"{HOSTILE}\nanother", scenario=f"# {HOSTILE}\n[base]\ntilt_deg = 0.0"
    )
    page = Tags(page_of(Result(data)))
    assert not page.attributes("img")
    assert page.attributes("script") == plain[1].attributes("script")
    assert page.texts["h1"].strip() == HOSTILE
    assert HOSTILE in page.texts["toml"]
    assert page.texts["title"].startswith(HOSTILE)


def test_scripts_run_by_their_digest_only_and_the_page_loads_nothing(plain):
    tags, about = plain[1].tags, plain[1].attributes("meta")
    (policy,) = (a["content"] for a in about if a.get("http-equiv") == "Content-Security-Policy")
    assert "default-src 'none'" in policy
    assert re.search(r"script-src 'sha256-\S+' 'sha256-\S+';", policy)
    assert not [a for tag, a in tags if tag != "svg" and {"src", "href"} & set(a)]


def test_the_page_shows_numbers_notes_and_how_to_repeat_the_run(plain):
    text, data = plain[0], swaying_arm(records=5, seed=7)
    assert "<li>the first</li><li>the second</li>" in text
    assert "<td>seed</td><td>7</td>" in text
    assert "save the scenario above as scenario.toml, then <code>crinoid run scenario.toml" in text
    rms = float(np.sqrt(np.mean(data["tip_error"].values ** 2)))
    assert f"<td>tip displacement, RMS</td><td>{1e3 * rms:.3g} mm</td>" in text


def test_numbers_and_notes_come_first_and_energy_and_solver_are_folded(plain):
    page = plain[0]
    order = [
        page.index(each)
        for each in ("<h2>Numbers", ">All numbers<", "<h2>Notes", 'id="charts"', ">Scenario<")
    ]
    assert order == sorted(order)
    charts = json.loads(plain[1].texts["table"])["charts"]
    assert [each["name"] for each in charts if each["folded"]] == ["energy", "effort"]
    repeated = swaying_arm(records=5).assign_attrs(notes="once\nonce")
    assert page_of(Result(repeated)).count("<li>once</li>") == 1


def test_a_run_of_a_built_in_scenario_is_repeated_by_its_name():
    scenario = load("still-water", ["arm.length=0.6", "control.start=2"])
    data = swaying_arm(records=5).assign_attrs(scenario=scenario.to_toml())
    line = repeat_command(Result(data))
    assert line == "crinoid run still-water --set arm.length=0.6 --set control.start=2.0"


def test_an_arm_at_rest_has_zeros_on_a_readable_axis():
    data = swaying_arm(records=50, duration=5.0)
    data["tip_position"] = data["tip_target"] + 1e-11 * np.sin(data["time"])
    data["tip_error"] = 1e-11 * abs(np.sin(data["time"]))
    run = Result(data)
    charts = charts_of(run)
    made = plots_of(charts, 0.0, 5.0)
    panels = {each["name"]: each for chart in made.charts for each in chart["panels"]}
    assert panels["tip_spectrum"]["nothing"] == "the tip does not move"
    assert panels["tip_error"]["unit"] == "mm"
    assert panels["tip_error"]["traces"][0]["told"] == "RMS 0 mm, maximum 0 mm"
    roots = {root.id: root for root in Document.from_json(made.document).roots}
    plot = roots[panels["tip_error"]["root"]]
    assert (plot.y_range.start, plot.y_range.end) == (0.0, 1.0)
    assert not plot.select_one({"name": "trace 0"}).data_source.data["v"].any()


def test_chambers_and_tendons_are_lines_and_their_charts_are_in_physical_units():
    data = with_threads(swaying_arm(records=5))
    run = Result(data)
    drives = {each.name: each for each in actuator_drives(run)}
    assert {name: each.unit for name, each in drives.items()} == {"chamber_0": "Pa", "lower": "N"}
    np.testing.assert_allclose(drives["chamber_0"].state, 80e3 * np.linspace(0.0, 1.0, 5))
    np.testing.assert_allclose(drives["lower"].state, 0.5 + 4.0 * np.linspace(1.0, 0.0, 5))
    panels = {each.name: each for each in drive_chart(run).panels}
    units = [panels[f"actuators_{index}"].unit.name for index in (0, 1)]
    assert units == ["kPa", "N"]
    table, numbers, _ = scene_of(page_scene(run))
    chamber, tendon = table["members"][0]["threads"]
    first, offset = chamber["first"], chamber["offset"]
    assert (first, first + len(offset) - 1, chamber["largest"]) == (10, 20, "80 kPa")
    assert offset[0] == [0.01, 0.0]
    assert tendon["offset"][-1] == [-0.012, 0.0]
    np.testing.assert_allclose(
        unpacked(numbers, chamber["share"])[:, 0], np.linspace(0.0, 1.0, 5), atol=0.01
    )


def test_without_a_target_no_cross_is_drawn():
    data = swaying_arm(records=5)
    data["tip_target"] = data["tip_target"].isel(time=[0] * 5).assign_coords(time=data["time"])
    for scenario, aims in (("", False), (load("still-water").to_toml(), True)):
        scene = page_scene(Result(data.assign_attrs(scenario=scenario)))
        assert scene.aims == aims
        assert ("<circle" in still_of(scene)) == aims


def test_charts_have_names_and_units():
    run = of_runs(among_obstacles(records=20), curling_arm(records=20, driven=False))
    table = json.loads(Tags(page_of(run)).texts["table"])
    charts = {chart["name"]: chart["panels"] for chart in table["charts"]}
    assert {"tip_error", "spectrum", "commands", "loads", "contact", "energy"} < set(charts)
    error = charts["tip_error"][0]
    assert (error["label"], error["unit"]) == ("tip displacement", "mm")
    assert [trace["name"] for trace in error["traces"]] == ["with control", "without control"]
