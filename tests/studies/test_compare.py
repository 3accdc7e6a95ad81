"""Controllers side by side: what is compared is what runs give, and a run that fails stops none."""

import signal

import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr
from scipy import stats

import crinoid
from crinoid.assembly.plan import Parts
from crinoid.assembly.prepared import Prepared
from crinoid.control import Controller
from crinoid.results.effort import input_speed, spent_work
from crinoid.results.metrics import measured
from crinoid.results.result import Result
from crinoid.scenario import Scenario, ScenarioError
from crinoid.simulation import loop as loop_module
from crinoid.simulation.setup import set_up
from crinoid.studies.comparison import comparison_rows, controlled_by
from crinoid.view.figures import write_report
from helpers.command import call, succeeded
from helpers.figures import assert_shows_something
from helpers.signals import usual_signals

pytestmark = pytest.mark.slow

FLOW = {"mean": [0.0, 0.2], "standard_deviation": [0.05, 0.1], "correlation_time": 0.2}
SCENARIO = Scenario(
    title="two controllers",
    arm={"nodes": 5, "youngs_modulus": 5e5},
    base={"channels": {"heave": {"range": [-0.2, 0.2]}, "tilt": {}}},
    flow=[FLOW | {"kind": "gauss-markov"}],
    control={"controlled": ["z", "angle"]},
    simulation={"duration": 0.3},
)

signals = pytest.fixture(usual_signals, autouse=True)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return where `crinoid compare` has written, for a scenario without gains."""
    folder = tmp_path_factory.mktemp("compare")
    (folder / "small.toml").write_text(SCENARIO.to_toml())
    seeds = ("--seeds", 3, "--first-seed", 4)
    succeeded("compare", folder / "small.toml", *seeds, "--out", folder)
    return folder


@pytest.fixture(scope="module")
def compared(folder):
    return xr.load_dataset(folder / "compare.nc")


def under(compared: xr.Dataset, kind: str) -> Scenario:
    """Return the scenario that was run under a controller."""
    return Scenario.from_toml(compared["controller_scenario"].sel(controller=kind).item())


@pytest.mark.release
def test_each_run_is_that_of_crinoid_run_to_the_bit(compared):
    assert compared["seed"].values.tolist() == [4, 5, 6]
    assert (compared["status"] == "ok").all()
    case = under(compared, "pid").with_values({"seed": 5, "control.compare": True})
    alone = crinoid.simulate(case)
    for kind, result in {"pid": alone, "none": alone.uncontrolled}.items():
        found = compared.sel(controller=kind, seed=5)
        expected = measured(result)
        errors = ("rms_error", "max_error", "rms_angle_error", "max_angle_error")
        for name in (*errors, "fluctuation", "work"):
            assert float(found[name]) == expected.numbers[name], (kind, name)
        assert found["effort"].values.tolist() == list(expected.speed.values())
    assert len(set(compared["rms_error"].values.ravel())) == 6  # every seed is another run


@pytest.mark.slow
def test_the_file_has_names_dimensions_and_units(compared):
    units = {"rms_error": "m", "max_error": "m", "fluctuation": "m", "rms_angle_error": "rad"}
    for name, unit in units.items():
        assert compared[name].dims == ("controller", "seed")
        assert compared[name].attrs["units"] == unit
    assert compared["effort"].dims == ("controller", "seed", "input")
    assert compared["input"].values.tolist() == ["heave", "tilt"]
    assert compared["input_unit"].values.tolist() == ["m s-1", "rad s-1"]
    assert (compared["effort"].sel(controller="none") == 0).all()
    assert (compared["effort"].sel(controller="pid") > 0).all()
    assert compared["tick_time"].attrs["units"] == "s"
    assert (compared["tick_time"] > 0).all()
    assert compared.attrs["status"] == "ok"
    assert Scenario.from_toml(compared.attrs["scenario"]) == SCENARIO


HOPELESS = {"tolerance": 1e-15, "max_iterations": 1, "max_halvings": 0}


def test_runs_that_fail_end_the_command_with_3_and_are_named(folder, tmp_path):
    settings = [f"--set=simulation.{name}={value}" for name, value in HOPELESS.items()]
    settings += ["--controllers=none", "--seeds=6"]
    ended = call("compare", folder / "small.toml", *settings, "--out", tmp_path)
    assert ended.exit_code == 3
    assert "none with seed 0: failed at t = " in ended.stderr
    saved = xr.load_dataset(tmp_path / "compare.nc")
    assert np.isnan(saved["rms_error"]).all()
    assert all(words.startswith("failed at t = ") for words in saved["status"].values.flat)
    assert_shows_something(tmp_path / "compare.png")


@pytest.mark.slow
def test_ctrl_c_saves_the_runs_that_are_complete(folder, tmp_path, monkeypatch):
    def reporter(bar, prefix):
        return lambda reached: reached.label != "pid" or signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr("crinoid.cli.display.reporter", reporter)
    ended = call("compare", folder / "small.toml", "--seeds", 2, "--out", tmp_path)
    assert ended.exit_code == 130
    saved = xr.load_dataset(tmp_path / "compare.nc")
    assert (saved["status"].sel(controller="none") == "ok").all()
    assert np.isfinite(saved["rms_error"].sel(controller="none")).all()
    unfinished = saved["status"].values == "interrupted before its end"
    assert unfinished[1].any()
    assert np.isnan(saved["rms_error"].values[unfinished]).all()
    complete = 4 - unfinished.sum()
    assert f"interrupted: {complete} of 4 runs are complete and saved" in ended.stderr


@pytest.mark.release
def test_shipped_gains_leave_a_margin_and_are_no_smaller_than_they_need_be(compared):
    case = under(compared, "pid")
    gains = {name: given.ki for name, given in case.control.pid.present.items()}
    assert set(gains) == {"heave", "tilt"}
    assert len(set(gains.values())) == 1
    loop = set_up(Prepared(case)).open_loop
    margin = loop.margin()
    assert margin.stable
    assert margin.modulus >= 0.4
    # 1 Hz at most, or as much as the margin allows
    assert gains["tilt"] > 6.0 or loop.scaled(1.5).margin().modulus < 0.4


def test_gains_are_found_for_inputs_that_move_the_tip_and_else_kept():
    # an input that moves nothing of the controlled coordinates gets no gain
    turned = SCENARIO.with_values({"control.controlled": ["angle"]})
    assert list(controlled_by(turned, "pid").control.pid.present) == ["tilt"]
    own = SCENARIO.with_values({"control.pid.tilt.kp": 0.3})
    assert controlled_by(own, "pid").control.pid == own.control.pid
    follows = {"target.path": "line", "target.velocity": [0.1, 0.0], "target.feed_forward": True}
    follows = own.with_values(follows | {"control.kind": "pid"})
    assert controlled_by(follows, "none").target.feed_forward is False
    with pytest.raises(ScenarioError, match="no default gains leave a margin"):
        controlled_by(SCENARIO.with_values({"base.channels": {}}), "pid")


class Counting(Controller):
    """Commands a little more each time, and the time that has passed."""

    def start(self, seen):
        return jnp.zeros(())

    def command(self, memory, seen):
        slide = jnp.zeros(())  # which the scenario does not have
        return jnp.stack([slide, 1e-6 * memory, 1e-6 * seen.time]), memory + 1.0


@pytest.fixture(scope="module")
def setup(compared):
    return set_up(Prepared(under(compared, "none"), Parts(controller=Counting())))


def test_each_call_that_is_timed_follows_the_one_before(setup):
    total = loop_module._commands(setup.loop, setup.state, jnp.asarray(100))
    late = setup.loop.clock.period * 99 * 100 / 2
    np.testing.assert_allclose(total, [0.0, 1e-6 * 99 * 100 / 2, 1e-6 * late], rtol=1e-9)


@pytest.mark.release
@pytest.mark.parametrize("takes", [3e-7, 2e-4, 0.2])
def test_the_time_of_a_tick_is_that_of_one_call(monkeypatch, setup, takes):
    timed = []

    def run(loop, state, calls):
        timed.append(calls)
        return 1e-5 + takes * calls  # with the start of the program

    monkeypatch.setattr(loop_module, "_run", run)
    assert loop_module.controller_cpu_time(setup.loop, setup.state) == pytest.approx(
        takes, rel=0.01
    )
    assert len(set(timed[-5:])) == 1
    assert takes * timed[-1] > 0.04
    assert takes * timed[-1] < max(0.2, 17 * takes)


def test_speeds_and_work_of_a_known_motion():
    time = np.array([0.0, 0.5, 1.5, 2.0])
    servo = np.stack([0.2 * time, 0 * time, 0 * time], axis=1)
    servo[-1, 0] = servo[-2, 0]
    found = {
        "base_servo": (("time", "channel"), servo),
        "actuator_state": (("time", "input"), (0.5 * time)[:, None]),
        "energy": (("time", "kind"), np.array([[0.0], [2.0], [1.0], [4.0]])),
        "channel_lower": ("channel", [-1.0, 0.0, -1.0]),
        "channel_upper": ("channel", [1.0, 0.0, 1.0]),
    }
    names = {"channel": ["slide", "heave", "tilt"], "kind": ["actuation"], "input": ["chamber_0"]}
    moved = Result(xr.Dataset(found, {"time": time, **names}, {"scenario": SCENARIO.to_toml()}))
    # 0.2 m/s for 1.5 s of 2 s; heave is no channel of this arm
    expected = {"slide": 0.2 * np.sqrt(0.75), "tilt": 0.0, "chamber_0": 0.5}
    assert input_speed(moved) == pytest.approx(expected)
    assert spent_work(moved) == pytest.approx(2.0 + 3.0)


def made(**changes) -> xr.Dataset:
    """Return a comparison of three controllers over two seeds, one of which failed."""
    over, metres = ("controller", "seed"), {"units": "m"}
    rms = np.array([[0.03, 0.05], [0.003, np.nan], [0.002, 0.004]])
    status = np.full((3, 2), "ok", object)
    status[1, 1] = "failed at t = 1 s: it fell"
    found = {
        "rms_error": (over, rms, metres),
        "max_error": (over, 2 * rms, metres),
        "fluctuation": (over, 0.5 * rms, metres),
        "work": (over, rms, {"units": "J"}),
        "effort": ((*over, "input"), rms[..., None]),
        "tick_time": ("controller", [1e-8, 1e-6, 2e-3]),
        "status": (over, status),
    } | changes
    names = {"controller": ["none", "pid", "mpc"], "seed": [0, 1], "input": ["tilt"]}
    about = {"title": "made", "scenario": SCENARIO.to_toml(), "crinoid_version": "0"}
    about["status"] = "failed: 1 of 6 runs did not reach their end"
    return xr.Dataset(found, names | {"input_unit": ("input", ["rad s-1"])}, about)


def test_the_csv_has_paired_differences_from_the_best_controller():
    values = np.array([[0.03, 0.05, 0.04], [0.003, 0.005, 0.006], [0.002, 0.004, 0.004]])
    data = made()[["rms_error"]].isel(seed=[0, 1, 1]).copy(data={"rms_error": values})
    rows = {row["controller"]: row for row in comparison_rows(data)}
    assert {row["against"] for row in rows.values()} == {"mpc"}
    assert rows["mpc"]["difference"] is rows["mpc"]["p_value"] is None
    expected = stats.ttest_rel(values[1], values[2])
    assert rows["pid"]["p_value"] == pytest.approx(expected.pvalue)
    ends = expected.confidence_interval(0.95)
    assert (rows["pid"]["difference_low"], rows["pid"]["difference_high"]) == pytest.approx(ends)
    assert rows["pid"]["mean"] == pytest.approx(values[1].mean())
    assert rows["none"]["runs"] == 3


def test_the_figure_is_drawn_again_and_for_failed_runs(folder, tmp_path):
    none = (("controller", "seed"), np.full((3, 2), np.nan))
    made(max_error=none).to_netcdf(tmp_path / "compare.nc")
    for path in (folder, tmp_path):
        (written,) = write_report(path, tmp_path)
        assert written == tmp_path / "compare.png"
        assert_shows_something(written)


@pytest.mark.release
def test_a_hybrid_gets_inclinations_where_a_scenario_has_none():
    values = {"base.tilt_deg": 90.0, "base.channels.slide": {}, "arm.nodes": 6}
    own = SCENARIO.with_values(values)
    (sensor,) = controlled_by(own, "hybrid").sensors
    assert sensor.kind == "inclination"
    assert sensor.stations[0] == 0.0
    assert sensor.stations[-1] == 1.0
    given = {"sensors": [{"kind": "inclination", "stations": [0.1, 0.3, 0.5, 0.7, 0.9]}]}
    assert controlled_by(own.with_values(given), "hybrid").sensors[0].stations[0] == 0.1
    # where it makes no sense one line tells why
    with pytest.raises(ScenarioError, match=r"^base\.tilt_deg: got [^\n]*must be 90[^\n]*$"):
        controlled_by(own.with_values({"base.tilt_deg": 0.0}), "hybrid")
