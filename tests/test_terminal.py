"""The command line: its output, and how soon it comes; no test here runs a simulation."""

import json
import os
import re
import subprocess
import sys
import warnings
from pathlib import Path

import pytest
import typer.testing

import crinoid
from crinoid.cli.app import app
from crinoid.cli.notes import notes_of_cases
from crinoid.cli.options import complete_key, complete_name
from crinoid.programs.room import _crowded
from crinoid.report import ReportError, write_report
from crinoid.scenario import Scenario
from made_results import Player, made_result

ODD = "a \\u001b[31mred\\u001b[0m [bold red]title[/] $x^$ :smile:"


@pytest.fixture
def call(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("crinoid.cli.attempt.play", Player())
    (tmp_path / "odd.toml").write_text(f'title = "{ODD}"\n[arm]\nnodes = 5\n')

    def called(*arguments: object) -> typer.testing.Result:
        runner = typer.testing.CliRunner(env={"COLUMNS": "200"})
        return runner.invoke(app, [str(argument) for argument in arguments])

    return called


def test_text_of_a_user_is_shown_as_it_is(call):
    ended = call("run", "odd.toml", "--out", "out\x1b]0;mine\x07")
    assert ended.exit_code == 0, ended.output
    shown = " ".join(re.sub(r"\x1b\[[0-9;]*m", "", ended.stdout).split())
    assert "\\x1b[31mred\\x1b[0m [bold red]title[/] $x^$ :smile:" in shown
    assert "wrote out\\x1b]0;mine\\x07/result.nc" in shown
    assert "\x1b[31m" not in ended.stdout
    refused = call("run", "no\x1b[2Jwhere\n.toml")
    assert refused.exit_code == 2
    assert "\x1b" not in refused.stderr
    assert len(refused.stderr.strip().splitlines()) == 1


def test_titles_are_no_formulas(tmp_path):
    for title in ("$x^$", r"$\foo$", "one $"):
        result = made_result(Scenario.from_toml(f"title = '{title}'\n[arm]\nnodes = 5\n"))
        result.dataset.attrs["status"] = f"failed at t = 1 s: {title}"
        result.save(tmp_path)
        with warnings.catch_warnings():
            warnings.simplefilter("error", UserWarning)
            assert write_report(tmp_path)


def test_scenarios_are_listed_in_two_columns(call):
    lines = call("scenarios").stdout.splitlines()
    starts = [re.match(r"[\w-]+ +", line) for line in lines]
    assert all(starts)
    assert len({start.end() for start in starts if start}) == 1


@pytest.mark.parametrize(
    ("command", "folder"),
    [("run", "SCENARIO"), ("equilibrium", "SCENARIO-equilibrium"), ("flow", "SCENARIO-flow")],
)
def test_help_names_the_folder(call, command, folder):
    assert f"results/{folder})" in call(command, "--help").stdout


def test_names_and_keys_are_completed():
    assert complete_name("station") == ["station-keeping", "station-keeping-3d"]
    assert "arm.length=" in complete_key("arm.")
    assert "flow.0.velocity=" in complete_key("flow.0.vel")
    assert "arm.section=" not in complete_key("arm.sec")  # a table, which takes no value
    assert complete_key("nothing") == []


def test_units_stand_where_editors_show_them(call):
    schema = json.loads(call("scenarios", "--schema").stdout)
    arm = schema["$defs"]["Arm"]["properties"]
    assert arm["length"]["description"] == "Length at rest. Unit: m."
    assert arm["nodes"]["description"].endswith("along the arm.")


def test_a_figure_that_cannot_be_written_is_one_line(call, monkeypatch):
    def refused(*_: object) -> None:
        raise ReportError("flow.png: cannot write the figure (Permission denied)")

    monkeypatch.setattr("crinoid.cli.finding.write_report", refused)
    monkeypatch.setattr("crinoid.cli.current.sample_current", lambda scenario: _current())
    flow = 'flow=[{kind="uniform", velocity=[0.1, 0.0]}]'
    ended = call("flow", "odd.toml", "--set", flow, "--out", "out")
    assert ended.exit_code == 2
    assert ended.stderr == "crinoid: flow.png: cannot write the figure (Permission denied)\n"
    assert os.listdir("out") == ["flow.nc"]


def _current():
    return made_result(Scenario()).dataset


def test_notes_of_cases_stand_once_with_their_cases():
    told = {
        "case-01": ["drag near 60", "touch of 1", "touch of 2"],
        "case-02": ["drag near 61.5"],
        "case-03": ["drag near 6e1", "fold"],
        "case-04": [],
        "case-05": ["drag near 60", "touch of 1"],
    }
    assert notes_of_cases(told) == [
        "case-01 to case-03, case-05 (numbers are those of case-01): drag near 60",
        "case-01, case-05: touch of 1",
        "case-01: touch of 2",
        "case-03: fold",
    ]
    many = {"case-01": [f"note {word}" for word in "abcdefgh"]}
    assert notes_of_cases(many)[6:] == ["2 more in the cases' results"]


def test_compiled_code_is_let_go_when_it_fills_the_memory_maps(monkeypatch):
    if not Path("/proc/self/maps").exists():
        assert not _crowded()
        return
    assert not _crowded()
    read = Path.read_bytes
    full = lambda path: b"\n" * 40_000 if str(path) == "/proc/self/maps" else read(path)  # noqa: E731
    monkeypatch.setattr(Path, "read_bytes", full)
    monkeypatch.setattr(Path, "read_text", lambda path: "65530\n")
    assert _crowded()


def test_what_computes_nothing_loads_nothing_that_computes():
    code = (
        "import contextlib, io, sys\n"
        "from crinoid.cli.app import app\n"
        "from crinoid.cli.options import complete_key, complete_name\n"
        "for arguments in (['--help'], ['--version'], ['scenarios'], ['run', 'nowhere'],\n"
        "                  ['run', 'still-water', '--set', 'arm.nodes=two'], ['run', '--help']):\n"
        "    with contextlib.redirect_stdout(io.StringIO()), contextlib.suppress(SystemExit):\n"
        "        app(arguments)\n"
        "assert complete_name('still') and complete_key('arm.')\n"
        "print(*{'jax', 'equinox', 'xarray', 'pandas', 'scipy', 'matplotlib'} & {*sys.modules})\n"
    )
    ended = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60
    )
    assert ended.stdout == "\n"
    assert "nowhere: no such file" in ended.stderr
    assert 'arm.nodes: got "two"' in ended.stderr


def test_the_package_is_there_at_once_and_computes_in_64_bits():
    assert {"Result", "Scenario", "load", "simulate", "equilibrium"} <= set(dir(crinoid))
    code = (
        "import sys, crinoid\n"
        "assert crinoid.load('still-water').title and 'jax' not in sys.modules\n"
        "from crinoid.cli.app import app\n"
        "assert 'jax' not in sys.modules and 'numpy' not in sys.modules\n"
        "import jax.numpy as jnp\n"
        "assert jnp.zeros(1).dtype == 'float64'\n"
    )
    plain = {name: value for name, value in os.environ.items() if not name.startswith("JAX")}
    subprocess.run([sys.executable, "-c", code], check=True, env=plain, timeout=60)
    with pytest.raises(AttributeError, match="nothing"):
        _ = crinoid.nothing
