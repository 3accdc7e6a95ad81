"""Pages in a browser from what commands write: all of their charts, tables and choices."""

from pathlib import Path

import pytest

from helpers.browsing import Opened
from helpers.command import SMALL, call, succeeded

BROKEN = ("NaN", "undefined", "Infinity", "[object")
"""Words of a script that shows what is not there."""


@pytest.fixture
def here(tmp_path, monkeypatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "small.toml").write_text(SMALL.to_toml())
    return tmp_path


class Looked(Opened):
    """A page of which each choice is tried."""

    def __init__(self, browser, path, rows):
        super().__init__(browser, path.as_uri(), "html[data-ready=yes]", reduced_motion="reduce")
        for select in self.page.locator("select:visible").all():
            values = select.evaluate("(e) => [...e.options].map((each) => each.value)")
            assert values
            for value in values:
                select.select_option(value)
        for row in self.page.locator("tbody tr").all()[:3]:
            row.hover()
        assert self.complaints == []
        assert self.requests == [path.as_uri()]
        assert self.page.locator("tbody tr:visible").count() >= rows
        text = self.page.inner_text("body")
        assert not [word for word in BROKEN if word in text]


def look_at_study(browser, folder, cases, measured=True):
    with Looked(browser, folder / "report.html", cases) as opened:
        assert opened.page.locator("#cases tbody tr").count() == cases
        charts = opened.page.locator("#plot canvas:visible").count()
        assert (charts > 0) == measured
        if measured:
            assert opened.ask("() => crinoid.where(0).every(Number.isFinite)")


def look_at_run(browser, folder, rows=6, charts=5):
    with Looked(browser, folder / "report.html", rows) as opened:
        drawn = "() => document.querySelector('.stage').classList.contains('drawn')"
        assert opened.ask(drawn)
        for folded in opened.page.get_by_text("All numbers").all():
            folded.click()
            assert opened.page.locator("tbody tr:visible").count() >= rows + 15
        begin, end = opened.ask("() => [crinoid.begin, crinoid.end]")
        for share in (0.0, 0.37, 1.0):
            opened.ask("(time) => crinoid.go(time)", begin + share * (end - begin))
        panels = opened.page.locator(".panel .plot")
        assert panels.count() >= charts
        assert all(each.locator("canvas").count() for each in panels.all())
        assert opened.complaints == []


@pytest.mark.slow
def test_the_pages_of_a_study_and_of_its_runs(browser, here):
    varied = ("--set", 'vary={"arm.length"=[0.4, 0.5, 0.6]}')
    succeeded("run", "small.toml", *varied, "--out", "out")
    look_at_study(browser, here / "out", 3)
    look_at_run(browser, here / "out" / "case-02")


@pytest.mark.release
@pytest.mark.parametrize(
    ("words", "cases"),
    [
        ("--seeds 20", 20),
        ("--vary arm.length=0.4:0.6:3", 3),
        ("--vary arm.length=0.4:0.6:3 --vary water.drag_normal=1:2:2 --seeds 2", 12),
        ("--vary arm.length=0.4:0.6 --vary arm.radius=0.01:0.02 --sample lhs --count 5", 5),
        ("--vary control.kind=none,pid", 2),
    ],
)
def test_the_page_of_a_sweep_and_of_a_case_played_again(browser, here, words, cases):
    succeeded("sweep", "small.toml", *words.split(), "--out", "out", "--workers", 1)
    look_at_study(browser, here / "out", cases)
    if "--seeds 20" in words:
        succeeded("run", "--case", "out", 2)
        look_at_run(browser, here / "out" / "case-02")
    (here / "out" / "report.html").unlink()
    succeeded("report", "out")
    look_at_study(browser, here / "out", cases)


@pytest.mark.release
def test_the_page_of_a_study_whose_runs_all_failed(browser, here):
    never = ("--set", "simulation.max_iterations=1", "--set", "simulation.max_halvings=0")
    strict = ("--set", "simulation.tolerance=1e-15", "--set", "simulation.start=rest")
    ended = call("sweep", "small.toml", *never, *strict, "--seeds", 2, "--out", "out")
    assert ended.exit_code == 3, ended.output
    look_at_study(browser, here / "out", 2, measured=False)


@pytest.mark.release
@pytest.mark.parametrize(
    ("scenario", "settings"),
    [
        ("small.toml", ()),
        ("coral-touch", ()),
        ("station-keeping", ("control.kind=lqg", "water.vortices={}")),
        ("floating-3d", ()),
    ],
)
def test_the_page_of_a_run_and_of_its_report(browser, here, scenario, settings):
    given = ("arm.nodes=5", "simulation.duration=0.2", *settings)
    words = [scenario, *(word for each in given for word in ("--set", each))]
    succeeded("run", *words, "--out", "run")
    look_at_run(browser, here / "run")
    (here / "run" / "report.html").unlink()
    succeeded("report", "run")
    look_at_run(browser, here / "run")


@pytest.mark.release
def test_the_page_of_an_equilibrium(browser, here):
    succeeded("equilibrium", "small.toml", "--out", "rest")
    succeeded("report", "rest")
    look_at_run(browser, here / "rest", rows=5, charts=0)
