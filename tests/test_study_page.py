"""The page of a study: what it holds of the cases, and that text stays text."""

import json
import re

import numpy as np
import pytest
from bokeh.document import Document

from crinoid.cases import MEASURES
from crinoid.report import ReportError, write_page, write_report
from crinoid.report.charts.effects import effects_of
from crinoid.report.charts.study import (
    QUANTILE_CASES,
    Measure,
    Study,
    gridded,
    key_of,
    means_of,
    study_of,
)
from crinoid.report.page.study import MOST_CASES, study_page_of
from crinoid.report.table import read_cases
from crinoid.report.units import Unit
from crinoid.scenario.library import load
from crinoid.sweep.plan import Plan
from test_page import HOSTILE, Tags
from test_report import save, study_row, swaying_arm, write_study


def grid(folder, rows=(1e5, 2e5, 4e5), columns=("none", "pid")):
    """Write the table of a study over a grid of a number and a word."""
    cases = [(value, kind) for value in rows for kind in columns]
    made = []
    for number, (value, kind) in enumerate(cases, start=1):
        row = study_row(number, **{"arm.youngs_modulus": value, "control.kind": kind})
        del row["flow.0.velocity"]
        made.append(row)
    write_study(folder, made)
    return read_cases(folder / "cases.csv")


def told(page):
    return json.loads(Tags(page).texts["table"])


def test_levels_are_sorted_as_numbers_and_kept_as_words():
    numbers = key_of("a", ["10", "9", "10", "1e1", "-3"])
    assert numbers.levels == ["-3", "9", "10", "1e1"]
    assert numbers.numbers.tolist() == [-3.0, 9.0, 10.0, 10.0]
    assert numbers.level.tolist() == [2, 1, 2, 3, 0]
    words = key_of("b", ["pid", "none", "10"])
    assert words.numbers is None
    assert words.levels == ["pid", "none", "10"]
    assert key_of("c", ["1", "nan"]).numbers is None
    assert key_of("d", ["1", "25"]).logarithmic
    assert not key_of("d", ["-1", "25"]).logarithmic


def test_means_and_quantiles_are_those_of_the_cases_at_each_place():
    rng = np.random.default_rng(0)
    place, values = rng.integers(0, 6, 60), rng.normal(size=60)
    place[place == 4] = 0  # nothing there
    values[rng.integers(0, 60, 9)] = np.nan
    found = means_of(values, place, 6)
    for at in range(6):
        some = values[(place == at) & np.isfinite(values)]
        if some.size:
            assert found.mean[at] == pytest.approx(some.mean())
        else:
            assert np.isnan(found.mean[at])
        if some.size >= QUANTILE_CASES:
            assert found.low[at] == pytest.approx(np.quantile(some, 0.05))
            assert found.high[at] == pytest.approx(np.quantile(some, 0.95))
        else:
            assert np.isnan([found.low[at], found.high[at]]).all()


def test_a_grid_is_shown_in_cells_and_scattered_numbers_as_points(tmp_path):
    study = study_of(grid(tmp_path))
    (pair, first, second) = study.views()
    assert [key.name for key in pair] == ["arm.youngs_modulus", "control.kind"]
    assert gridded(pair)
    assert (first, second) == ((pair[0],), (pair[1],))
    rng = np.random.default_rng(0)
    drawn = [study_row(n, **{"flow.0.velocity": rng.random()}) for n in range(1, 12)]
    write_study(tmp_path, drawn)
    (scattered, *_) = study_of(read_cases(tmp_path / "cases.csv")).views()
    assert not gridded(scattered)


def test_shares_of_the_variance_are_those_of_a_function_whose_indices_are_known(tmp_path):
    """Here Ishigami's function (1990), and a sum on a grid, whose shares add up to one."""
    rng, count = np.random.default_rng(0), 3000
    x = rng.uniform(-np.pi, np.pi, (count, 3))
    y = 100.0 + np.sin(x[:, 0]) + 7 * np.sin(x[:, 1]) ** 2 + 0.1 * x[:, 2] ** 4 * np.sin(x[:, 0])
    study = Study(
        [""] * count,
        ["ok"] * count,
        [key_of(f"x{i}", [repr(v) for v in x[:, i].tolist()]) for i in range(3)],
        [],
    )
    found = {e.key.name: e for e in effects_of(study, Measure("y", "y", Unit(1.0, "m"), y))}
    for name, index in (("x0", 0.3139), ("x1", 0.4424), ("x2", 0.0)):
        assert found[name].share == pytest.approx(index, abs=0.04)
        assert found[name].low - 0.03 <= index <= found[name].high + 0.03
        assert found[name].high - found[name].low < 0.1
    rows = [(a, b, n) for a in range(4) for b in range(3) for n in range(6)]
    sums = np.array([1.0 * a + 2.0 * b for a, b, _ in rows])
    keys = [key_of(str(i), [str(row[i]) for row in rows]) for i in range(3)]
    study = Study([""] * len(rows), ["ok"] * len(rows), keys, [])
    shares = {
        e.key.name: e.share for e in effects_of(study, Measure("y", "y", Unit(1.0, "m"), sums))
    }
    of_a, of_b = np.var(np.arange(4)), np.var(2.0 * np.arange(3))
    expected = {"0": of_a / (of_a + of_b), "1": of_b / (of_a + of_b), "2": 0.0}
    assert shares == pytest.approx(expected, abs=1e-9)


def test_keys_that_never_repeat_have_no_share(tmp_path):
    write_study(tmp_path, [study_row(n) for n in range(1, 6)])
    study = study_of(read_cases(tmp_path / "cases.csv"))
    assert [effects_of(study, each) for each in study.measures] == [[]] * 5
    same = Measure("y", "y", Unit(1.0, "m"), np.full(60, 2.0))
    assert effects_of(Study([""] * 60, [""] * 60, [key_of("a", ["1", "2"] * 30)], []), same) == []


def test_the_page_holds_what_the_table_has(tmp_path):
    cases = grid(tmp_path)
    save(swaying_arm(records=5), tmp_path / "case-02" / "result.nc")
    written = write_report(tmp_path)
    assert written[-1] == tmp_path / "report.html"
    page = written[-1].read_text("utf-8")
    assert len(page.encode()) < 3e6
    found = told(page)
    assert found["names"] == [case.name for case in cases]
    assert found["pages"] == [None, "./case-02/report.html", *[None] * 4]
    assert [key["short"] for key in found["keys"]] == ["youngs_modulus", "kind"]
    assert found["keys"][0]["numbers"] == [1e5, 2e5, 4e5]
    values = {each["name"]: (each["unit"], each["values"]) for each in found["measures"]}
    assert values["rms_error"] == ("mm", pytest.approx([6.0 * n for n in range(1, 7)]))
    assert values["settling_time"] == ("s", [2.0 + n for n in range(1, 7)])
    assert [view["kind"] for view in found["views"]] == ["cells", "lines", "lines"]
    (drawn,) = (dict(attrs) for tag, attrs in Tags(page).tags if tag == "polyline")
    assert drawn["data-case"] == "1"
    assert "Station keeping" in page  # the title of the scenario


def test_cells_and_lines_hold_means(tmp_path):
    cases = grid(tmp_path)
    cells, line, _ = (Document.from_json(each["document"]) for each in found_views(cases))
    drawn = cells.roots[0].select_one({"name": "cells"}).data_source.data
    mean = {(x, y): v for x, y, v in zip(drawn["x"], drawn["y"], drawn["rms_error"], strict=True)}
    assert mean == pytest.approx({(k // 2, k % 2): 6.0 * (k + 1) for k in range(6)})
    drawn = line.roots[0].select_one({"name": "line"}).data_source.data
    np.testing.assert_allclose(drawn["x"], [1e5, 2e5, 4e5])
    np.testing.assert_allclose(drawn["rms_error"], [9.0, 21.0, 33.0])
    assert np.isnan(drawn["rms_error low"]).all()


def found_views(cases):
    return told(study_page_of(cases, "", [None] * len(cases)))["views"]


def test_many_cases_are_thinned_and_the_page_says_so(tmp_path):
    rng, count = np.random.default_rng(0), 3 * MOST_CASES
    rows = [
        study_row(n, **{"arm.youngs_modulus": rng.random(), "flow.0.velocity": rng.random()})
        for n in range(1, count + 1)
    ]
    write_study(tmp_path, rows)
    page = study_page_of(read_cases(tmp_path / "cases.csv"), "", [None] * count)
    assert len(page.encode()) < 3e6
    assert f"The page holds {MOST_CASES} of {count} cases, evenly chosen." in page
    assert len(told(page)["names"]) == MOST_CASES


def test_the_page_of_a_sweep_has_the_indices_of_its_plan(tmp_path):
    pytest.importorskip("SALib", reason="needs SALib")
    spans = ["arm.length=0.4:0.6", "arm.radius=0.01:0.02"]
    plan = Plan.of(load("still-water"), spans, sampling="saltelli", count=64)
    (tmp_path / "plan.toml").write_text(plan.to_toml(), "utf-8")
    values = [plan.values(run) for run in range(1, plan.runs + 1)]
    rows = [
        {"case": f"case-{n}", **v, **dict.fromkeys(MEASURES, ""), "status": "ok", "directory": "x"}
        | {"rms_error": 10.0 * v["arm.length"] + 50.0 * v["arm.radius"]}
        for n, v in enumerate(values)
    ]
    write_study(tmp_path, rows)
    page = write_page(tmp_path).read_text("utf-8")
    assert plan.scenario.title in page
    (measure,) = told(page)["measures"]
    # of a sum the indices are the shares of the variances, first and total alike
    of_length, of_radius = (10.0 * 0.2) ** 2, (50.0 * 0.01) ** 2
    share = of_length / (of_length + of_radius)
    for each, expected in zip(measure["effects"], (share, 1.0 - share), strict=True):
        assert each["share"] == pytest.approx(expected, abs=0.1)
        assert each["total"] == pytest.approx(expected, abs=0.1)
    (tmp_path / "plan.toml").write_text("version = 1", "utf-8")
    (measure,) = told(write_page(tmp_path).read_text("utf-8"))["measures"]
    assert measure["effects"]
    assert not any("total" in each for each in measure["effects"])


def test_a_study_of_which_nothing_is_known_has_a_page(tmp_path):
    nothing = dict.fromkeys(
        ("deflection", "steady_error", "rms_error", "rms_error_uncontrolled", "settling_time"), ""
    )
    write_study(tmp_path, [study_row(1, status="diverged at 3 s", **nothing)])
    page = write_page(tmp_path).read_text("utf-8")
    assert "study of 1 case" in page
    assert "1 of 1 cases did not reach their end" in page
    assert told(page)["views"] == []
    assert told(page)["measures"] == []


def test_what_a_table_holds_stays_text(tmp_path):
    plain = [study_row(1, status="ok"), study_row(2)]
    hostile = [
        study_row(
            1, case=HOSTILE, status=HOSTILE, directory="javascript:alert(1)", **{HOSTILE: HOSTILE}
        ),
        study_row(2, **{HOSTILE: "x"}),
    ]
    pages = []
    for rows, title in ((plain, "plain"), (hostile, HOSTILE)):
        write_study(tmp_path, rows)
        pages.append(study_page_of(read_cases(tmp_path / "cases.csv"), title, [None, None]))
    one, other = (Tags(page) for page in pages)
    assert [tag for tag, _ in one.tags if tag != "p"] == [
        tag for tag, _ in other.tags if tag != "p"
    ]
    assert told(pages[1])["names"][0] == HOSTILE
    folder = tmp_path / "javascript:alert(1)"
    save(swaying_arm(records=5), folder / "result.nc")
    write_report(tmp_path)
    address = told((tmp_path / "report.html").read_text("utf-8"))["pages"][0]
    assert address == "./javascript%3Aalert%281%29/report.html"


def test_a_page_of_others_is_not_replaced(tmp_path):
    grid(tmp_path)
    (tmp_path / "report.html").write_text("<p>mine</p>", encoding="utf-8")
    with pytest.raises(ReportError, match="not written by crinoid"):
        write_page(tmp_path)
    assert re.match("<p>mine", (tmp_path / "report.html").read_text("utf-8"))
