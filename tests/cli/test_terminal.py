"""The output of the command line, and how little it loads; no test here runs a simulation."""

import os
import re
import subprocess
import sys
import warnings
from pathlib import Path

import pytest

import crinoid
from crinoid.cli.command import complete_key, complete_name
from crinoid.compilation import make_room
from crinoid.results.report_error import ReportError
from crinoid.scenario import Scenario
from crinoid.view.figures import write_report
from helpers.command import call, one_line, succeeded
from helpers.made_results import Player, made_result

ODD = "a \\u001b[31mred\\u001b[0m [bold red]title[/] $x^$ :smile:"


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")
    monkeypatch.setattr("crinoid.cli.run.play", Player())
    (tmp_path / "odd.toml").write_text(f'title = "{ODD}"\n[arm]\nnodes = 5\n')


def test_text_of_a_user_is_shown_unchanged():
    written = succeeded("run", "odd.toml", "--out", "out\x1b]0;mine\x07")
    shown = " ".join(re.sub(r"\x1b\[[0-9;]*m", "", written).split())
    assert "\\x1b[31mred\\x1b[0m [bold red]title[/] $x^$ :smile:" in shown
    assert "wrote out\\x1b]0;mine\\x07/result.nc" in shown
    assert "\x1b[31m" not in written
    assert "\x1b" not in one_line(call("run", "no\x1b[2Jwhere\n.toml"))


@pytest.mark.slow
def test_titles_are_no_formulas(tmp_path):
    for title in (r"$x^$ $\foo$", "one $"):
        result = made_result(Scenario.from_toml(f"title = '{title}'\n[arm]\nnodes = 5\n"))
        result.dataset.attrs["status"] = f"failed at t = 1 s: {title}"
        result.save(tmp_path)
        with warnings.catch_warnings():
            warnings.simplefilter("error", UserWarning)
            assert write_report(tmp_path)


def test_names_and_keys_are_completed():
    assert complete_name("station") == ["station-keeping", "station-keeping-3d"]
    assert "arm.length=" in complete_key("arm.")
    assert "flow.0.velocity=" in complete_key("flow.0.vel")
    assert "arm.section=" not in complete_key("arm.sec")  # a table, which takes no value
    assert complete_key("nothing") == []


def test_a_figure_that_cannot_be_written_is_one_line(monkeypatch):
    def refused(*_: object) -> None:
        raise ReportError("flow.png: cannot write the figure (Permission denied)")

    monkeypatch.setattr("crinoid.cli.finding.write_report", refused)
    current = made_result(Scenario()).dataset
    monkeypatch.setattr("crinoid.cli.analyses.sample_current", lambda scenario: current)
    monkeypatch.setattr("crinoid.cli.analyses._current_table", lambda data: None)
    flow = 'flow=[{kind="uniform", velocity=[0.1, 0.0]}]'
    line = one_line(call("flow", "odd.toml", "--set", flow, "--out", "out"))
    assert line == "crinoid: flow.png: cannot write the figure (Permission denied)"
    assert os.listdir("out") == ["flow.nc"]


def test_compiled_code_is_freed_when_it_fills_the_memory_maps(monkeypatch):
    freed = []
    monkeypatch.setattr("crinoid.compilation.program.free_memory", lambda: freed.append(1))
    make_room()
    assert not freed
    if not Path("/proc/self/maps").exists():
        return
    read = Path.read_bytes
    full = lambda path: b"\n" * 40_000 if str(path) == "/proc/self/maps" else read(path)  # noqa: E731
    monkeypatch.setattr(Path, "read_bytes", full)
    monkeypatch.setattr(Path, "read_text", lambda path: "65530\n")
    make_room()
    assert freed


def test_commands_that_compute_nothing_load_no_numerics():
    code = (
        "import contextlib, io, sys\n"
        "from crinoid.cli.app import app\n"
        "from crinoid.cli.command import Terminal, complete_key, complete_name\n"
        "for arguments in (['--help'], ['--version'], ['scenarios'], ['run', 'nowhere'],\n"
        "                  ['run', 'still-water', '--set', 'arm.nodes=two'], ['run', '--help']):\n"
        "    with contextlib.redirect_stdout(io.StringIO()), contextlib.suppress(SystemExit):\n"
        "        app(arguments)\n"
        "assert complete_name('still') and complete_key('arm.')\n"
        "print(*{'jax', 'equinox', 'xarray', 'pandas', 'scipy', 'matplotlib'} & {*sys.modules})\n"
    )
    how = {"capture_output": True, "text": True, "check": True, "timeout": 60}
    ended = subprocess.run([sys.executable, "-c", code], **how)
    assert ended.stdout == "\n"
    assert "nowhere: no such file" in ended.stderr
    assert 'arm.nodes: got "two"' in ended.stderr


def test_the_package_loads_lazily_and_computes_in_64_bits():
    code = (
        "import sys, crinoid\n"
        "assert crinoid.load('still-water').title and 'jax' not in sys.modules\n"
        "import jax.numpy as jnp\n"
        "assert jnp.zeros(1).dtype == 'float64'\n"
    )
    plain = {name: value for name, value in os.environ.items() if not name.startswith("JAX")}
    subprocess.run([sys.executable, "-c", code], check=True, env=plain, timeout=60)
    with pytest.raises(AttributeError, match="nothing"):
        _ = crinoid.nothing
