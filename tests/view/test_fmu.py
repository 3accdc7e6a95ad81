"""FMUs as FMPy reads and runs them, next to a session."""

import shutil
import sys
import zipfile

import fmpy
import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from fmpy.simulation import instantiate_fmu
from fmpy.validation import validate_fmu

from crinoid import Scenario, Session
from crinoid.results.own_files import is_own
from crinoid.scenario import load
from crinoid.scenario.library import builtin_files, builtin_text
from crinoid.view.export.fmu import write_fmu
from helpers.command import succeeded

PLANE = ["arm.nodes=6", "simulation.duration=0.1", "simulation.max_halvings=1", "flow.1.modes=8"]
SPACE = """
[arm]
dimension = 3
length = 0.4
nodes = 4
radius = 0.015
density = 1080.0
youngs_modulus = 4e6
[base.channels.sway]
range = [-0.3, 0.3]
[control]
start = 0.05
[simulation]
duration = 0.1
time_step = 0.01
"""
RECORD = "t,u,w\n0,0.1,0\n100,0.2,0\n"
FLOW = '\n[[flow]]\nkind = "measured"\nfile = "record.csv"\nvelocity = ["u", "w"]\ntime = "t"\n'


@pytest.fixture(autouse=True)
def paths(monkeypatch):
    """Forget the folders that an FMU adds to the paths of modules."""
    monkeypatch.setattr(sys, "path", [*sys.path])


@pytest.fixture(scope="module")
def planar(tmp_path_factory):
    return write_fmu(load("station-keeping", PLANE), tmp_path_factory.mktemp("plane"), "arm-2d")


class Slave:
    """An FMU in this process, with its variables by name; its log goes to ``log``."""

    def __init__(self, path, folder, log):
        about = fmpy.read_model_description(path)
        self.references = {each.name: each.valueReference for each in about.modelVariables}

        def keep(_, status, category, message):
            log.append(message.decode())

        unzipped = fmpy.extract(path, folder)
        self.unit = instantiate_fmu(unzipped, about, "CoSimulation", logger=keep)

    def set(self, **values):
        for name, value in values.items():
            self.unit.setFloat64([self.references[name.replace("__", ".")]], [value])

    def start(self):
        self.unit.enterInitializationMode()
        self.unit.exitInitializationMode()

    def get(self, *names):
        return self.unit.getFloat64([self.references[name] for name in names])

    def step(self, time, step):
        self.unit.doStep(currentCommunicationPoint=time, communicationStepSize=step)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["plane", pytest.param("space", marks=pytest.mark.slow)])
def test_fmpy_runs_what_a_session_runs(name, planar, tmp_path):
    if name == "plane":
        path, scenario = planar, load("station-keeping", PLANE)
    else:
        scenario = Scenario.from_toml(SPACE)
        path = write_fmu(scenario, tmp_path, "arm")
        scenario = scenario.with_values({"control.start": 0.0})
    assert validate_fmu(str(path)) == []
    driven = "slide" if name == "plane" else "sway"
    time = 0.01 * np.arange(10)
    columns = {
        f"command_{driven}": 0.02 * np.sin(30 * time),
        "current_x": 2 * time,
        "base_tilt": -0.1 * time,
    }
    given = np.rec.fromarrays([time, *columns.values()], names=["time", *columns])
    axes = "xz" if name == "plane" else "xyz"
    found = fmpy.simulate_fmu(
        str(path),
        input=given,
        start_values={"arm.youngs_modulus": 3e6},
        output=[*(f"tip_{axis}" for axis in axes), "shape", "base_force_z"],
    )
    scenario = scenario.with_values({"arm.youngs_modulus": 3e6})
    with Session(scenario, external=["current", "base"]) as session:
        for number, instant in enumerate(found):
            now = session.record()
            tip = [instant[f"tip_{axis}"] for axis in axes]
            assert tip == pytest.approx(np.asarray(now.tip)[: len(axes)], abs=1e-6)
            assert instant["base_force_z"] == pytest.approx(float(now.base_force[-1]), abs=1e-6)
            assert instant["shape"][-1] == pytest.approx(tip, abs=1e-12)
            assert instant["time"] == pytest.approx(session.time, abs=1e-12)
            if number < 10:
                slide, current, tilt = (float(values[number]) for values in columns.values())
                command = dict.fromkeys((each.name for each in session.inputs), 0.0)
                session.step(
                    command | {driven: slide},
                    current=[current] + [0.0] * (len(axes) - 1),
                    base={"tilt": tilt},
                )
    assert number == 10
    # the inputs have moved the tip by far more than the tolerance
    assert max(np.ptp(found[name]) for name in ("tip_x", "tip_z")) > 1e-4


def test_a_description_has_units_defaults_and_what_a_host_needs(planar):
    about = fmpy.read_model_description(planar)
    variables = {each.name: each for each in about.modelVariables}
    stiffness = variables["arm.youngs_modulus"]
    assert (stiffness.causality, stiffness.unit, float(stiffness.start)) == ("parameter", "Pa", 4e6)
    assert (variables["seed"].type, variables["seed"].start) == ("Int64", "2")
    assert [int(each.start) for each in variables["shape"].dimensions] == [6, 2]
    base = {each.name: each.baseUnit for each in about.unitDefinitions}
    assert (base["degrees"].rad, base["degrees"].factor) == (1, pytest.approx(np.pi / 180))
    assert {each.name for each in about.modelVariables if not each.description} == set()
    default, kind = about.defaultExperiment, about.coSimulation
    assert (float(default.stopTime), float(default.stepSize)) == (0.1, 0.01)
    assert float(kind.fixedInternalStepSize) == 0.01
    assert is_own(planar)


@pytest.mark.slow
def test_a_slave_starts_again_next_to_others(planar, tmp_path):
    log, tips = [], []
    first, second = (Slave(planar, tmp_path / name, log) for name in ("one", "two"))
    first.set(command_slide=0.05, arm__youngs_modulus=3e6)
    for slave in first, second:
        slave.start()
        slave.step(0.0, 0.05)
        tips += slave.get("tip_x")
    assert abs(tips[0] - tips[1]) > 1e-5
    first.unit.reset()
    assert first.get("arm.youngs_modulus", "command_slide") == [4e6, 0.0]
    first.start()
    first.step(0.0, 0.05)
    assert first.get("tip_x") == tips[1:]
    for slave in first, second:
        slave.unit.terminate()
        slave.unit.freeInstance()
    assert log == []


def test_the_log_has_the_reason_of_a_failure(planar, tmp_path):
    log = []
    slave = Slave(planar, tmp_path / "one", log)
    slave.start()
    with pytest.raises(FMICallException, match="error"):
        slave.step(0.0, 0.015)
    slave.set(current_x=1e4)
    with pytest.raises(FMICallException, match="error"):
        slave.step(0.0, 0.01)
    must = "must be a multiple of the control period, 0.01 s"
    assert log[0] == f"communication step: got 0.015; {must}"
    assert log[1].startswith("failed at t = 0 s: ")
    assert len(log) == 2
    refusing = Slave(planar, tmp_path / "two", log)
    refusing.set(arm__length=-1.0)
    with pytest.raises(FMICallException):
        refusing.start()
    assert "RuntimeError('arm.length: got -1.0; must be a number above 0 (m)')" in log[2]
    for each in slave, refusing:
        each.unit.freeInstance()


def test_a_host_without_crinoid_gets_one_line(planar, tmp_path, monkeypatch):
    def reason(number):
        log = []
        with pytest.raises(Exception, match="instantiate"):
            Slave(planar, tmp_path / str(number), log)
        (line,) = log
        assert 'pip install "crinoid==' in line
        return line

    monkeypatch.setattr("crinoid.foundation.version.__version__", "0.0.1")
    assert "(it has 0.0.1)" in reason(1)
    monkeypatch.setitem(sys.modules, "crinoid.simulation.co_simulation", None)
    assert f"in Python {sys.version.split()[0]} of {sys.prefix}" in reason(2)


def test_records_travel_inside_and_a_controller_does_not(tmp_path):
    source = tmp_path / "source"
    source.mkdir()
    (source / "record.csv").write_text(RECORD)
    shutil.copy(builtin_files("station-keeping")[0], source / "policy.eqx")
    (source / "9 of \u03b2.toml").write_text(builtin_text("station-keeping") + FLOW)
    settings = ["--set", "control.kind=neural"]
    settings += ["--set", f"control.neural.weights={source}/policy.eqx"]
    file, out = source / "9 of \u03b2.toml", tmp_path / "out"
    written = succeeded("export", file, "--to", "fmu", "--out", out, *settings)
    (path,) = out.iterdir()
    assert (path.name, written.splitlines()) == ("9 of \u03b2.fmu", [f"wrote {path}"])
    shutil.rmtree(source)
    assert validate_fmu(str(path)) == []
    with zipfile.ZipFile(path) as archive:
        inside = {name for name in archive.namelist() if name.startswith("resources/files/")}
        assert inside == {"resources/files/0-record.csv"}
        assert archive.read("resources/files/0-record.csv").decode() == RECORD
    log = []
    slave = Slave(path, tmp_path / "one", log)
    assert slave.get("flow.2.velocity_scale") == [1.0]
    slave.unit.freeInstance()
    assert log == []


def test_an_export_depends_on_its_scenario_only(tmp_path):
    def token(folder, *settings):
        scenario = load("station-keeping", [*PLANE, *settings])
        return fmpy.read_model_description(write_fmu(scenario, folder, "arm")).instantiationToken

    assert token(tmp_path) == token(tmp_path)
    assert token(tmp_path) != token(tmp_path, "arm.length=0.6")
