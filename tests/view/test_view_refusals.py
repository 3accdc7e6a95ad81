"""What reports, films, exports and live sessions refuse: in one line, and nothing is written."""

import re
import sys

import numpy as np
import pytest
import xarray as xr

from crinoid.results.report_error import ReportError
from crinoid.results.result import Result
from crinoid.results.scene.data import find_obstacles
from crinoid.scenario import ScenarioError
from crinoid.view.export import write_export
from crinoid.view.export.formats import FORMATS, writer_of
from crinoid.view.figures import write_report
from helpers.command import assert_refused, refused
from helpers.planar_result import OBSTACLES, among_obstacles, swaying_arm
from helpers.studies import save, study_row, write_study


def few(**changes):
    return swaying_arm(**{"records": 5, "duration": 2.0, "nodes": 7} | changes)


def described(old, new):
    """Return a result whose scenario has other words about its obstacles."""
    return among_obstacles(records=5).assign_attrs(scenario=OBSTACLES.replace(old, new))


SOLID = 'kind="mesh", position=[0.3, -9.9], file="rock.stl"'
LATE = {"time": np.array([0.0, 5.0, 10.0, np.nan, np.nan])}
FOREIGN = xr.Dataset({"temperature": ("time", [1.0])}, coords={"time": [0.0]})
UNDESCRIBED = "does not describe its obstacles"
SPOILED = [
    (b"", "the file is empty"),
    (b"this is no netCDF", "not a readable netCDF file"),
    (lambda: FOREIGN, "it has no axis over axis"),
    (lambda: few().drop_vars("position"), r"output\.variables left out position"),
    (lambda: few().assign(contact_force=few()["velocity"]), "it has no obstacle_position"),
    (lambda: few().isel(time=[]), "it holds no instant"),
    (lambda: few().assign(position=np.nan * few()["position"]), "no record with a shape to draw"),
    (lambda: few().assign_coords(axis=["u", "v"]), "not labelled x and z"),
    (
        lambda: few().rename(node="point"),
        "its position is no array of numbers over time, node, axis",
    ),
    (lambda: few().assign_coords(LATE), "its times do not rise"),
    (
        lambda: described("[0.1, 0.0, 1.0]", "[0.1, 1.0]"),
        rf"{UNDESCRIBED} .*axis: got \[0.1, 1.0\]",
    ),
    (lambda: described("radius", "size"), f"{UNDESCRIBED} .*radius"),
    ({"rms_error": "much"}, "rms_error of case-01 is 'much', not a number"),
    ({"directory": "../elsewhere"}, "not a folder inside the study"),
    ("case,age\n1,34\n", "cases.csv: not the table of a study, with case, keys, measures"),
    (",".join(study_row(1)) + "\n", "has no case"),
]


def test_a_scenario_with_an_unknown_key_is_read_without_it():
    result = Result(described("radius=0.03", "radius=0.03, of_another_version=3"))
    kinds = [each.kind for each in result.scene.members[0].obstacles]
    assert kinds == ["sphere", "cylinder", "cylinder", "capsule", "plane"]
    (words,) = result.left_out
    assert "obstacle.0.of_another_version: unknown key" in words
    with pytest.raises(ScenarioError, match="of_another_version"):
        _ = result.scenario


def test_a_solid_without_its_surface_is_refused():
    data = described('kind="sphere", position=[0.3, -9.9], radius=0.03, mass=0.1', SOLID)
    with pytest.raises(ValueError, match="the result has no surface of it"):
        find_obstacles(Result(data))


def report_refused(folder, words):
    before = sorted(folder.rglob("*"))
    with pytest.raises(ReportError, match=words) as caught:
        write_report(folder)
    assert "\n" not in str(caught.value)
    assert str(folder) in str(caught.value)
    assert sorted(folder.rglob("*")) == before


@pytest.mark.parametrize(("spoiled", "words"), SPOILED, ids=[words for _, words in SPOILED])
def test_a_report_refuses_files_that_are_no_results_or_studies(spoiled, words, tmp_path):
    if isinstance(spoiled, bytes):
        (tmp_path / "result.nc").write_bytes(spoiled)
    elif isinstance(spoiled, str):
        (tmp_path / "cases.csv").write_text(spoiled, "utf-8")
    elif isinstance(spoiled, dict):
        write_study(tmp_path, [study_row(1, **spoiled)])
    else:
        save(spoiled(), tmp_path / "result.nc")
    report_refused(tmp_path, words)


def test_a_report_refuses_half_a_file_a_path_that_is_not_there_and_other_formats(tmp_path):
    report_refused(tmp_path, "no result here")
    report_refused(tmp_path / "nowhere", "no such file or directory")
    path = save(few(), tmp_path / "result.nc")
    with pytest.raises(ReportError, match='must be "png", "pdf" or "svg"'):
        write_report(tmp_path, file_format="eps")
    path.write_bytes(path.read_bytes()[:5000])
    report_refused(tmp_path, "not a readable netCDF file")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a folder with a result, without one, with one instant, and with studies."""
    folder = tmp_path_factory.mktemp("folder")
    save(few(), folder / "result.nc")
    save(few(records=1), folder / "still" / "result.nc")
    save(few().drop_vars("position"), folder / "bare" / "result.nc")
    write_study(folder / "study", [study_row(1)])
    (folder / "empty").mkdir()
    (folder / "taken").write_text("of another program")
    (folder / "curl.fmu").write_text("of another program")
    (folder / "many.toml").write_text('[vary]\n"arm.length" = [0.4, 0.5]\n')
    return folder


COMMANDS = [
    ("report . --width 85", '--width: got "85"; must be 60mm to 500mm, such as 85mm'),
    ("report . --width 20mm", '--width: got "20mm"; must be 60mm to 500mm'),
    ("film . --fps nan", "--fps: got nan; must be 1 to 120"),
    ("film . --fps 60 --to x.gif", "--fps: got 60; must be 1 to 50"),
    ("film . --speed 0", "--speed: got 0; must be 0.0001 to 10000"),
    ("film . --speed 0.001", "60001 frames"),
    ("film . --speed 100 --fps 1", "the film would have a single frame. Lower --speed"),
    ("film . --size 3840x2160 --to x.gif --speed 0.5", "GIF of 3840x2160 has at most 24"),
    ("film . --size 321x240", "--size: got 321x240; must be even numbers for an MP4"),
    ("film . --size big", '--size: got "big"; must be WIDTHxHEIGHT'),
    ("film . --size 10x10", "--size: got 10x10; width and height must be 160 to 3840"),
    ("film . --from 2", "--from: the film would start at 2 s and end at 2 s"),
    ("film . --until 99", "--until: got 99 s; must be 0 to 2 s"),
    ("film . --to film.avi", "--to: got film.avi; must be a name that ends in .mp4 or .gif"),
    ("film . --to no/such/film.mp4", "--to: there is no folder"),
    ("film . --view below", '--view: got "below"; must be "side", "above", "ahead" or "angle"'),
    ("film . --view side --azimuth 3", "--view: got side and an angle. Omit it"),
    ("film . --elevation 95", "--elevation: got 95; must be -90 to 90"),
    ("film . --zoom 0", "--zoom: got 0; must be 0.1 to 100"),
    ("film . --follow boat", '--follow: got "boat"; must be "none", "tip" or "base"'),
    ("film . --uncontrolled x", '--uncontrolled: got "x"; must be "ghost", "beside" or "none"'),
    ("film . --uncontrolled ghost", '"ghost", but the result has no uncontrolled run'),
    ("film . --colour distance", '--colour: got "distance"; must be "curvature", "tension"'),
    ("film still", "one instant"),
    ("film study", "contains a study. Name the folder of one of its cases"),
    ("film empty", "contains no result"),
    ("export . --to vtkhd", '--to: got "vtkhd"; must be "vtkhdf"'),
    ("export . --to csv --variables tip_eror", "did you mean tip_error?"),
    ("export . --to csv --variables tip_error,tip_error", "twice"),
    ("export . --to csv --variables position --nodes 7", "must be 0 to 6, or -7 to -1"),
    ("export . --to csv --variables position --nodes tip", "whole numbers"),
    ("export . --to csv --nodes 1", "no variable along the arm"),
    ("export . --to gltf --nodes 1", "--nodes: needs --to csv or xlsx"),
    ("export . --to vtkhdf --variables tip_error", "--variables: needs --to csv"),
    ("export . --to gltf --instants 0", "--instants: got 0; must be at least 1"),
    ("export . --to csv --out taken", "is a file; must be a folder"),
    ("export . --to csv --set arm.length=1", "--set: needs --to fmu"),
    ("export nowhere --to csv", "no such file"),
    ("export empty --to csv", "contains no result.nc"),
    ("export bare --to gltf", "left out position"),
    ("export still-watr --to fmu", "no such file or built-in scenario; did you mean"),
    ("export constant-load --to fmu", "vary: is of several cases. Choose one"),
    ("export curl --to fmu --instants 3", "--instants: needs a result. Leave"),
    ("export curl --to fmu --set arm.lengh=1", "arm.lengh: unknown key"),
    ("export curl --to fmu --out .", "curl.fmu was not written by crinoid"),
    ("export curl --to fmu --out taken/below", "Not a directory"),
    ("live still-water --port 70000", "--port: got 70000; must be 0 (any free port) to 65535"),
    ("live many.toml", "vary: a live session is of one case"),
]


@pytest.mark.parametrize(("command", "answer"), COMMANDS, ids=[each for each, _ in COMMANDS])
def test_a_mistake_gets_one_line_and_nothing_is_written(command, answer, folder, monkeypatch):
    if command.startswith("live"):
        pytest.importorskip("websockets", reason="needs websockets")
    monkeypatch.chdir(folder)
    assert_refused(command, f".*{re.escape(answer)}")


LIBRARIES = [
    ("export . --to gltf", "pygltflib", ["gltf"], 'pygltflib: pip install "crinoid[export]"'),
    ("export . --to usd", "pxr", ["usd"], 'usd-core: pip install "crinoid[usd]"'),
    (
        "export . --to mcap",
        "mcap_ros2.writer",
        ["ros"],
        'mcap-ros2-support and rosbags: pip install "crinoid[ros]"',
    ),
    ("export still-water --to fmu", "pythonfmu3", [], 'pip install "crinoid[fmu]"'),
    ("live still-water", "websockets", [], 'pip install "crinoid[live]"'),
]


@pytest.mark.parametrize(("command", "library", "modules", "answer"), LIBRARIES)
def test_a_library_that_lacks_is_named(command, library, modules, answer, folder, monkeypatch):
    monkeypatch.chdir(folder)
    for name in modules:
        monkeypatch.delitem(sys.modules, f"crinoid.view.export.{name}", raising=False)
    monkeypatch.setitem(sys.modules, library, None)
    assert answer in refused(*command.split())


def test_another_module_that_lacks_is_not_blamed_on_the_library(monkeypatch):
    monkeypatch.delitem(sys.modules, "crinoid.view.export.workbook", raising=False)
    monkeypatch.setitem(sys.modules, "itertools", None)
    with pytest.raises(ModuleNotFoundError, match="itertools"):
        writer_of(FORMATS["xlsx"])


@pytest.mark.parametrize("instants", [0, -3])
def test_an_export_has_at_least_one_instant(instants, tmp_path):
    with pytest.raises(ScenarioError, match=f"^--instants: got {instants}; must be at least 1$"):
        write_export(tmp_path, tmp_path, "csv", instants=instants)
