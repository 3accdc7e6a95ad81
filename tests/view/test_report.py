"""The figures: they are written, they show something, and they refuse what is no result."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from crinoid.cli.folder import clear_figures
from crinoid.foundation.result_variables import large_names
from crinoid.results.own_files import is_own
from crinoid.view.figures import ReportError, write_report
from crinoid.view.figures.arm import mount_facets
from crinoid.view.figures.charts.drive import drawn_in, drive_chart
from crinoid.view.figures.charts.tip import tip_chart
from crinoid.view.figures.charts.touch import contact_chart
from crinoid.view.figures.paper import draw_chart
from crinoid.view.figures.run import Run
from crinoid.view.figures.shape import draw_shape
from crinoid.view.page.parts import PAGE
from crinoid.view.page.write import write_run
from helpers.figures import (
    FIGURES,
    assert_drawn,
    assert_is_a_page,
    assert_report,
    assert_shows_something,
    quick_and_slow,
)
from helpers.planar_result import OBSTACLES, among_obstacles, swaying_arm
from helpers.studies import save, study_row, write_study

pytestmark = pytest.mark.usefixtures("coarse")


@pytest.mark.slow
def test_figures_are_written_where_asked_and_show_the_uncontrolled_run(tmp_path):
    path = save(swaying_arm(records=41), tmp_path / "result.nc")
    alone = assert_report(path, out=tmp_path / "b" / "c")
    assert {figure.parent for figure in alone} == {tmp_path / "b" / "c"}
    assert [p.name for p in tmp_path.iterdir() if p.is_file()] == ["result.nc"]
    save(swaying_arm(records=41, driven=False, sway=0.12), tmp_path / "uncontrolled.nc")
    compared = assert_report(tmp_path)
    assert {figure.parent for figure in compared} == {tmp_path}
    # that run alone has a folder of its own, and says which it is
    for figure in write_report(tmp_path / "uncontrolled.nc"):
        assert figure.parent == tmp_path / "uncontrolled"
    assert ", without control</title>" in figure.read_text()
    same = [a.read_bytes() == b.read_bytes() for a, b in zip(alone, compared, strict=True)]
    assert same == [False, False, False, True, True, False, False, False, False]


def few(**changes):
    return swaying_arm(**{"records": 5} | changes)


ODD = {
    "a millimetre, straight down": lambda: few(length=1e-3, sway=1e-4, tilt_deg=-90.0),
    "straight up, nothing moves, still water": lambda: few(
        tilt_deg=90.0, sway=0.0, flow=0.0, driven=False
    ),
    "stopped after two records, two nodes, nothing driven, moving target": lambda: few(
        records=2,
        duration=0.02,
        status="stopped at 0.03 s: Newton did not converge (residual 3.1e+04)",
        nodes=2,
        driven=False,
        moving_target=True,
    ),
    "a kilometre, long": lambda: few(records=3000, duration=60, length=1e3, sway=100.0),
    "shapes alone": lambda: few()[
        ["position", "tip_position", "tip_target", "tip_error"]
    ].drop_vars(["diameter", "arc_length"]),
    "no values along the arm": lambda: few(records=21).drop_vars(
        set(large_names(2)) - {"position"}, errors="ignore"
    ),
}


@pytest.mark.parametrize("name", quick_and_slow(ODD, quick=1))
def test_odd_runs_are_drawn(name, tmp_path):
    save(ODD[name](), tmp_path / "result.nc")
    assert_report(tmp_path)


def test_one_instant_has_no_charts_over_time(tmp_path):
    save(few(records=1, duration=0.0), tmp_path / "result.nc")
    written = write_report(tmp_path)
    assert [path.name for path in written] == ["shape.png", "bending.png", PAGE]
    for path in written:
        assert_shows_something(path)
    assert '"roots":[]' in written[-1].read_text("utf-8").replace(": ", ":")


@pytest.mark.parametrize(("length", "half"), [(0.5, 0.17), (100.0, 6.0)])
def test_the_submarine_of_a_cable_has_the_size_of_one(length, half):
    data = swaying_arm(records=1, duration=0.0, length=length)
    assert not [name for _, _, name in mount_facets(data) if name == "submarine"]
    data = data.assign_attrs(scenario=data.attrs["scenario"] + "[vehicle]\nmass = 9.0\n")
    hull, *_ = (facets for facets, _, name in mount_facets(data) if name == "submarine")
    assert np.ptp(hull.reshape(-1, 3), axis=0).max() == pytest.approx(2 * half)


@pytest.mark.parametrize("ending", [pytest.param("pdf", marks=pytest.mark.slow), "svg"])
def test_figures_are_written_in_other_formats_with_their_texts(ending, tmp_path):
    save(swaying_arm(records=5, nodes=5), tmp_path / "result.nc")
    names = {path.name for path in write_report(tmp_path, file_format=ending)}
    figures = [*FIGURES, "cycles.png"]
    assert names == {PAGE, *(Path(name).with_suffix(f".{ending}").name for name in figures)}
    content = (tmp_path / f"shape.{ending}").read_bytes()
    assert b"FontFile2" in content if ending == "pdf" else b">arm over time</text>" in content
    assert is_own(tmp_path / f"shape.{ending}")
    again = write_report(tmp_path, tmp_path / "again", file_format=ending)
    assert content == next(path for path in again if path.stem == "shape").read_bytes()
    (tmp_path / f"mine.{ending}").write_bytes(b"%PDF-1.4 <svg>")
    clear_figures(tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {"result.nc", "again", f"mine.{ending}"}
    with pytest.raises(ReportError, match='must be "png", "pdf" or "svg"'):
        write_report(tmp_path, file_format="eps")


def test_round_off_is_drawn_as_zero_and_still_water_not_at_all():
    data = swaying_arm(records=5, nodes=5)
    data["flow_velocity"][:] = 0.0
    data["tip_angle_target"] = data["tip_angle"] + 1e-15
    filled = {panel.name: panel for panel in tip_chart(Run(data)).filled}
    assert "tip_water" not in filled
    (off,) = filled["tip_off_direction"].traces
    assert not off.values.any()
    assert filled["tip_off_direction"].high is None
    (error,) = filled["tip_error"].traces
    np.testing.assert_array_equal(error.values, data["tip_error"])


HANGING = {"records": 41, "drift": 0.0, "touching": False, "tilt_deg": -80.0}


@pytest.mark.parametrize("changes", [HANGING, {"records": 1, "duration": 0.0}])
def test_odd_obstacles_and_their_contacts_are_drawn(changes, tmp_path):
    run = Run(among_obstacles(**changes))
    assert_drawn(run, tmp_path, draw_shape, lambda run: draw_chart(contact_chart(run), run))
    assert_is_a_page(write_run(run, tmp_path / PAGE))


@pytest.mark.slow
def test_obstacles_change_the_shapes_and_nothing_else_but_add_contacts(tmp_path):
    run = among_obstacles(records=41)
    save(run, tmp_path / "result.nc")
    save(swaying_arm(records=41, driven=False), tmp_path / "uncontrolled.nc")  # it met none
    among = [path.read_bytes() for path in assert_report(tmp_path, "contact.png")]
    save(run.drop_dims("obstacle"), tmp_path / "result.nc")
    alone = [path.read_bytes() for path in write_report(tmp_path)]
    assert len(among) == len(alone) + 1
    same = [a == b for a, b in zip(among, alone, strict=False)]
    assert same == [False, *[True] * 7, False]


def lines_of(axes):
    return {line.get_label(): line for line in axes.get_lines() if line.get_label()[:1] != "_"}


def test_prescribed_motion_does_not_look_like_a_servo_that_fails():
    made = swaying_arm()
    pose = made["base_pose"].copy()
    pose[:, 1] = 0.1 * np.sin(made["time"])  # heave is prescribed, slide both, tilt driven
    pose[:, 0] += 0.2
    run = Run(made.assign(base_servo=made["base_pose"], base_pose=pose))
    shifts, heaves, turns = (lines_of(axes) for axes in draw_chart(drive_chart(run), run).axes[:3])
    assert list(shifts) == ["slide", "slide as prescribed and driven", "commands"]
    np.testing.assert_allclose(shifts["slide"].get_ydata(), 1e3 * made["base_pose"][:, 0])
    assert list(heaves) == ["heave as prescribed"]
    assert list(turns) == ["tilt", "commands"]


@pytest.mark.slow
def test_a_study_is_drawn_with_each_of_its_cases(tmp_path):
    rows = [study_row(1), study_row(2, settling_time=""), study_row(3, status="diverged at 3 s")]
    write_study(tmp_path, rows)
    save(swaying_arm(records=21, sway=0.1), tmp_path / "case-01" / "result.nc")
    save(among_obstacles(records=21, sway=0.05), tmp_path / "case-02" / "result.nc")
    written = write_report(tmp_path)
    figures = [*FIGURES, "loads.png", "cycles.png"]
    names = [Path("case-01") / name for name in [*figures, PAGE]]
    names += [Path("case-02") / name for name in [*figures, "contact.png", PAGE]]
    drawn = [*names, Path("means.png"), Path(PAGE)]
    assert [p.relative_to(tmp_path) for p in written] == drawn
    for path in written[:-1]:
        assert_shows_something(path)


def test_a_study_of_many_cases_has_a_page_and_no_figure(tmp_path):
    write_study(tmp_path, [study_row(n) for n in range(1, 101)])
    assert write_report(tmp_path) == [tmp_path / PAGE]


def described(old, new):
    """Return a result whose scenario has other words about its obstacles."""
    return among_obstacles(records=5).assign_attrs(scenario=OBSTACLES.replace(old, new))


LATE = {"time": np.array([0.0, 5.0, 10.0, np.nan, np.nan])}
FOREIGN = xr.Dataset({"temperature": ("time", [1.0])}, coords={"time": [0.0]})
PLANE = OBSTACLES[OBSTACLES.rindex("{") : OBSTACLES.rindex("]")]
UNDESCRIBED = "does not describe its obstacles"
SPOILED = [
    (lambda: None, "no result here"),
    (lambda: b"", "the file is empty"),
    (lambda: b"this is no netCDF", "not a readable netCDF file"),
    (lambda: FOREIGN, "no variable 'position'"),
    (lambda: few().drop_vars("position"), r"output\.variables left out position"),
    (lambda: few().isel(time=[]), "has no records"),
    (lambda: few().assign(position=np.nan * few()["position"]), "no record with a shape to draw"),
    (lambda: few().assign_coords(axis=["u", "v"]), "not labelled x and z"),
    (lambda: few().rename(node="point"), "has dimensions"),
    (lambda: few().isel(time=slice(None, None, -1)), "its times do not rise"),
    (lambda: few().assign_coords(LATE), "its times do not rise"),
    (lambda: described(PLANE, ""), UNDESCRIBED),
    (lambda: described("[0.1, 0.0, 1.0]", "[0.1, 1.0]"), rf"{UNDESCRIBED} .*axis \[0.1, 1.0\]"),
    (lambda: described("[0.1, 1.0]", "[0.0, 0.0]"), rf"{UNDESCRIBED} .*normal \[0.0, 0.0\]"),
    (lambda: described("radius", "size"), f"{UNDESCRIBED} .*radius"),
]


def assert_refused(folder, words):
    with pytest.raises(ReportError, match=words) as caught:
        write_report(folder)
    assert "\n" not in str(caught.value)
    assert str(folder) in str(caught.value)
    assert not list(folder.glob("*.png"))


@pytest.mark.parametrize(("spoiled", "words"), SPOILED, ids=[words for _, words in SPOILED])
def test_a_file_that_is_no_result_is_refused_in_one_line(spoiled, words, tmp_path):
    path, content = tmp_path / "result.nc", spoiled()
    if isinstance(content, bytes):
        path.write_bytes(content)
    elif content is not None:
        save(content, path)
    assert_refused(tmp_path, words)


def test_half_a_file_and_a_path_that_is_not_there_are_refused(tmp_path):
    path = save(few(), tmp_path / "result.nc")
    path.write_bytes(path.read_bytes()[:5000])
    assert_refused(tmp_path, "not a readable netCDF file")
    assert_refused(tmp_path / "nowhere", "no such file or directory")


@pytest.mark.parametrize(
    ("row", "words"),
    [
        (study_row(1, rms_error="much"), "rms_error of case-01 is 'much', not a number"),
        (study_row(1, directory="../elsewhere"), "not a folder inside the study"),
    ],
)
def test_a_broken_table_of_cases_is_refused(row, words, tmp_path):
    write_study(tmp_path, [row])
    with pytest.raises(ReportError, match=words):
        write_report(tmp_path)


def test_a_table_of_others_does_not_hide_a_result(tmp_path):
    (tmp_path / "cases.csv").write_text("case,age\n1,34\n", encoding="utf-8")
    text = "cases.csv: not the table of a study, with case, keys, measures"
    for path in (tmp_path, tmp_path / "cases.csv"):
        with pytest.raises(ReportError, match=text):
            write_report(path)
    save(few(), tmp_path / "result.nc")
    assert_report(tmp_path)


def test_an_empty_table_of_cases_is_refused(tmp_path):
    (tmp_path / "cases.csv").write_text(",".join(study_row(1)) + "\n", encoding="utf-8")
    with pytest.raises(ReportError, match="has no case"):
        write_report(tmp_path)


IMPORTED = {
    "crinoid.view.figures": {"matplotlib", "bokeh"},
    "crinoid.results.result": {"matplotlib", "bokeh", "crinoid.view.figures"},
    "crinoid.cli.result_commands": {"jax"},
}


@pytest.mark.parametrize("name", IMPORTED)
def test_importing_loads_nothing_that_draws_and_filming_no_jax(name):
    code = f"import sys, {name}; print(sorted({IMPORTED[name]!r} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stdout == "[]\n", done.stderr


@pytest.mark.slow
def test_drawing_leaves_the_settings_of_the_caller_alone(tmp_path):
    save(few(), tmp_path / "result.nc")
    # in another process, as tests here may have loaded pyplot
    code = """
import sys
from pathlib import Path
import matplotlib as mpl
from crinoid.view.figures import write_report

def settings():  # asking for the backend would load one
    return {name: mpl.rcParams[name] for name in mpl.rcParams if name != "backend"}

before = settings()
write_report(Path(sys.argv[1]))
assert settings() == before
assert "matplotlib.pyplot" not in sys.modules
"""
    subprocess.run([sys.executable, "-c", code, str(tmp_path)], check=True)


def test_small_drives_are_drawn_in_a_unit_that_the_label_names():
    shares = [(0.4, "share", 0.4), (7.2e-5, "10⁻⁵ of share", 7.2), (0.0, "share", 0.0)]
    for unit, (most, name, drawn) in [*(("1", row) for row in shares), ("N", (7.2e-5, "µN", 72.0))]:
        found = drawn_in(unit, most)
        assert (found.name, found.factor * most) == (name, pytest.approx(drawn))
