"""The page of a run: what it holds, how large it is, and that text stays text."""

import base64
import json
import re
import zlib
from html import escape
from html.parser import HTMLParser

import numpy as np
import pytest

from crinoid.report import ReportError, write_page
from crinoid.report.charts.chart import Trace
from crinoid.report.charts.space import base_directions, evenly, space_of
from crinoid.report.page.pack import Pack
from crinoid.report.page.plots import RECORDS, kept
from crinoid.report.page.scene import scene_of, shown
from crinoid.report.page.write import page_of
from crinoid.report.run import Run
from spatial_arm import among_obstacles, curling_arm
from test_report import save, swaying_arm


def unpacked(text, said):
    """Take numbers apart as `unpack.js` does."""
    raw = np.frombuffer(zlib.decompress(base64.b64decode(text)), np.uint8)
    count, wide = said["count"], said["wide"]
    planes = raw[said["at"] : said["at"] + count * wide].reshape(wide, count)
    changes = np.ascontiguousarray(planes.T).view(f"<u{wide}").reshape(-1, said["row"])
    return said["low"] + said["step"] * np.cumsum(changes, axis=0, dtype=changes.dtype)


class Tags(HTMLParser):
    """Tags of a page with their attributes, and what stands in those of some names."""

    def __init__(self, text):
        super().__init__()
        self.tags, self.inside, self.texts = [], [], {}
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        self.inside.append(dict(attrs).get("id") or tag)

    def handle_endtag(self, tag):
        if self.inside:
            self.inside.pop()

    def handle_data(self, data):
        where = self.inside[-1] if self.inside else ""
        self.texts[where] = self.texts.get(where, "") + data


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
    table, numbers, left_out = scene_of(shown([("", data)]))
    (member,) = table["members"]
    assert member["nodes"] == data.sizes["node"]
    assert not left_out
    root = unpacked(numbers, member["root"])
    offset = unpacked(numbers, member["offset"]).reshape(61, -1, 3)
    step = member["root"]["step"] + member["offset"]["step"]
    np.testing.assert_allclose(root[:, None] + offset, data["position"].values, atol=step)
    kappa = np.linalg.norm(data["curvature"].values, axis=-1)
    shade = unpacked(numbers, member["fields"]["curvature"])
    np.testing.assert_allclose(shade, kappa, atol=member["fields"]["curvature"]["step"])
    np.testing.assert_allclose(
        unpacked(numbers, member["ahead"]), base_directions(data, range(61)), atol=1e-4
    )
    kinds = [body["kind"] for body in member["bodies"]]
    assert kinds == ["sphere", "cylinder", "capsule", "plane"]


WALL = """
[[obstacle]]
kind = "plane"
position = [0.0, 0.0, -10.05]
normal = [0.0, 0.0, 2.0]
"""


def test_the_arms_distance_from_a_plane_is_its_height():
    data = among_obstacles(records=3, nodes=5, obstacles=WALL)
    (moving,) = space_of([("", data)], 10, 10).members
    (field,) = (each for each in moving.fields if each.name == "distance")
    height = data["position"].values[..., 2] + 10.05 - data["diameter"].values / 2
    np.testing.assert_allclose(field.values, np.clip(height, 0.0, 0.25 * 0.5), atol=1e-12)


def test_a_trace_of_many_values_keeps_its_extremes_and_stays_small():
    rng = np.random.default_rng(1)
    time, values, other = np.arange(1_000_000.0), rng.normal(size=1_000_000), np.zeros(1_000_000)
    values[123_457], other[765_432] = 40.0, -3.0
    traces = tuple(Trace("", time, each, "ink") for each in (values, other))
    chosen = kept(traces[0], traces)
    assert chosen.size <= RECORDS + 2
    assert {0, 123_457, 765_432, 999_999} <= set(chosen.tolist())
    assert values[chosen].min() == values.min()
    np.testing.assert_array_equal(kept(traces[0], traces), kept(traces[1], traces))


def test_instants_are_chosen_evenly_with_the_first_and_the_last():
    assert evenly(5, 10).tolist() == [0, 1, 2, 3, 4]
    chosen = evenly(100_003, 1501)
    assert chosen.size == 1501
    assert chosen[[0, -1]].tolist() == [0, 100_002]
    assert np.ptp(np.diff(chosen)) <= 1


def test_half_a_minute_in_space_at_50_instants_a_second_is_below_3_megabytes():
    rng, time, runs = np.random.default_rng(0), np.linspace(0.0, 30.0, 1501), []
    for driven in (True, False):
        made = curling_arm(records=31, duration=30.0, nodes=101, driven=driven).interp(time=time)
        shaken = made["position"] + 2e-4 * rng.normal(size=made["position"].shape)
        runs.append(made.assign(position=shaken))
    text = page_of(Run(*runs))
    assert len(text.encode()) < 3e6
    assert re.search(r"shows \d+ of 1501 saved instants", text)


def test_a_million_instants_are_thinned_and_the_page_says_so():
    made = swaying_arm(records=1000, nodes=3).isel(time=np.arange(1_000_000) // 1000)
    text = page_of(Run(made.assign_coords(time=np.linspace(0.0, 1e4, 1_000_000))))
    assert len(text.encode()) < 3e6
    assert "shows 1501 of 1000000 saved instants" in text
    assert f"at most {RECORDS} of 1000000 saved instants" in text


HOSTILE = "</script><img src=x onerror=alert(1)>&amp;\"'$title ${style}<!--"


def test_a_run_that_ends_in_nan_has_a_page_up_to_there(tmp_path):
    broken = swaying_arm(status="diverged at 18 s")
    for name in ("position", "tip_position", "tip_error", "energy", "base_force"):
        broken[name][180:] = np.nan
    save(broken, tmp_path / "result.nc")
    text = write_page(tmp_path).read_text("utf-8")
    assert "planar arm · 21 nodes · 17.9 s" in text
    assert '<p class="status">diverged at 18 s</p>' in text
    told = "21 saved instants are left out: at these the arm has no shape to draw."
    assert f"<li>{escape(told)}</li>" in text


def test_an_arm_that_flies_far_is_packed_more_coarsely():
    data = swaying_arm(records=5)
    data["position"][4, -1, 0] = 1e8
    table, packed, _ = scene_of(space_of([("", data)], 100, 50))
    offset = unpacked(packed, table["members"][0]["offset"]).reshape(5, -1, 2)
    np.testing.assert_allclose(offset[4, -1, 0], 1e8 - data["position"][4, 0, 0], rtol=1e-6)


@pytest.mark.parametrize("name", ["base_servo", "flow_velocity", "tip_target"])
def test_instants_that_lack_a_number_are_left_out_of_the_animation_and_told(name):
    broken = swaying_arm(records=40)
    if name == "base_servo":
        broken = broken.assign(base_servo=broken["base_pose"].copy())
    broken[name][[3, 20, 21]] = np.nan
    space = space_of([("", broken)], 100, 50)
    (moving,) = space.members
    np.testing.assert_array_equal(moving.time, np.delete(broken["time"], [3, 20, 21]))
    table, _, left_out = scene_of(space)
    assert len(table["members"][0]["time"]) == 37
    assert left_out == ["3 instants are left out: at these a number is not finite, or too large."]
    broken[name][:] = np.nan
    with pytest.raises(ReportError, match="no instant can be drawn"):
        space_of([("", broken)], 100, 50)


def test_a_result_without_positions_has_no_page(tmp_path):
    save(swaying_arm(records=5).drop_vars("position"), tmp_path / "result.nc")
    with pytest.raises(ReportError, match=r"left out position, which all figures need$"):
        write_page(tmp_path)
    assert not (tmp_path / "report.html").exists()


def test_a_floating_submarine_carries_its_mount_and_a_servo_moves_the_root_from_it():
    data = swaying_arm(records=5)
    pan = 0.0 * data["base_pose"]
    pan[:, 2] = np.linspace(0.0, 0.5, 5)  # the vehicle pitches
    data = data.assign(base_servo=data["base_pose"], vehicle_pose=pan)
    (moving,) = space_of([("", data)], 10, 50).members
    slide = data["base_servo"].values[:, 0]
    ahead = np.stack([np.cos(pan[:, 2]), 0.0 * slide, np.sin(pan[:, 2])], axis=1)
    root = moving.mount.anchor + slide[:, None] * ahead
    np.testing.assert_allclose(root, moving.position[:, 0], atol=1e-12)
    tilt = data["base_pose"].values[:, 2] + pan[:, 2].values
    np.testing.assert_allclose(moving.mount.ahead[:, 2], np.sin(tilt), atol=1e-12)


def test_what_a_user_writes_stays_text():
    data = swaying_arm(records=5, status=f"stopped at 1 s: {HOSTILE}").assign_attrs(
        title=HOSTILE, notes=f"{HOSTILE}\nanother", scenario=f"# {HOSTILE}\n[base]\ntilt_deg = 0.0"
    )
    text = page_of(Run(data))
    page, plain = Tags(text), Tags(page_of(Run(swaying_arm(records=5, status="stopped at 1 s: x"))))
    assert not [tag for tag, _ in page.tags if tag == "img"]
    scripts = [attributes for tag, attributes in page.tags if tag == "script"]
    assert scripts == [attributes for tag, attributes in plain.tags if tag == "script"]
    assert page.texts["h1"].strip() == HOSTILE
    assert HOSTILE in page.texts["toml"]
    assert page.texts["title"].startswith(HOSTILE)


def test_scripts_run_by_their_digest_only_and_nothing_is_loaded():
    text = page_of(Run(swaying_arm(records=5)))
    page = Tags(text)
    (policy,) = (
        attributes["content"]
        for tag, attributes in page.tags
        if attributes.get("http-equiv") == "Content-Security-Policy"
    )
    assert "default-src 'none'" in policy
    assert re.search(r"script-src 'sha256-\S+' 'sha256-\S+';", policy)
    assert not [a for tag, a in page.tags if tag != "svg" and {"src", "href"} & set(a)]


def test_the_page_tells_numbers_notes_and_how_to_repeat_it():
    data = swaying_arm(records=5).assign_attrs(notes="the first\nthe second", seed=7)
    text = page_of(Run(data))
    assert "<li>the first</li><li>the second</li>" in text
    assert "<td>seed</td><td>7</td>" in text
    assert "crinoid run station-keeping-in-a-turbulent-current.toml" in text
    rms = float(np.sqrt(np.mean(data["tip_error"].values ** 2)))
    assert f"<td>tip error, RMS</td><td>{1e3 * rms:.3g} mm</td>" in text
    few = data[["position", "tip_position", "tip_target", "tip_error"]]
    assert "holds too little to sum it up" in page_of(Run(few))


def panels_of(run):
    """Return what a page says of its panels, by the names of their charts."""
    text = page_of(run)
    begun = text.index('id="table">') + len('id="table">')
    table = json.loads(text[begun : text.index("</script>", begun)])
    return {chart["name"]: chart["panels"] for chart in table["charts"]}


def test_charts_tell_apart_names_and_units():
    charts = panels_of(Run(among_obstacles(records=20), curling_arm(records=20, driven=False)))
    assert list(charts) == ["tip_error", "spectrum", "commands", "contact", "energy", "effort"]
    error = charts["tip_error"][0]
    assert (error["label"], error["unit"]) == ("tip error", "mm")
    assert [trace["name"] for trace in error["traces"]] == ["with control", "without control"]
    assert [row["name"][:1] for row in charts["contact"][0]["rows"]] == ["0", "1", "2", "3"]


def test_each_of_many_actuators_has_its_name():
    names = [f"chamber_{i}" for i in range(7)]
    drive = (("time", "input"), np.linspace(0.0, 1.0, 35).reshape(5, 7))
    data = swaying_arm(records=5).assign_coords(input=names, input_unit=("input", ["1"] * 7))
    data = data.assign(actuator_state=drive, actuator_command=drive)
    panels = {panel["name"]: panel for panel in panels_of(Run(data))["commands"]}
    told = [trace["name"] for trace in panels["actuators_0"]["traces"]]
    assert [name for name in told if "command" not in name] == names
