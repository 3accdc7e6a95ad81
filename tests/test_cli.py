import json
import signal
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner, Result

from crinoid.cli.app import app
from made_results import case_rows

SMALL = """
title = "small"
[arm]
nodes = 5
youngs_modulus = 5e5
[base.channels.tilt]
[[flow]]
kind = "uniform"
velocity = [0.2, 0.1]
ramp_time = 0.1
[control]
kind = "pid"
[control.pid.tilt]
kp = 0.5
[simulation]
duration = 0.2
"""

MISTAKES = [
    ("[arm]\nlenght = 1.0", "arm.lenght"),
    ('[arm]\nlength = "long"', "arm.length"),
    ("[arm]\nlength = nan", "arm.length"),
    ("[arm]\nlength = -1.0", "arm.length"),
    ("[arm]\nnodes = 2", "arm.nodes"),
    ("[base]\nposition = [0.0, 0.0, 0.0]", "base.position"),
    ('[[flow]]\nkind = "magic"', "flow.0.kind"),
    ("[arm\nlength = 1.0", "line 1"),
    ("[simulation]\ntime_step = 0.0", "simulation.time_step"),
    ("[arm]\ndimension = 4", "arm.dimension"),
]


def call(*arguments: object) -> Result:
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


@pytest.fixture
def here(tmp_path, monkeypatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "small.toml").write_text(SMALL)
    return tmp_path


@pytest.mark.parametrize(("text", "named"), MISTAKES, ids=[named for _, named in MISTAKES])
def test_a_mistake_gets_one_line_exit_2_and_nothing_written(here, text, named):
    (here / "bad.toml").write_text(text)
    before = sorted(here.rglob("*"))
    for command in ("run", "equilibrium"):
        ended = call(command, "bad.toml")
        assert ended.exit_code == 2
        assert len(ended.stderr.strip().splitlines()) == 1
        assert named in ended.stderr
        assert ended.stdout == ""
    assert sorted(here.rglob("*")) == before


def test_a_missing_file_and_a_bad_setting_are_mistakes_too(here):
    missing = call("run", "nowhere.toml")
    assert missing.exit_code == 2
    assert "nowhere.toml" in missing.stderr
    setting = call("run", "small.toml", "--set", "arm.radius=-1")
    assert setting.exit_code == 2
    assert "arm.radius" in setting.stderr
    file = call("run", "small.toml", "--out", "small.toml")
    assert file.exit_code == 2
    assert "small.toml" in file.stderr
    assert sorted(path.name for path in here.iterdir()) == ["small.toml"]


def test_run_saves_and_report_draws(here):
    ended = call("run", "small.toml", "--set", "simulation.duration=0.3")
    assert ended.exit_code == 0, ended.output
    for word in ("small", "tip error, RMS", "uncontrolled", "Newton iterations"):
        assert word in ended.stdout
    folder = here / "results" / "small"
    with xr.open_dataset(folder / "result.nc") as dataset:
        assert float(dataset["time"][-1]) == pytest.approx(0.3)
        assert dataset.attrs["status"] == "ok"
    drawn = call("report", folder)
    assert drawn.exit_code == 0, drawn.output
    assert (folder / "shape.png").stat().st_size > 10_000


def test_equilibrium_is_a_result_with_one_time(here):
    ended = call("equilibrium", "small.toml", "--out", "still")
    assert ended.exit_code == 0, ended.output
    with xr.open_dataset(here / "still" / "result.nc") as dataset:
        assert dataset.sizes["time"] == 1
        assert np.abs(dataset["velocity"].values).max() == 0.0
        # at rest the submarine carries what the water and gravity do: weight in water and drag
        assert float(dataset["base_force"].sel(axis="z")[0]) < 0
    assert call("report", here / "still").exit_code == 0


def test_notes_stand_under_the_table_and_of_cases_each_one_once(here):
    # a thread in slow water: its drag is outside the range of the default coefficient
    thin = ("--set", "arm.radius=5e-4", "--set", "arm.youngs_modulus=1e9")
    ended = call("run", "small.toml", *thin)
    assert ended.exit_code == 0, ended.output
    noted = [line for line in ended.stdout.splitlines() if line.startswith("note: ")]
    assert len(noted) == 2
    assert noted[0].startswith("note: most of the drag acts at Reynolds numbers near")
    assert noted[1].startswith("note: without control: most of the drag acts")
    with xr.open_dataset(here / "results" / "small" / "result.nc") as dataset:
        assert [f"note: {line}" for line in dataset.attrs["notes"].splitlines()] == noted[:1]
    studied = ("--set", "vary.seed=[1, 2]", "--set", "control.compare=false", "--out", "cases")
    above = ("--set", "base.position=[0.0, 10.0]")
    ended = call("run", "small.toml", *thin, *studied, *above)
    assert ended.exit_code == 0, ended.output
    lines = ended.stdout.splitlines()
    noted = [line for line in lines if line.startswith("note: ")]
    assert len(noted) == 2
    # what is odd about a scenario is told before it is run, and only then
    assert lines[0] == noted[0]
    assert noted[0].startswith("note: case-01, case-02: base.position.1: got 10 m, above the")
    assert noted[1].startswith("note: case-01, case-02: most of the drag")
    with xr.open_dataset(here / "cases" / "case-02" / "result.nc") as dataset:
        assert dataset.attrs["notes"].startswith("base.position.1: got 10 m")


def test_an_equilibrium_and_a_current_tell_what_is_odd_first(here):
    odd = ("--set", "flow.0.velocity=[6.0, 0.0]", "--set", "control.start=9")
    for command in ("equilibrium", "flow"):
        ended = call(command, "small.toml", *odd, "--out", command)
        assert ended.exit_code == 0, ended.output
        lines = ended.stdout.splitlines()
        noted = [line for line in lines if line.startswith("note: ")]
        assert lines[0] == noted[0]
        assert noted[0].startswith("note: flow.0.velocity: got [6.0, 0.0] m/s; usual is up to 5")
        assert not any("control.start" in line for line in noted)
        assert len(set(noted)) == len(noted)


def test_cases_become_a_table_and_a_folder_each(here):
    (here / "small.toml").write_text(
        SMALL + '[vary]\n"flow.0.velocity" = [[0.1, 0.1], [0.3, 0.2]]\n'
    )
    ended = call("run", "small.toml", "--out", "cases")
    assert ended.exit_code == 0, ended.output
    rows = case_rows(here / "cases")
    assert [row["case"] for row in rows] == ["case-01", "case-02"]
    assert float(rows[1]["rms_error_uncontrolled"]) > float(rows[0]["rms_error_uncontrolled"])
    for row in rows:
        assert (here / "cases" / row["directory"] / "result.nc").exists()
    assert call("report", "cases").exit_code == 0
    assert (here / "cases" / "cases.png").exists()
    refused = call("equilibrium", "small.toml")
    assert refused.exit_code == 2
    assert "vary" in refused.stderr


def test_resume_refuses_another_scenario_and_extends_the_same(here):
    assert call("run", "small.toml", "--out", "r").exit_code == 0
    other = call("run", "small.toml", "--out", "r", "--resume", "--set", "arm.length=0.7")
    assert other.exit_code == 2
    assert "--resume" in other.stderr
    longer = call("run", "small.toml", "--out", "r", "--resume", "--set", "simulation.duration=0.4")
    assert longer.exit_code == 0, longer.output
    with xr.open_dataset(here / "r" / "result.nc") as dataset:
        np.testing.assert_allclose(dataset["time"], 0.02 * np.arange(21), atol=1e-12)


def test_a_run_that_fails_says_when_where_and_what_to_try_and_saves(here):
    ended = call(
        *("run", "small.toml", "--out", "failed"),
        *("--set", "simulation.max_iterations=1", "--set", "simulation.max_halvings=0"),
        *("--set", "flow.0.velocity=[6.0, 0.0]", "--set", 'simulation.start="rest"'),
        *("--set", "control.compare=false", "--set", "base.tilt_deg=-60"),
    )
    assert ended.exit_code == 3, ended.output
    line = ended.stderr.strip()
    for word in ("failed at t =", "node", "N", "simulation.time_step"):
        assert word in line
    with xr.open_dataset(here / "failed" / "result.nc") as dataset:
        assert dataset.attrs["status"].startswith("failed at t =")


def test_scenarios_are_listed_copied_and_described(here):
    listed = call("scenarios")
    for name in ("still-water", "constant-load", "station-keeping"):
        assert name in listed.stdout
    assert call("scenarios", "--copy", "station-keeping").exit_code == 0
    assert "[control.pid.tilt]" in (here / "station-keeping.toml").read_text()
    again = call("scenarios", "--copy", "station-keeping")
    assert again.exit_code == 2
    assert "already there" in again.stderr
    unknown = call("scenarios", "--copy", "station-keepin")
    assert unknown.exit_code == 2
    assert "station-keeping" in unknown.stderr
    schema = json.loads(call("scenarios", "--schema").stdout)
    assert schema["properties"]["arm"]


def test_report_of_nothing_is_a_mistake(here):
    ended = call("report", "nowhere")
    assert ended.exit_code == 2
    assert "nowhere" in ended.stderr


def test_ctrl_c_saves_and_resume_finishes_the_same_run(here, monkeypatch):
    arguments = ("run", "small.toml", "--set", "simulation.duration=20")
    with monkeypatch.context() as patched:
        # a terminal's Ctrl-C, sent when the first chunk has been reported
        interrupt = lambda bar, prefix: lambda reached: signal.raise_signal(signal.SIGINT)  # noqa: E731
        patched.setattr("crinoid.cli.play.reporter", interrupt)
        ended = call(*arguments, "--out", "stopped")
    assert ended.exit_code == 130
    assert "interrupted at t =" in ended.stderr
    assert "--resume" in ended.stderr
    with xr.open_dataset(here / "stopped" / "result.nc") as dataset:
        assert dataset.attrs["status"].startswith("interrupted at t = ")
        assert 0 < float(dataset["time"][-1]) < 20
    # what went on from there is the same as what was never interrupted
    assert call(*arguments, "--out", "stopped", "--resume").exit_code == 0
    assert call(*arguments, "--out", "whole").exit_code == 0
    for name in ("result.nc", "uncontrolled.nc"):
        with (
            xr.open_dataset(here / "stopped" / name) as mine,
            xr.open_dataset(here / "whole" / name) as other,
        ):
            np.testing.assert_array_equal(mine["time"], other["time"])
            np.testing.assert_array_equal(mine["position"], other["position"])
            assert mine.attrs["status"] == "ok"
