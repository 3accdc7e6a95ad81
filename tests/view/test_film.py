"""Films of runs: what they show, how long they are, and that nothing is left half-written."""

import signal
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from multiprocessing import active_children
from pathlib import Path

import av
import numpy as np
import pytest
from PIL import Image, ImageSequence

from crinoid.cli.folder import clear_figures
from crinoid.results.own_files import is_own
from crinoid.results.result import Result
from crinoid.results.scene.data import in_space
from crinoid.results.scene.scene import build_scene
from crinoid.view.figures.painter import instant
from crinoid.view.film import workers, write
from crinoid.view.film.camera import film_settings
from crinoid.view.film.picture import Picture
from crinoid.view.film.settings import CameraSettings
from helpers.command import call, refused, succeeded
from helpers.made_results import of_runs
from helpers.planar_result import swaying_arm
from helpers.spatial_result import among_obstacles, among_solids, curling_arm
from helpers.studies import save

film, fails, filmed = (partial(each, "film") for each in (call, refused, succeeded))
TINY = ("--size", "160x160")
BRIEF = ("--until", 0.1, "--speed", 0.5, *TINY)


def small_arm(**changes):
    return swaying_arm(**{"records": 11, "duration": 2.0, "nodes": 6} | changes)


@pytest.fixture(scope="module")
def planar(tmp_path_factory) -> Path:
    """Return the folder of a small run in the plane, with and without control."""
    folder = tmp_path_factory.mktemp("planar")
    save(small_arm(records=41), folder / "result.nc")
    save(small_arm(records=41, driven=False, sway=0.1), folder / "uncontrolled.nc")
    return folder


def decoded(path: Path) -> np.ndarray:
    """Return the pictures of a film (frame, high, wide, colour)."""
    if path.suffix == ".gif":
        with Image.open(path) as opened:
            return np.stack([each.convert("RGB") for each in ImageSequence.Iterator(opened)])
    with av.open(path) as opened:
        return np.stack([each.to_ndarray(format="rgb24") for each in opened.decode(video=0)])


def pictures(data, other=None, size=(320, 240), **options) -> tuple[Picture, np.ndarray]:
    """Return what draws a run, and the times of the frames."""
    shot, time = CameraSettings(**options), data["time"].values
    reel = film_settings(CameraSettings(size=size), float(time[0]), float(time[-1]), ".gif")
    scene = build_scene(of_runs(data, other), 400, 81)
    return Picture(scene, shot, reel, "title", ""), reel.times


def place(picture: Picture, point) -> tuple[int, int]:
    """Return the row and the column of a point of space."""
    drawn = picture._panels[0]
    x, y = drawn.axes.transData.transform(drawn.view.paper(np.asarray(point)))
    return picture._frame.size[1] - 1 - int(y), int(x)


def is_blue(pixel) -> bool:
    return bool(int(pixel[2]) > int(pixel[0]) + 60)


def changed(one, other):
    """Tell which pixels of two pictures are far from each other."""
    return np.abs(one.astype(int) - other).sum(axis=-1) > 60


@pytest.mark.parametrize(
    ("arm", "options"),
    [
        (partial(swaying_arm, sway=0.3, flow=0.0), {"view": "side"}),
        (partial(swaying_arm, sway=0.3, flow=0.0), {"view": "angle"}),
        (partial(curling_arm, flow=(0.0, 0.0, 0.0)), {"azimuth": -40.0, "elevation": 35.0}),
    ],
    ids=["from the side", "from an angle", "in space"],
)
def test_the_arm_is_drawn_where_the_result_has_it(arm, options):
    data = arm(records=21, duration=2.0, nodes=11)
    picture, _ = pictures(data, colour="none", **options)
    middle = in_space(data, "position")[:, 7]
    for record in (0, 10, 20):
        drawn = picture.at(float(data["time"][record]))
        assert is_blue(drawn[place(picture, middle[record])]), record
    assert place(picture, middle[0]) != place(picture, middle[20])
    assert not is_blue(drawn[place(picture, middle[0] + [0.0, 0.0, 0.1])])


@pytest.mark.parametrize(
    ("view", "right", "up"), [("side", 0, 2), ("above", 0, 1), ("ahead", 1, 2)]
)
def test_views_have_their_axes_to_the_right_and_up(view, right, up):
    picture, _ = pictures(curling_arm(records=3, duration=1.0, nodes=5), view=view)
    middle, ways = np.array([0.2, 0.0, -10.0]), 0.1 * np.eye(3)
    row, column = place(picture, middle)
    beside, above = (place(picture, middle + ways[axis]) for axis in (right, up))
    assert (beside[0], above[1]) == (row, column)
    assert beside[1] > column + 5
    assert above[0] < row - 5


def test_between_saved_instants_the_arm_glides():
    data = small_arm(records=5)
    run = build_scene(Result(data), 10, 10).members[0]
    position = in_space(data, "position")
    between = 0.75 * position[1] + 0.25 * position[2]
    instants = {-1.0: position[0], 0.5: position[1], 0.625: between, 2.0: position[4]}
    for time, expected in (instants | {9.0: position[4]}).items():
        np.testing.assert_allclose(instant(run, time).position[0], expected, atol=1e-12)


def test_solids_a_capsule_and_a_hull_are_drawn():
    straight = {"bend": (0.0, 0.0), "twist": 0.0, "driven": False, "drift": 0.0}
    data = among_solids(records=3, nodes=11, flow=(0.0, 0.0, 0.0), **straight)
    picture, times = pictures(data, colour="none", view="side")
    first, last = (picture.at(float(time)) for time in times[[0, -1]])
    paper = first[place(picture, [0.4, 0.0, -9.6])]
    obstacle = data["obstacle_position"].values[0]
    hull = data["position"].values[0, 0] - [0.3, 0.0, 0.0]
    for seen in (obstacle[0], obstacle[2], hull):
        at = place(picture, seen)
        assert changed(first[at], paper)
        assert not changed(first[at], last[at])


@pytest.mark.slow
def test_a_film_shows_the_run_without_control_next_to_the_other():
    still = small_arm(sway=0.0, flow=0.0)
    moving = small_arm(sway=0.4, flow=0.0, driven=False)
    picture, _ = pictures(still, moving, size=(480, 240), uncontrolled="beside", colour="none")
    moved = changed(picture.at(2.0)[30:], picture.at(0.0)[30:])
    assert not moved[:, :240].any()
    assert moved[:, 240:].sum() > 100
    ghost, _ = pictures(still, moving, uncontrolled="ghost")
    alone, _ = pictures(still, moving, uncontrolled="none")
    assert (ghost.at(2.0) != alone.at(2.0)).any(axis=-1).sum() > 100


@pytest.mark.slow
def test_a_base_that_travels_far_stays_in_the_picture_and_so_does_a_tip_that_is_followed():
    data = small_arm(records=21)
    far = data["position"] + 5.0 * data["time"] * (data["axis"] == "x")
    tip = far[:, -1].transpose(*data["tip_target"].dims)
    moved = data.assign(position=far, tip_position=tip, tip_target=tip)
    position = in_space(moved, "position")
    for followed, node in ((None, 0), ("tip", -1)):
        picture, _ = pictures(moved, follow=followed, colour="none")
        found = []
        for record in (0, 10, 20):
            drawn = picture.at(float(moved["time"][record]))
            assert is_blue(drawn[place(picture, position[record, 3])])
            found.append(place(picture, position[record, node]))
        assert np.ptp(found, axis=0).max() <= 1, followed


@pytest.mark.slow
def test_each_colour_of_the_arm_is_another_picture():
    drawn = []
    for colour in ("curvature", "tension", "speed", "distance", "none"):
        picture, times = pictures(among_obstacles(records=5, nodes=6), colour=colour)
        drawn.append(picture.at(float(times[1])).tobytes())
    assert len(set(drawn)) == 5


@pytest.mark.parametrize(
    ("duration", "ending", "speed"),
    [(30.0, ".mp4", 1.0), (30.0, ".gif", 2.0), (600.0, ".mp4", 20.0), (2.0, ".mp4", 0.25)],
)
def test_a_long_run_goes_faster_and_a_short_one_slower(duration, ending, speed):
    assert film_settings(CameraSettings(), 0.0, duration, ending).speed == speed


def test_an_mp4_has_its_frames_size_and_duration_and_plays_in_browsers(planar, tmp_path):
    path = tmp_path / "run.mp4"
    said = filmed(planar, "--to", path, "--speed", 2, "--fps", 20, "--size", "320x240")
    assert said.split() == ["wrote", str(path)]
    frames = decoded(path)
    assert frames.shape == (21, 240, 320, 3)
    with av.open(path) as opened:
        (stream,) = opened.streams
        assert (stream.codec_context.name, stream.pix_fmt) == ("h264", "yuv420p")
        assert float(stream.duration * stream.time_base) == pytest.approx(21 / 20, abs=0.01)
        assert stream.average_rate == 20
        assert opened.metadata["title"] == "Station keeping in a turbulent current"
    content = path.read_bytes()
    assert content.index(b"moov") < content.index(b"mdat")  # it plays before all of it is there
    assert changed(frames[-1], frames[0]).sum() > 100
    assert is_own(path)


def test_a_gif_is_small_and_has_the_frames_that_were_drawn(planar, tmp_path):
    path = tmp_path / "run.gif"
    assert filmed(planar, "--to", path, "--speed", 1, "--fps", 10).split() == ["wrote", str(path)]
    frames = decoded(path)
    assert frames.shape == (21, 360, 480, 3)
    with Image.open(path) as opened:
        spent = [each.info["duration"] for each in ImageSequence.Iterator(opened)]
        assert opened.info["loop"] == 0
    assert sum(spent) == pytest.approx(2100, abs=5)
    assert changed(frames[-1], frames[0]).sum() > 100
    assert path.stat().st_size < 21 * 10_000
    assert is_own(path)
    data = [small_arm(records=41, **k) for k in ({}, {"driven": False, "sway": 0.1})]
    drawn, _ = pictures(*data, size=(480, 360))
    for record, time in ((0, 0.0), (11, 1.1), (20, 2.0)):
        apart = np.abs(frames[record][60:].astype(int) - drawn.at(time)[60:, :, :3])
        assert apart.mean() < 2.0


@pytest.mark.slow
def test_a_film_without_a_name_is_in_the_folder_of_the_result(planar):
    filmed(planar / "result.nc", "--until", 1, "--speed", 1, *TINY)
    assert decoded(planar / "film.mp4").shape == (31, 160, 160, 3)  # it ends when asked
    clear_figures(planar)
    assert not (planar / "film.mp4").exists()


def test_without_pyav_a_gif_is_written_and_an_mp4_refused(planar, tmp_path, monkeypatch):
    monkeypatch.setattr("crinoid.view.film.encode.find_spec", lambda name: None)
    line = fails(planar, "--to", tmp_path / "x.mp4")
    assert line == 'crinoid: --to: an MP4 needs PyAV: pip install "crinoid[film]"; a GIF does not'
    note = 'note: writes a GIF: an MP4 needs PyAV: pip install "crinoid[film]"'
    assert note in filmed(planar, *BRIEF)
    assert decoded(planar / "film.gif").shape[1:] == (160, 160, 3)
    (planar / "film.gif").unlink()


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:Glyph")
def test_any_title_and_status_can_be_drawn(tmp_path):
    title = "$x^2$ and $\\frac{$ \x1b[31mred\nline 潮 " + "words " * 400 + "w" * 900
    data = small_arm(records=3, duration=0.2, status="failed at t = 0.2 s: $a hit$")
    save(data.assign_attrs(title=title), tmp_path / "result.nc")
    ended = film(tmp_path, *TINY, "--fps", 5)
    assert (ended.exit_code, ended.stderr) == (0, "")


@pytest.mark.slow
def test_a_file_of_others_is_replaced_only_if_that_is_wanted(planar, tmp_path):
    path = tmp_path / "holiday.gif"
    path.write_bytes(b"GIF89a of a beach")
    line = fails(planar, "--to", path, *BRIEF)
    assert "holiday.gif was not made by crinoid. Choose another name, or" in line
    assert path.read_bytes() == b"GIF89a of a beach"
    filmed(planar, "--to", path, *BRIEF, "--force")
    assert is_own(path)
    filmed(planar, "--to", path, *BRIEF)  # crinoid made it


@pytest.mark.slow
def test_many_frames_are_drawn_side_by_side_and_equal(planar, tmp_path, monkeypatch):
    monkeypatch.setattr(workers, "_LEAST", 5)
    shown = []
    for number in (1, 2):
        monkeypatch.setattr(workers, "cores", lambda number=number: number)
        path = tmp_path / f"{number}.gif"
        filmed(planar, "--to", path, "--speed", 2, *TINY)
        shown.append(decoded(path))
    assert shown[0].shape[0] == 16
    np.testing.assert_array_equal(*shown)


def test_parts_that_are_drawn_once_follow_the_camera():
    data = small_arm(records=5)
    far = data["position"] + 5.0 * data["time"] * (data["axis"] == "x")
    data = data.assign(position=far)
    one, _ = pictures(data, follow="base")
    other, _ = pictures(data, follow="base")
    for time in (0.0, 0.7, 2.0):
        seen = one.at(time)
    np.testing.assert_array_equal(seen, other.at(2.0))


def test_a_run_without_a_target_has_no_cross():
    data = small_arm(records=3)
    scene = build_scene(of_runs(data), 400, 81)
    drawn = []
    for aims in (True, False):
        reel = film_settings(CameraSettings(size=(320, 240)), 0.0, 2.0, ".gif")
        picture = Picture(replace(scene, aims=aims), CameraSettings(), reel, "title", "")
        picture.at(1.0)
        drawn.append(len(picture._panels[0].aim.get_segments()))
    assert drawn[0] > 4
    assert drawn[1] == 0


@pytest.mark.slow
def test_a_process_that_dies_has_one_line_and_leaves_no_film(planar, tmp_path, monkeypatch):
    monkeypatch.setattr(workers, "_LEAST", 5)
    monkeypatch.setattr(workers, "cores", lambda: 2)

    def dying(*arguments) -> Iterator[np.ndarray]:
        for picture in workers.drawn(*arguments):
            yield picture
            for process in active_children():
                process.kill()

    monkeypatch.setattr(write, "drawn", dying)
    line = fails(planar, "--to", tmp_path / "film.gif", "--speed", 2, *TINY)
    assert line == "crinoid: a process that draws frames ended. Is there enough memory?"
    assert not list(tmp_path.iterdir())
    assert not active_children()


@pytest.mark.slow
@pytest.mark.parametrize(("name", "cores"), [("film.mp4", 1), ("film.gif", 1), ("film.mp4", 2)])
def test_an_interrupted_film_leaves_nothing_and_an_earlier_one_stays(
    planar, tmp_path, monkeypatch, name, cores
):
    path = tmp_path / name
    drawn, processes = [], []

    def interrupted(*arguments) -> Iterator[np.ndarray]:
        for picture in workers.drawn(*arguments):
            drawn.append(picture)
            processes.append(len(active_children()))
            if len(drawn) == 12:
                signal.raise_signal(signal.SIGINT)
            yield picture

    monkeypatch.setattr(write, "drawn", interrupted)
    monkeypatch.setattr(workers, "cores", lambda: cores)
    for earlier in (False, True):
        if earlier:
            path.write_bytes(b"made by crinoid 0.0.1")
        drawn.clear()
        line = fails(planar, "--to", path, *TINY, code=130)
        assert line == "crinoid: interrupted: no film is written"
        assert len(drawn) == 12
        assert set(processes) == {cores if cores > 1 else 0}
        assert not active_children()
        assert [each.name for each in tmp_path.iterdir()] == [name] * earlier
    assert path.read_bytes() == b"made by crinoid 0.0.1"


def test_a_wish_to_stop_lost_in_a_destructor_prints_nothing():
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
