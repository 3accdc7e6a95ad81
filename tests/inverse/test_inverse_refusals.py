"""Mistakes in estimates, fits, tunings and optimisations: one line each, and nothing is written."""

import pytest
import xarray as xr

from crinoid.results.report_error import ReportError
from crinoid.scenario import Scenario
from crinoid.view.figures import write_report
from helpers.command import assert_refused

ARM = Scenario(
    arm={"nodes": 5, "length": 0.4, "youngs_modulus": 4e5},
    base={"channels": {"tilt": {}}},
    tendon=[{"offset": [0.01, 0.004], "max_tension": 1.6, "angle_deg": each} for each in (0, 180)],
    sensor={"noise_position": 5e-4},
    simulation={"duration": 2.0, "time_step": 0.02},
)
TIP = "time,x,angle\n" + "".join(f"{0.02 * k:g},0.4,0.{k}\n" for k in range(9))
HOLDS = "hold,marker,x (mm),z,tendon_0 (N),tendon_1\na,low,1,-0.2,0.8,0\na,tip,2,-0.4,0.8,0\n"
EXPERIMENTS = """
[[marker]]
name = "low"
s = 0.15
offset = [0.0, 0.02]
[[experiment]]
file = "holds.csv"
"""

IDENTIFY, KEY = "identify arm.toml tip.csv --of", "arm.youngs_modulus"
FOR, OVER = "optimise arm.toml --for rms_error", "optimise arm.toml --over arm.length=0.4:0.6"
COMMANDS = {
    f"{IDENTIFY} arm.stiffness": "arm.stiffness: unknown key",
    f"{IDENTIFY} arm.nodes": "arm.nodes: got 5; must be a real number",
    f"{IDENTIFY} arm.section.EI": "arm.section.EI: has no initial value. Set one: --set",
    f"{IDENTIFY} arm.rest_curvature": "arm.rest_curvature: got 0; must be another number to start",
    f"{IDENTIFY} simulation.time_step": "simulation.time_step: is a setting of the computation",
    f"{IDENTIFY} tendon.0.offset": "tendon.0.offset.0, or all as one: tendon.0.offset.0.",
    f"{IDENTIFY} arm.length,arm.length": "--of: got arm.length twice; must name each parameter",
    f"{IDENTIFY} sensor.noise_position": "sensor.noise_position: does not affect the motion",
    f"{IDENTIFY} ,": "--of: got no key",
    f"identify arm.toml none.csv --of {KEY}": "RECORD: none.csv: no such file",
    "estimate arm.toml tip.csv --set target.frame='base'": "RECORD: got readings of the tip with",
    "estimate arm.toml tip.csv --set control.lqg.inputs=['tlit']": 'control.lqg.inputs: got "tlit"',
    f"{FOR} --over arm.length=0.6:0.4": "--over: got .* must be KEY=FROM:TO",
    f"{FOR} --over arm.length=-1:1:log": "have ends of one sign",
    f"{FOR} --over arm.length=-1:1": "arm.length: got -1.0; must be ",
    f"{FOR} --over arm.nodes=5:9": "arm.nodes: got 5; must be a real number",
    f"{FOR} --over arm.length=1:2 --over arm.length=1:3": "--over: got a key twice",
    f"{OVER} --for rms_eror": '--for: got "rms_eror"; must be a measure, such as rms_error',
    f"{OVER} --for settling_time --at-rest --set target.tip=[0.3,-10]": "settling_time is not a",
    f"{OVER} --for rms_error --keep max_error=1": "--keep: got",
    f"{OVER} --for rms_error --trials 0": "--trials: got 0; must be at least 1",
    f"{OVER} --for rms_error --seeds 0": "--seeds: got 0; must be at least 1",
    "tune arm.toml": 'control.kind: got "none"; must be "pid", "lqg" or "mpc"',
    "tune arm.toml --set control={'kind'='pid','pid'={'tilt'={}}}": "control.pid: has no gains",
    "tune station-keeping --set vary={'arm.length'=[1,2]}": "vary: a tuning is of one case",
    "tune station-keeping --seeds=0": "--seeds: got 0; must be at least 1",
    "tune station-keeping --iterations=0": "--iterations: got 0; must be at least 1",
    "tune station-keeping --margin=1": "--margin: got 1",
    "tune station-keeping --margin=nan": "--margin: got nan",
}
FILES = {
    ("tip.csv", f"identify arm.toml tip.csv --of {KEY}"): {
        "time,u\n0,1\n1,2\n": "RECORD: .*has time, u; must have time and some of x, z, angle",
        "x\n0\n1\n": "RECORD: .*no such column in tip.csv; it contains x",
        "time,x\n-3,1\n-2,2\n": "RECORD: .*ends at -2 s of the run; must have times after 0",
        "time,x\n0,1\n9,2\n": "RECORD: got 1 measured numbers within the run; must be more than 1",
        "time,x\n12,1\n13,2\n": "RECORD: got no row within the run, at times from 12 s on; must",
    },
    ("tip.csv", "estimate arm.toml tip.csv"): {
        "time\n0\n1\n": "RECORD: .*must have time and some",
        "time,x\n0,1\n0.01,2\n": "RECORD: .*must last at least two control periods, 0.04 s",
        "time,x\n0,\n0.5,\n1,\n": "RECORD: .*0 rows with a value; must have at least 2",
    },
    ("holds.csv", f"identify arm.toml all.toml --of {KEY}"): {
        HOLDS.replace("tendon_1", "tendon1"): "has a column tendon1; must be hold, marker or one",
        HOLDS.replace("-0.4,0.8", "-0.4,0.6"): "tendon_0 is 0.375 and 0.5 in hold a; must",
        HOLDS.replace("-0.4,0.8", "-0.4,"): "tendon_0 is nan and 0.5 in hold a; must be",
        HOLDS.replace("low", "ring"): 'got "ring"; must be "tip" or "low". A ..marker.. describes',
        HOLDS.replace("0.8", "1.8"): "tendon_0 is 1.125 of the largest in hold a; must be 0 to 1",
        HOLDS.replace("(N)", "(Pa)"): 'tendon_0 is in "Pa"; must be in a unit such as 1',
        HOLDS.replace("x (mm)", "u").replace(",z", ",v"): "must have hold and some of x, z",
    },
    ("all.toml", f"identify arm.toml all.toml --of {KEY},arm.density"): {
        EXPERIMENTS.replace("0.15", "0.5"): "marker.0.s: got 0.5; must be at most 0.4 .m., arm.le",
        EXPERIMENTS.replace("0.0, 0.02", "0.1"): "marker.0.offset: got .0.1.; must be .along",
        EXPERIMENTS.replace("holds", "none"): "experiment.0.file: ",
        EXPERIMENTS + '[[experiment]]\nfile = "holds.csv"\n': 'experiment.1.name: got "holds"',
        EXPERIMENTS + "set.arm.density = 1.0\n": "experiment.0.set.arm.density: is a number to",
        EXPERIMENTS + "set.arm.lengt = 1.0\n": "experiment.0.set.arm.lengt: unknown key; did you",
        "x": "all.toml: not valid TOML",
        "": "experiment: missing; must be",
    },
}


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "arm.toml").write_text(ARM.to_toml())
    (tmp_path / "tip.csv").write_text(TIP)
    (tmp_path / "holds.csv").write_text(HOLDS)
    (tmp_path / "all.toml").write_text(EXPERIMENTS)
    return tmp_path


@pytest.mark.parametrize("call", COMMANDS)
def test_a_mistake_in_a_command_is_one_line(here, call):
    assert_refused(call, ".*" + COMMANDS[call])


@pytest.mark.parametrize(
    ("name", "call", "text", "line"),
    [(*file, *each) for file, some in FILES.items() for each in some.items()],
)
def test_a_mistake_in_a_file_is_one_line(here, name, call, text, line):
    (here / name).write_text(text)
    assert_refused(call, ".*" + line)


@pytest.mark.parametrize(("name", "lacks"), {"tune": "tried", "identify": "given"}.items())
def test_a_broken_file_is_not_drawn(tmp_path, name, lacks):
    xr.Dataset({"a": ("b", [1.0])}).to_netcdf(tmp_path / f"{name}.nc")
    with pytest.raises(ReportError, match=f"it has no {lacks} over"):
        write_report(tmp_path / f"{name}.nc")
