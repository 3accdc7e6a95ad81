"""Films of runs: what they show, how long they are, and that nothing is left half-written."""

import re
import signal
import subprocess
import sys
from pathlib import Path

import av
import matplotlib as mpl
import numpy as np
import pytest
import xarray as xr
from PIL import Image, ImageSequence
from typer.testing import CliRunner, Result

from crinoid.cli.app import app
from crinoid.cli.folder import clear_figures
from crinoid.report.charts.space import space_of
from crinoid.report.film.camera import PRESETS
from crinoid.report.film.course import Course
from crinoid.report.film.file import is_film
from crinoid.report.film.panel import WATER
from crinoid.report.film.parts import CLAMP
from crinoid.report.film.picture import RAMPS, Picture
from crinoid.report.film.shot import SPEEDS, Shot, reel_of
from crinoid.report.page import parts
from crinoid.report.style import STYLE
from spatial_arm import among_obstacles, curling_arm
from test_report import save, study_row, swaying_arm, write_study

BLUE = np.array([0, 114, 178])


def call(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["film", *(str(argument) for argument in arguments)])


@pytest.fixture(scope="module")
def planar(tmp_path_factory) -> Path:
    """Return the folder of a small run in the plane, with and without control."""
    folder = tmp_path_factory.mktemp("planar")
    save(swaying_arm(records=41, duration=2.0, nodes=6), folder / "result.nc")
    save(
        swaying_arm(records=41, duration=2.0, nodes=6, driven=False, sway=0.1),
        folder / "uncontrolled.nc",
    )
    return folder


@pytest.fixture(scope="module")
def spatial(tmp_path_factory) -> Path:
    """Return the folder of a small run in space, among obstacles."""
    folder = tmp_path_factory.mktemp("spatial")
    save(among_obstacles(records=21, nodes=6), folder / "result.nc")
    return folder


def decoded(path: Path) -> np.ndarray:
    """Return the pictures of a film (frame, high, wide, colour)."""
    if path.suffix == ".gif":
        with Image.open(path) as film:
            frames = [np.array(each.convert("RGB")) for each in ImageSequence.Iterator(film)]
        return np.stack(frames)
    with av.open(path) as film:
        return np.stack([each.to_ndarray(format="rgb24") for each in film.decode(video=0)])


def pictures(data, other=None, size=(320, 240), **options) -> tuple[Picture, np.ndarray]:
    """Return what draws a run, and the times of the frames."""
    members = [("", data)] if other is None else [("with", data), ("without", other)]
    shot, time = Shot(**options), data["time"].values
    reel = reel_of(Shot(size=size), float(time[0]), float(time[-1]), ".gif")
    with mpl.rc_context(STYLE):
        return Picture(space_of(members, 400, 81), shot, reel, "title", ""), reel.times


def place(picture: Picture, point, panel: int = 0) -> tuple[int, int]:
    """Return the row and the column of a point of space."""
    drawn = picture._panels[panel]
    seen = drawn.camera.view.paper(np.asarray(point) - drawn._drift)
    axes = picture._frame.axes[panel]
    x, y = axes.transData.transform(seen)
    return picture._frame.size[1] - 1 - int(y), int(x)


def is_blue(pixel) -> bool:
    return bool(int(pixel[2]) > int(pixel[0]) + 60)


# --- what is shown --------------------------------------------------------------------------------


@pytest.mark.parametrize("view", ["side", "angle"])
def test_the_arm_is_drawn_where_the_result_has_it(view):
    data = swaying_arm(records=21, duration=2.0, nodes=11, sway=0.3, flow=0.0)
    picture, _ = pictures(data, view=view, colour="none")
    middle = data["position"].values[:, 7]
    for record in (0, 10, 20):
        drawn = picture.at(float(data["time"][record]))
        here = place(picture, [middle[record, 0], 0.0, middle[record, 1]])
        assert is_blue(drawn[here]), record
    first, last = (place(picture, [x, 0.0, z]) for x, z in middle[[0, 20]])
    assert first != last
    far = place(picture, [middle[0, 0], 0.0, middle[0, 1] + 0.1])
    assert not is_blue(drawn[far])


def test_a_run_in_space_is_drawn_where_the_result_has_it():
    data = curling_arm(records=11, duration=2.0, nodes=11, flow=(0.0, 0.0, 0.0))
    picture, _ = pictures(data, colour="none", azimuth=-40.0, elevation=35.0)
    for record in (0, 5, 10):
        drawn = picture.at(float(data["time"][record]))
        assert is_blue(drawn[place(picture, data["position"].values[record, 6])]), record


@pytest.mark.parametrize(
    ("view", "right", "up"),
    [
        ("side", (1, 0, 0), (0, 0, 1)),
        ("above", (1, 0, 0), (0, 1, 0)),
        ("ahead", (0, 1, 0), (0, 0, 1)),
    ],
)
def test_views_have_their_axes_to_the_right_and_up(view, right, up):
    picture, _ = pictures(curling_arm(records=3, duration=1.0, nodes=5), view=view)
    middle = np.array([0.2, 0.0, -10.0])
    row, column = place(picture, middle)
    beside, above = (place(picture, middle + 0.1 * np.array(way)) for way in (right, up))
    assert beside[0] == row
    assert beside[1] > column + 5
    assert above[0] < row - 5
    assert above[1] == column


def test_between_saved_instants_the_arm_glides():
    data = swaying_arm(records=5, duration=2.0, nodes=6)
    course = Course(space_of([("", data)], 10, 10).members[0])
    both = data["position"].values[1:3]
    np.testing.assert_allclose(
        course.at(0.625).position[:, [0, 2]], 0.75 * both[0] + 0.25 * both[1], atol=1e-12
    )
    for time, record in ((-1.0, 0), (0.5, 1), (2.0, 4), (9.0, 4)):
        found = course.at(time).position[:, [0, 2]]
        np.testing.assert_allclose(found, data["position"].values[record], atol=1e-12)


def test_the_arm_comes_out_of_the_end_of_its_clamp_toward_the_eye():
    data = curling_arm(records=3, nodes=11, flow=(0.0, 0.0, 0.0))
    picture, times = pictures(data, colour="none", azimuth=-40.0, elevation=25.0)
    root, beyond = data["position"].values[0, 0], CLAMP * float(data["diameter"][0]) / 2 + 0.006
    drawn = picture.at(float(times[0]))
    ahead = np.array([1.0, 0.0, 0.0])
    assert is_blue(drawn[place(picture, root + beyond * ahead)])
    assert not is_blue(drawn[place(picture, root + beyond / 2 * ahead)])


@pytest.mark.parametrize("nearer", [0.1, -0.1])
def test_in_space_what_is_nearer_hides_what_is_behind_with_control_or_without(nearer):
    data = curling_arm(records=3, nodes=11, flow=(0.0, 0.0, 0.0))
    other = data.copy(deep=True)
    yaw, pitch = np.deg2rad([-40.0, 35.0])
    toward = [np.cos(pitch) * np.cos(yaw), np.cos(pitch) * np.sin(yaw), np.sin(pitch)]
    other["position"] = other["position"] + nearer * xr.DataArray(toward, dims="axis")
    picture, times = pictures(data, other, azimuth=-40.0, elevation=35.0)
    pixel = picture.at(float(times[0]))[place(picture, data["position"].values[0, 8])]
    assert is_blue(pixel) == (nearer < 0.0)


def test_beside_each_other_are_the_run_and_that_without_control():
    still = swaying_arm(records=11, duration=2.0, nodes=6, sway=0.0, flow=0.0)
    moving = swaying_arm(records=11, duration=2.0, nodes=6, sway=0.4, flow=0.0, driven=False)
    picture, _ = pictures(still, moving, size=(480, 240), uncontrolled="beside", colour="none")
    first, last = (picture.at(t)[30:].astype(int) for t in (0.0, 2.0))
    changed = np.abs(last - first).sum(axis=-1) > 60
    assert not changed[:, :240].any()
    assert changed[:, 240:].sum() > 100
    ghost, _ = pictures(still, moving, uncontrolled="ghost")
    alone, _ = pictures(still, moving, uncontrolled="none")
    assert (ghost.at(2.0) != alone.at(2.0)).any(axis=-1).sum() > 100


def test_the_current_is_drawn_as_arrows_that_turn():
    data = swaying_arm(records=11, duration=2.0, nodes=6, gust=0.2)
    picture, _ = pictures(data)
    water = [int(WATER[i : i + 2], 16) for i in (1, 3, 5)]
    seen = [
        np.abs(picture.at(t)[..., :3].astype(int) - water).max(axis=-1) < 30 for t in (0.0, 2.0)
    ]
    assert all(each.sum() > 20 for each in seen)
    assert (seen[0] != seen[1]).any()
    dry, _ = pictures(swaying_arm(records=11, duration=2.0, nodes=6, flow=0.0))
    assert not (np.abs(dry.at(0.0)[..., :3].astype(int) - water).max(axis=-1) < 30).any()


def test_a_base_that_travels_far_stays_in_the_picture_and_so_does_a_tip_that_is_followed():
    data = swaying_arm(records=21, duration=2.0, nodes=6)
    far = data["position"] + 5.0 * data["time"] * (data["axis"] == "x")
    moved = data.assign(
        position=far,
        tip_position=far[:, -1],
        tip_target=far[:, -1].transpose(*data["tip_target"].dims),
    )
    for followed, node in ((None, 0), ("tip", -1)):
        picture, _ = pictures(moved, follow=followed, colour="none")
        found = []
        for record in (0, 10, 20):
            drawn = picture.at(float(moved["time"][record]))
            x, z = moved["position"].values[record, 3]
            assert is_blue(drawn[place(picture, [x, 0.0, z])])
            x, z = moved["position"].values[record, node]
            found.append(place(picture, [x, 0.0, z]))
        assert np.ptp(found, axis=0).max() <= 1, followed
        assert 0 < found[0][0] < 240
        assert 0 < found[0][1] < 320
    standing, _ = pictures(moved, follow="none")
    standing.at(2.0)
    at_the_end = place(standing, [moved["position"].values[-1, 0, 0], 0.0, -10.0])
    assert at_the_end[1] > 160  # from the left to the right


@pytest.mark.parametrize("colour", ["curvature", "tension", "speed", "distance", "none"])
def test_all_that_the_page_colours_by_can_be_filmed(colour):
    picture, times = pictures(among_obstacles(records=5, nodes=6), colour=colour, size=(200, 160))
    assert picture.at(float(times[1])).shape == (160, 200, 4)


def test_views_colours_and_speeds_are_those_of_the_page():
    scripts = {name: parts.part(f"{name}.js") for name in ("camera", "tools", "main")}
    presets = re.findall(r"(\w+): \[(-?\d+), (-?\d+)\]", scripts["camera"].split(";")[0])
    assert {name: (float(a), float(e)) for name, a, e in presets} == PRESETS
    for name, signed in (("one", False), ("two", True)):
        listed = re.search(rf"{name}: \[(.*?)\]", scripts["tools"])[1]
        assert tuple(re.findall(r"#\w+", listed)) == RAMPS[signed]
    speeds = re.search(r"const speeds = \[(.*?)\]", scripts["main"])[1]
    assert tuple(map(float, speeds.split(","))) == SPEEDS


@pytest.mark.parametrize(
    ("duration", "ending", "speed"),
    [(30.0, ".mp4", 1.0), (30.0, ".gif", 2.0), (600.0, ".mp4", 20.0), (2.0, ".mp4", 0.25)],
)
def test_a_long_run_goes_faster_and_a_short_one_slower(duration, ending, speed):
    assert reel_of(Shot(), 0.0, duration, ending).speed == speed


# --- files ----------------------------------------------------------------------------------------


def test_an_mp4_has_its_frames_size_and_duration_and_plays_in_browsers(planar, tmp_path):
    path = tmp_path / "run.mp4"
    ended = call(planar, "--to", path, "--speed", 2, "--fps", 20, "--size", "320x240")
    assert (ended.exit_code, ended.stdout.split()) == (0, ["wrote", str(path)])
    frames = decoded(path)
    assert frames.shape == (21, 240, 320, 3)
    with av.open(path) as film:
        (stream,) = film.streams
        assert (stream.codec_context.name, stream.pix_fmt) == ("h264", "yuv420p")
        assert float(stream.duration * stream.time_base) == pytest.approx(21 / 20, abs=0.01)
        assert stream.average_rate == 20
        assert film.metadata["title"] == "Station keeping in a turbulent current"
    content = path.read_bytes()
    assert content.index(b"moov") < content.index(b"mdat")  # it plays before all of it is there
    changed = np.abs(frames[-1].astype(int) - frames[0]).sum(axis=-1) > 60
    assert changed.sum() > 100
    assert is_film(path)


def test_a_gif_has_its_frames_size_and_duration_and_is_small(spatial, tmp_path):
    path = tmp_path / "run.gif"
    ended = call(spatial, "--to", path, "--until", 3, "--speed", 1, "--size", "240x200")
    assert (ended.exit_code, ended.stdout.split()) == (0, ["wrote", str(path)])
    frames = decoded(path)
    assert frames.shape == (46, 200, 240, 3)
    with Image.open(path) as film:
        spent = [each.info["duration"] for each in ImageSequence.Iterator(film)]
        assert film.info["loop"] == 0
    assert sum(spent) == pytest.approx(46 / 15 * 1000, abs=5)
    assert (np.abs(frames[-1].astype(int) - frames[0]).sum(axis=-1) > 60).sum() > 100
    assert path.stat().st_size < 46 * 10_000
    assert is_film(path)


def test_pictures_of_a_gif_are_those_that_were_drawn(tmp_path, planar):
    path = tmp_path / "run.gif"
    assert call(planar, "--to", path, "--speed", 1, "--fps", 10).exit_code == 0
    data = [
        swaying_arm(records=41, duration=2.0, nodes=6, **k)
        for k in ({}, {"driven": False, "sway": 0.1})
    ]
    drawn, _ = pictures(*data, size=(480, 360))
    for frame, time in ((0, 0.0), (11, 1.1), (20, 2.0)):
        apart = np.abs(decoded(path)[frame][60:].astype(int) - drawn.at(time)[60:, :, :3])
        assert apart.mean() < 2.0


def test_without_a_name_the_film_is_beside_the_result(planar):
    ended = call(planar / "result.nc", "--until", 0.1, "--size", "160x160")
    assert ended.exit_code == 0, ended.output
    assert (planar / "film.mp4").is_file()
    clear_figures(planar)
    assert not (planar / "film.mp4").exists()


def test_without_pyav_a_gif_is_written_and_an_mp4_refused(planar, tmp_path, monkeypatch):
    monkeypatch.setattr("crinoid.report.film.file.find_spec", lambda name: None)
    ended = call(planar, "--to", tmp_path / "x.mp4")
    (line,) = ended.stderr.splitlines()
    assert ended.exit_code == 2
    assert line == 'crinoid: --to: an MP4 needs PyAV: pip install "crinoid[film]"; a GIF does not'
    ended = call(planar, "--until", 0.1, "--speed", 0.5, "--size", "160x160")
    assert ended.exit_code == 0
    assert 'note: writes a GIF: an MP4 needs PyAV: pip install "crinoid[film]"' in ended.stdout
    assert decoded(planar / "film.gif").shape[1:] == (160, 160, 3)
    (planar / "film.gif").unlink()


def test_instants_without_numbers_are_left_out_and_said(tmp_path):
    data = swaying_arm(records=11, duration=2.0, nodes=6)
    data["curvature"][4, 2] = np.nan
    data["position"][6, 5] = np.nan
    save(data, tmp_path / "result.nc")
    ended = call(tmp_path, "--size", "160x160", "--fps", 5, "--speed", 1)
    assert ended.exit_code == 0
    assert "note: 1 instant is left out" in ended.stdout
    assert "note: 1 saved instant is left out: at it the arm has no shape to draw" in ended.stdout
    assert len(decoded(tmp_path / "film.mp4")) == 11


@pytest.mark.filterwarnings("ignore:Glyph")
@pytest.mark.parametrize(
    "title", ["$x^2$ and $\\frac{$", "\x1b[31mred\nline", "words " * 400, "潮", "w" * 900]
)
def test_a_title_is_shown_as_it_is(tmp_path, title):
    data = swaying_arm(records=3, duration=0.2, nodes=4, status="failed at t = 0.2 s: $a hit$")
    save(data.assign_attrs(title=title), tmp_path / "result.nc")
    ended = call(tmp_path, "--size", "160x160", "--fps", 5)
    assert (ended.exit_code, ended.stderr) == (0, "")
    with mpl.rc_context(STYLE):
        from crinoid.report.film.frame import Frame

        frame = Frame((640, 480), title, "", 1)
        said = [each.get_text() for each in frame._over]
        frame.draw_over("0 s")
    assert all(text.isprintable() for text in said)
    assert not any(each.get_parse_math() for each in frame._over)
    if "$" in title:
        assert title in said


# --- mistakes -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "named"),
    [
        (["--fps", "0"], "--fps: got 0, takes 1 to 120"),
        (["--fps", "nan"], "--fps: got nan, takes 1 to 120"),
        (["--fps", "60", "--to", "x.gif"], "--fps: got 60, takes 1 to 50"),
        (["--speed", "0"], "--speed: got 0, takes 0.0001 to 10000"),
        (["--speed", "-1"], "--speed: got -1"),
        (["--speed", "inf"], "--speed: got inf"),
        (["--speed", "0.001"], "60001 frames"),
        (["--speed", "100", "--fps", "1"], "the film would have one frame"),
        (["--size", "3840x2160", "--to", "x.gif", "--speed", "0.5"], "GIF of 3840x2160 takes 24"),
        (["--size", "321x240"], "--size: got 321x240, an MP4 takes even numbers, such as 322x240"),
        (["--size", "big"], "--size: got 'big', takes WIDTHxHEIGHT"),
        (["--size", "10x10"], "--size: got 10x10, takes 160 to 3840 each way"),
        (["--size", "9999x400"], "--size: got 9999x400"),
        (["--from", "1.5", "--until", "0.5"], "--until: the film would go from 1.5 s to 0.5 s"),
        (["--from", "2"], "--from: the film would go from 2 s to 2 s"),
        (["--from", "-1"], "--from: got -1 s, takes 0 to 2 s"),
        (["--until", "99"], "--until: got 99 s, takes 0 to 2 s"),
        (["--to", "film.avi"], "--to: got film.avi, takes a name that ends in .mp4 or .gif"),
        (["--to", "film"], "--to: got film, takes"),
        (["--to", "no/such/film.mp4"], "--to: there is no folder"),
        (["--view", "below"], "--view: got 'below', takes side, above, ahead or angle"),
        (["--view", "side", "--azimuth", "3"], "--view: takes no --azimuth"),
        (["--elevation", "95"], "--elevation: got 95, takes -90 to 90"),
        (["--azimuth", "nan"], "--azimuth: got nan"),
        (["--zoom", "0"], "--zoom: got 0, takes 0.1 to 100"),
        (["--follow", "boat"], "--follow: got 'boat', takes none, tip or base"),
        (["--uncontrolled", "x"], "--uncontrolled: got 'x', takes ghost, beside or none"),
        (["--colour", "red"], "--colour: got 'red', this result takes curvature, tension, speed"),
        (["--colour", "distance"], "--colour: got 'distance'"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_a_mistake_gets_one_line_and_nothing_is_written(
    planar, tmp_path, monkeypatch, options, named
):
    monkeypatch.chdir(tmp_path)
    before = sorted(planar.iterdir())
    ended = call(planar, *options)
    (line,) = ended.stderr.splitlines()
    assert ended.exit_code == 2
    assert line.startswith("crinoid: ")
    assert named in line
    assert not list(tmp_path.iterdir())
    assert sorted(planar.iterdir()) == before


def test_what_is_no_run_is_refused_in_one_line(tmp_path, planar, spatial):
    save(swaying_arm(records=1, nodes=4), tmp_path / "still" / "result.nc")
    write_study(tmp_path / "study", [study_row(1)])
    (tmp_path / "broken.nc").write_bytes(b"no netCDF")
    (tmp_path / "empty").mkdir()
    refused = {
        "still": "one instant",
        "study": "holds a study; takes the folder of one of its cases",
        "broken.nc": "not a readable netCDF file",
        "empty": "no result here",
        "nowhere": "no such file",
    }
    before = sorted(tmp_path.rglob("*"))
    for name, said in refused.items():
        ended = call(tmp_path / name)
        (line,) = ended.stderr.splitlines()
        assert ended.exit_code == 2
        assert said in line
    for wish in ("ghost", "beside"):
        ended = call(spatial, "--uncontrolled", wish)
        (line,) = ended.stderr.splitlines()
        assert f"--uncontrolled: got {wish!r}, but the result has no uncontrolled run" in line
    assert sorted(tmp_path.rglob("*")) == before
    assert [path.name for path in spatial.iterdir()] == ["result.nc"]


def test_a_file_of_others_is_replaced_only_if_that_is_wanted(planar, tmp_path):
    path = tmp_path / "holiday.gif"
    path.write_bytes(b"GIF89a of a beach")
    short = ("--to", path, "--until", 0.1, "--speed", 0.5, "--size", "160x160")
    ended = call(planar, *short)
    assert ended.exit_code == 2
    assert "holiday.gif was not made by crinoid; takes another name, or --force" in ended.stderr
    assert path.read_bytes() == b"GIF89a of a beach"
    assert call(planar, *short, "--force").exit_code == 0
    assert is_film(path)
    assert call(planar, *short).exit_code == 0  # its own


@pytest.mark.parametrize("name", ["film.mp4", "film.gif"])
def test_interrupted_nothing_is_left_and_an_earlier_film_stays(planar, tmp_path, monkeypatch, name):
    path = tmp_path / name
    drawn, at = [], Picture.at

    def interrupted(picture: Picture, time: float) -> np.ndarray:
        drawn.append(time)
        if len(drawn) == 12:
            signal.raise_signal(signal.SIGINT)
        return at(picture, time)

    monkeypatch.setattr(Picture, "at", interrupted)
    for earlier in (False, True):
        if earlier:
            path.write_bytes(b"made by crinoid 0.0.1")
        drawn.clear()
        ended = call(planar, "--to", path, "--size", "160x160")
        assert ended.exit_code == 130
        assert ended.stderr == "crinoid: interrupted: no film is written\n"
        assert len(drawn) == 12
        assert [each.name for each in tmp_path.iterdir()] == [name] * earlier
    assert path.read_bytes() == b"made by crinoid 0.0.1"


def test_filming_needs_no_jax():
    code = "import sys, crinoid.cli.filming; sys.exit('jax' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_a_wish_to_stop_that_a_destructor_loses_is_no_words_on_the_terminal():
    code = """from crinoid.cli.interruption import Interrupted, heed

class Loses:
    def __init__(self, error): self.error = error
    def __del__(self): raise self.error

heed()
Loses(Interrupted())
Loses(ValueError("told"))
"""
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ("Interrupted" in ended.stderr, "ValueError: told" in ended.stderr) == (False, True)
