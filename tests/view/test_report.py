"""The figures: they are written, and they show something."""

import subprocess
import sys
from pathlib import Path

import matplotlib as mpl
import pytest

from crinoid.cli.folder import clear_figures
from crinoid.results.own_files import is_own
from crinoid.results.result import Result
from crinoid.view.figures import write_report
from crinoid.view.figures.charts.touch import contact_chart
from crinoid.view.figures.paper import draw_chart
from crinoid.view.figures.shape import draw_shape
from crinoid.view.page.parts import PAGE
from crinoid.view.page.write import write_run
from helpers.figures import (
    FIGURES,
    assert_drawn,
    assert_is_a_page,
    assert_report,
    assert_shows_something,
    quick_and_release,
)
from helpers.planar_result import among_obstacles, swaying_arm
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
    # that run alone has a folder of its own, and says which it is
    for figure in write_report(tmp_path / "uncontrolled.nc"):
        assert figure.parent == tmp_path / "uncontrolled"
    assert ", without control</title>" in figure.read_text()
    assert [figure.name for figure in alone] == [figure.name for figure in compared]
    assert alone[0].read_bytes() != compared[0].read_bytes()


def few(**changes):
    return swaying_arm(**{"records": 5} | changes)


ODD = {
    "a millimetre, straight down": {"length": 1e-3, "sway": 1e-4, "tilt_deg": -90.0},
    "straight up, nothing moves": {"tilt_deg": 90.0, "sway": 0.0, "flow": 0.0, "driven": False},
    "stopped after two records": {"records": 2, "duration": 0.02, "nodes": 2, "driven": False}
    | {"status": "stopped at 0.03 s: Newton did not converge", "moving_target": True},
    "a kilometre, long": {"records": 3000, "duration": 60, "length": 1e3, "sway": 100.0},
}


@pytest.mark.parametrize("name", quick_and_release(ODD, quick=1))
def test_odd_runs_are_drawn(name, tmp_path):
    save(few(**ODD[name]), tmp_path / "result.nc")
    assert_report(tmp_path)


def test_one_instant_has_no_charts_over_time(tmp_path):
    save(few(records=1, duration=0.0), tmp_path / "result.nc")
    before = {**mpl.rcParams}
    written = write_report(tmp_path)
    assert {**mpl.rcParams} == before
    assert [path.name for path in written] == ["shape.png", "bending.png", PAGE]
    for path in written:
        assert_shows_something(path)
    assert '"roots":[]' in written[-1].read_text("utf-8").replace(": ", ":")


@pytest.mark.parametrize("ending", [pytest.param("pdf", marks=pytest.mark.slow), "svg"])
def test_figures_are_written_in_other_formats_with_their_texts(ending, tmp_path):
    save(swaying_arm(records=5, nodes=5), tmp_path / "result.nc")
    width = "178mm" if ending == "pdf" else None
    names = {path.name for path in write_report(tmp_path, file_format=ending, width=width)}
    figures = [*FIGURES, "cycles.png"]
    assert names == {PAGE, *(Path(name).with_suffix(f".{ending}").name for name in figures)}
    content = (tmp_path / f"shape.{ending}").read_bytes()
    assert b"FontFile2" in content if ending == "pdf" else b">arm over time</text>" in content
    assert is_own(tmp_path / f"shape.{ending}")
    again = write_report(tmp_path, tmp_path / "again", file_format=ending, width=width)
    assert content == next(path for path in again if path.stem == "shape").read_bytes()
    (tmp_path / f"mine.{ending}").write_bytes(b"%PDF-1.4 <svg>")
    clear_figures(tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {"result.nc", "again", f"mine.{ending}"}


HANGING = {"records": 41, "drift": 0.0, "touching": False, "tilt_deg": -80.0}


@pytest.mark.parametrize("changes", [HANGING, {"records": 1, "duration": 0.0}])
def test_odd_obstacles_and_their_contacts_are_drawn(changes, tmp_path):
    run = Result(among_obstacles(**changes))
    assert_drawn(
        run,
        tmp_path,
        draw_shape,
        lambda run: draw_chart(contact_chart(run), run.dataset, run.title),
    )
    assert_is_a_page(write_run(run, tmp_path / PAGE))


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
    assert sorted(p.relative_to(tmp_path) for p in written) == sorted(drawn)
    for path in written[:-1]:
        assert_shows_something(path)


def test_a_study_of_many_cases_has_a_page_and_no_figure(tmp_path):
    write_study(tmp_path, [study_row(n) for n in range(1, 101)])
    assert write_report(tmp_path) == [tmp_path / PAGE]


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
