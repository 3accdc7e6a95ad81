"""The page of a study: what it holds of the cases, and that text stays text."""

import json

import numpy as np
import pytest
from bokeh.document import Document
from scipy import stats

from crinoid.results.units import Unit
from crinoid.scenario.library import load
from crinoid.studies.statistics import means_of
from crinoid.studies.sweep.plan import SweepDesign
from crinoid.view.figures import study as charts
from crinoid.view.figures import write_means, write_page, write_report
from crinoid.view.figures.study import Study, effects_of, key_of, study_of
from crinoid.view.page.study import MOST_CASES, study_page_of
from crinoid.view.page.sweeps import BAND_CASES, bands_of
from helpers.figures import assert_shows_something
from helpers.pages import HOSTILE, Tags
from helpers.planar_result import swaying_arm
from helpers.studies import COLUMNS, grid, save, study_of_rows, study_row, write_study


def told(page):
    return json.loads(Tags(page).texts["table"])


def test_levels_sort_as_numbers_and_stay_words():
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
    mean, (low, high) = means_of(values, place, 6).value, bands_of(values, place, 6)
    for at in range(6):
        some = values[(place == at) & np.isfinite(values)]
        expected = np.full(3, np.nan)
        if some.size:
            expected[0] = some.mean()
        if some.size >= BAND_CASES:
            expected[1:] = np.quantile(some, [0.05, 0.95])
        np.testing.assert_allclose([mean[at], low[at], high[at]], expected)


def test_a_grid_is_shown_in_cells_and_scattered_numbers_as_points(tmp_path):
    study = study_of(grid(tmp_path))
    (pair, first, second) = study.views()
    assert [key.name for key in pair] == ["arm.youngs_modulus", "control.kind"]
    assert charts.gridded(pair)
    assert (first, second) == ((pair[0],), (pair[1],))
    rng = np.random.default_rng(0)
    drawn = [study_row(n, **{"flow.0.velocity": rng.random()}) for n in range(1, 12)]
    (scattered, *_) = study_of(study_of_rows(tmp_path, drawn)).views()
    assert not charts.gridded(scattered)


def effects(keys, values):
    """Return the effects of keys, each a text for every case, on a measure of the cases."""
    study = Study([""] * len(values), ["ok"] * len(values), keys, [])
    return {
        e.key.name: e
        for e in effects_of(study, charts.StudyMeasure("y", "y", Unit(1.0, "m"), values))
    }


def test_shares_of_the_variance_are_the_indices_of_known_functions():
    """Here Ishigami's function (1990), and a sum on a grid, whose shares add up to one."""
    x = np.random.default_rng(0).uniform(-np.pi, np.pi, (3000, 3))
    y = 100.0 + np.sin(x[:, 0]) + 7 * np.sin(x[:, 1]) ** 2 + 0.1 * x[:, 2] ** 4 * np.sin(x[:, 0])
    found = effects([key_of(f"x{i}", [repr(v) for v in x[:, i].tolist()]) for i in range(3)], y)
    for name, index in (("x0", 0.3139), ("x1", 0.4424), ("x2", 0.0)):
        assert found[name].share == pytest.approx(index, abs=0.04)
        assert found[name].low - 0.03 <= index <= found[name].high + 0.03
        assert found[name].high - found[name].low < 0.1
    rows = [(a, b, n) for a in range(4) for b in range(3) for n in range(6)]
    sums = np.array([1.0 * a + 2.0 * b for a, b, _ in rows])
    found = effects([key_of(str(i), [str(row[i]) for row in rows]) for i in range(3)], sums)
    of_a, of_b = np.var(np.arange(4)), np.var(2.0 * np.arange(3))
    expected = {"0": of_a / (of_a + of_b), "1": of_b / (of_a + of_b), "2": 0.0}
    assert {name: e.share for name, e in found.items()} == pytest.approx(expected, abs=1e-9)


def test_seeds_alone_have_no_share_of_the_variance():
    values = np.random.default_rng(0).normal(size=60)
    seeds = key_of("seed", [str(n) for n in range(60)])
    assert effects([seeds], values) == {}
    assert set(effects([seeds, key_of("a", ["1", "2"] * 30)], values)) == {"seed", "a"}


def test_keys_that_never_repeat_have_no_share(tmp_path):
    study = study_of(study_of_rows(tmp_path, [study_row(n) for n in range(1, 6)]))
    assert [effects_of(study, each) for each in study.measures] == [[]] * 5
    assert effects([key_of("a", ["1", "2"] * 30)], np.full(60, 2.0)) == {}


def test_the_page_holds_the_numbers_of_the_table(tmp_path):
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
    (drawn,) = Tags(page).attributes("polyline")
    assert drawn["data-case"] == "1"
    assert "Station keeping" in page  # the title of the scenario


def test_cells_and_lines_hold_means(tmp_path):
    cases = grid(tmp_path)
    views = told(study_page_of(cases, "", [None] * len(cases)))["views"]
    cells, line, _ = (Document.from_json(each["document"]) for each in views)
    drawn = cells.roots[0].select_one({"name": "cells"}).data_source.data
    mean = {(x, y): v for x, y, v in zip(drawn["x"], drawn["y"], drawn["rms_error"], strict=True)}
    assert mean == pytest.approx({(k // 2, k % 2): 6.0 * (k + 1) for k in range(6)})
    drawn = line.roots[0].select_one({"name": "line"}).data_source.data
    np.testing.assert_allclose(drawn["x"], [1e5, 2e5, 4e5])
    np.testing.assert_allclose(drawn["rms_error"], [9.0, 21.0, 33.0])
    assert np.isnan(drawn["rms_error low"]).all()


def test_cells_of_several_seeds_have_intervals(tmp_path):
    keys = ("arm.youngs_modulus", "arm.length", "seed")
    levels = [(a, b, n) for a in (1e5, 2e6) for b in (0.3, 0.5) for n in range(3)]
    rows = [study_row(n, **dict(zip(keys, each, strict=True))) for n, each in enumerate(levels, 1)]
    for row in rows:
        del row["flow.0.velocity"]
    cases = study_of_rows(tmp_path, rows)
    found = told(study_page_of(cases, "", [None] * len(cases)))
    plot = Document.from_json(found["views"][0]["document"]).roots[0]
    drawn = plot.select_one({"name": "cells"}).data_source.data
    expected = stats.ttest_1samp([6.0, 12.0, 18.0], 0.0).confidence_interval()
    assert drawn["rms_error half"][0] == pytest.approx((expected.high - expected.low) / 2)
    (figure,) = write_means(tmp_path)
    assert_shows_something(figure)
    write_study(tmp_path, rows[:9:3])  # neither seeds nor all combinations
    assert write_means(tmp_path) == []


@pytest.mark.slow
def test_many_cases_are_thinned_and_the_page_says_so(tmp_path):
    rng, count = np.random.default_rng(0), 3 * MOST_CASES
    keys = ("arm.youngs_modulus", "flow.0.velocity")
    rows = [study_row(n, **{key: rng.random() for key in keys}) for n in range(1, count + 1)]
    page = study_page_of(study_of_rows(tmp_path, rows), "", [None] * count)
    assert len(page.encode()) < 3e6
    assert f"The page contains {MOST_CASES} of {count} cases, evenly chosen." in page
    assert len(told(page)["names"]) == MOST_CASES


def test_the_page_of_a_sweep_has_the_indices_of_its_plan(tmp_path):
    pytest.importorskip("SALib", reason="needs SALib")
    spans = ["arm.length=0.4:0.6", "arm.radius=0.01:0.02"]
    plan = SweepDesign.of(load("still-water"), spans, sampling="saltelli", count=64)
    (tmp_path / "plan.toml").write_text(plan.to_toml(), "utf-8")
    values = [plan.values(run) for run in range(1, plan.runs + 1)]
    rows = [
        {"case": f"case-{n}", **v, **dict.fromkeys(COLUMNS, ""), "status": "ok", "directory": "x"}
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


def test_keys_of_weighted_rows_vary_together_and_have_no_share(tmp_path):
    spots = {"arm.length": [0.4, 0.5, 0.6] * 20, "arm.radius": [0.01, 0.02, 0.03] * 20}
    plan = SweepDesign.of(load("still-water"), [], rows=spots)
    (tmp_path / "plan.toml").write_text(plan.to_toml(), "utf-8")
    rows = [
        study_row(n, **(values := plan.values(n))) | {"rms_error": values["arm.length"]}
        for n in range(1, plan.runs + 1)
    ]
    (measure, *_) = told(study_page_of(study_of_rows(tmp_path, rows), "", [None] * 60))["measures"]
    assert measure["effects"]
    write_study(tmp_path, rows)
    (measure, *_) = told(write_page(tmp_path).read_text("utf-8"))["measures"]
    assert not measure["effects"]


def test_a_study_of_which_nothing_is_known_has_a_page(tmp_path):
    write_study(tmp_path, [study_row(1, status="diverged at 3 s", **dict.fromkeys(COLUMNS, ""))])
    (page,) = write_report(tmp_path)
    assert page == tmp_path / "report.html"
    text = page.read_text("utf-8")
    assert "study of 1 case" in text
    assert "1 of 1 cases failed or did not reach their end" in text
    assert (told(text)["views"], told(text)["measures"]) == ([], [])


@pytest.mark.slow
def test_words_in_a_table_stay_text(tmp_path):
    plain = [study_row(1, status="ok"), study_row(2)]
    odd = {"case": HOSTILE, "status": HOSTILE, "directory": "javascript:alert(1)", HOSTILE: HOSTILE}
    hostile = [study_row(1, **odd), study_row(2, **{HOSTILE: "x"})]
    pages = [
        study_page_of(study_of_rows(tmp_path, rows), title, [None, None])
        for rows, title in ((plain, "plain"), (hostile, HOSTILE))
    ]
    one, other = ([tag for tag, _ in Tags(page).tags if tag != "p"] for page in pages)
    assert one == other
    assert told(pages[1])["names"][0] == HOSTILE
    save(swaying_arm(records=5), tmp_path / "javascript:alert(1)" / "result.nc")
    write_report(tmp_path)
    address = told((tmp_path / "report.html").read_text("utf-8"))["pages"][0]
    assert address == "./javascript%3Aalert%281%29/report.html"
