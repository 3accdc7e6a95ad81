"""Mistakes in analyses: one line each, and nothing is written or replaced."""

import pytest
import xarray as xr

from crinoid.results.report_error import ReportError
from crinoid.scenario import Scenario
from crinoid.view.figures import write_report
from helpers.command import assert_refused, refused, succeeded

ARM = Scenario(
    arm={"nodes": 6},
    chamber=[{"area": 1e-4, "offset": 0.01, "max_pressure": 5e4}],
    flow=[{"kind": "uniform", "velocity": [0.2, 0.1]}],
    simulation={"duration": 0.5},
)
CURVE, MEASURED = "equilibrium arm.toml --vary", "{'kind'='measured','file'='none.nc'}"
COMMANDS = {
    f"{CURVE} arm.length=0:1:3": "arm.length: got 0.0; must be a number above 0 .m.",
    f"{CURVE} arm.length=1:2": "--vary: .*must have a count, arm.length=FROM:TO:COUNT",
    f"{CURVE} arm.length=1,long": "--vary: .*must have numbers as values",
    f"{CURVE} arm.length=1,1": "--vary: .*must have 2 or more different values",
    f"{CURVE} arm.length=1:2:99999": "--vary: .*must have a count of at most 10000",
    f"{CURVE} chamber.0.pressure=0:6e4:3": "chamber.0.pressure: got 60000.0; must be 0 to",
    f"{CURVE} arm.length=1:2:3 --vary arm.radius=1:2:3": "--vary: got 2 keys; must name one",
    "flow arm.toml --set vary.seed=[1,2]": "vary: a current is of one case",
    f"flow arm.toml --set flow=[{MEASURED}]": "flow.0.file: .*none.nc: no such file",
    "flow pier.csv --set arm.length=0.5": "--set: .*must be water.depth or, of flow.0",
    "flow pier.csv --set flow.0.skip=3": "--set: got",
    "linearise arm.toml --to csv": '--to: got "csv"; must be "npz", "mat" or "json"',
    "margins arm.toml": 'control.kind: got "none"; must be a controller, such as "pid"',
    "modes arm.toml --count 0": "--count: got 0; must be at least 1",
    "modes arm.toml --set vary.seed=[1,2]": "vary: a mode is of one case",
}


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "arm.toml").write_text(ARM.to_toml())
    (tmp_path / "pier.csv").write_text("time (s),u (m/s),w (m/s)\n0,1,0\n1,2,0\n2,1,0\n3,2,0\n")
    return tmp_path


@pytest.mark.parametrize("call", COMMANDS)
def test_a_mistake_is_one_line_and_nothing_is_written(here, call):
    assert_refused(call, COMMANDS[call])


OTHERS = {
    "flow arm.toml": "flow.nc",
    "flow pier.csv": "histogram.csv",
    f"{CURVE} chamber.0.pressure=0:5e4:3": "curve.csv",
    "linearise arm.toml --to json": "linear-model.json",
}


@pytest.mark.parametrize("call", OTHERS)
def test_a_file_of_others_is_not_replaced_unless_forced(here, call):
    file, command = here / "out" / OTHERS[call], (*call.split(), "--out", "out")
    file.parent.mkdir()
    file.write_text("mine")
    assert f"--out: out/{file.name} was not written by crinoid" in refused(*command)
    assert [path.read_text() for path in file.parent.iterdir()] == ["mine"]
    if call.startswith("flow"):  # the others are slow
        for again in (("--force",), ()):  # what it wrote itself it replaces
            succeeded(*command, *again)


@pytest.mark.parametrize(
    ("name", "lacks"),
    {"flow": "flow_velocity", "margins": "locus_real", "modes": "frequency"}.items(),
)
def test_a_broken_file_is_not_drawn(tmp_path, name, lacks):
    xr.Dataset({"a": ("b", [1.0])}).to_netcdf(tmp_path / f"{name}.nc")
    with pytest.raises(ReportError, match=f"it has no {lacks}"):
        write_report(tmp_path / f"{name}.nc")
