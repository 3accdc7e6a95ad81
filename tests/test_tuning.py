"""Tuning of gains: the slope of the cost, the search, and what the command writes."""

import os
import signal
import time

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr

import crinoid
from crinoid.report import ReportError, write_report
from crinoid.scenario import Scenario, ScenarioError
from crinoid.tuning import tuning as module
from crinoid.tuning.cost import Cost, cost
from crinoid.tuning.tuning import STARTS, Tuning, check_tunable
from physics import QUICKLY
from test_cli import call
from test_report import assert_shows_something

SCENARIO = """
title = "small gains"
seed = 3
[arm]
nodes = 5
youngs_modulus = 1e6
[base.channels.heave]
range = [-0.2, 0.2]
[base.channels.tilt]
[[flow]]
kind = "gauss-markov"
mean = [0.0, 0.3]
standard_deviation = [0.05, 0.1]
correlation_time = 0.2
ramp_time = 0.2
[control]
kind = "pid"
controlled = ["z", "angle"]
rate_hz = 50.0
[control.pid.heave]
kp = 0.02
ki = 0.1
[control.pid.tilt]
ki = 0.1
[simulation]
duration = 1.0
time_step = 0.02
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return where `crinoid tune` has written."""
    folder = tmp_path_factory.mktemp("tune")
    (folder / "small.toml").write_text(SCENARIO)
    arguments = ("--seeds", 2, "--iterations", 6, "--out", folder)
    ended = call("tune", folder / "small.toml", *arguments)
    assert ended.exit_code == 0, ended.output
    for words in ("heave.kp", "tilt.ki", "root of cost, other draws", "tip error, RMS"):
        assert words in ended.output
    for name in ("tuned.toml", "tune.nc", "tune.png"):
        assert f"wrote {folder / name}" in ended.output
    return folder


@pytest.fixture(scope="module")
def search(folder):
    """Return a search that takes the program which the command has compiled."""
    return Tuning(Scenario.from_toml(SCENARIO), 2, 6)


def test_the_slope_is_that_of_central_differences(search):
    draw, h = search.draws[0], 1e-4

    def at(logs):
        gains = jnp.asarray(search.given) * jnp.exp(logs)
        return cost(gains, draw.loop, draw.state, search._weights, 50)

    found = at(jnp.zeros_like(search.given))
    assert found.converged
    for gain, name in search._at:
        step = jnp.zeros_like(search.given).at[gain, name].set(h)
        difference = (at(step).total - at(-step).total) / (2 * h)
        assert difference != 0
        # tolerance: that of the steps
        np.testing.assert_allclose(found.slope[gain, name], difference, rtol=1e-4)
    idle = search.given == 0
    assert (np.asarray(found.slope)[idle] == 0).all()


def test_the_cost_is_error_and_effort(search):
    draw = search.draws[0]
    found = cost(jnp.asarray(search.given), draw.loop, draw.state, search._weights, 50)
    seen = eqx.filter_jit(crinoid.rollout, compiler_options=QUICKLY)(draw.loop, draw.state, 50).kept
    z, angle = seen.error[:, 1], 0.5 * seen.error[:, 2]
    speed = np.diff(seen.command, axis=0, prepend=0.0)[:, 1:] * [1.0, 0.5] / 0.02
    expected = np.mean(z**2 + angle**2) + 1e-4 * np.mean(np.sum(speed**2, axis=1))
    np.testing.assert_allclose(found.total, expected, rtol=1e-9)
    np.testing.assert_allclose(found.error, np.mean(seen.error[:, 0] ** 2 + z**2), rtol=1e-9)


# --- the search ------------------------------------------------------------------------------


def bowl(gains, loop, state, weights, steps):
    """Return a cost that is least at ten times the gains, and none where one is above 1.3."""
    gains = np.asarray(gains)
    there = gains != 0
    away = np.log(np.where(there, gains, 1.0) / np.where(there, [[0.2], [1.0], [1.0]], 1.0))
    total = np.nan if (gains > 1.3).any() else 1.0 + np.sum(away**2)
    numbers = (total, 2 * away, total, bool(np.isfinite(total)), 1, 7)
    return Cost(*map(jnp.asarray, numbers))


def test_the_best_gains_are_kept_and_what_cannot_be_run_is_stepped_back_from(search, monkeypatch):
    monkeypatch.setattr(module, "cost", bowl)
    tuning = Tuning(search.scenario, 1, 30)
    tuning.run(lambda *_: None, lambda: False)
    failed = STARTS.index(16.0)  # its integral gains are 1.6 from the start
    assert np.isnan(tuning.cost[failed]).all()
    assert tuning.tried[failed] == 1
    assert tuning.failure.startswith("failed at t = 0.14 s: ")
    others = np.delete(tuning.cost, failed, axis=0)
    np.testing.assert_allclose(np.nanmin(others, axis=1), 1.0, rtol=1e-3)  # each got there
    start, number = np.unravel_index(np.nanargmin(tuning.cost), tuning.cost.shape)
    assert tuning.least == tuning.cost[start, number]
    best = [tuning.best[at] for at in tuning._at]
    np.testing.assert_array_equal(best, tuning.gains[start, number])
    np.testing.assert_allclose(best, [0.2, 1.0, 1.0], rtol=0.05)


@pytest.mark.parametrize("noise", [0.0, 1e-3])
def test_draws_differ_where_a_sensor_is_noisy(search, noise):
    calm = search.scenario.with_values({"flow": [], "sensor.noise_position": noise})
    assert Tuning(calm, 2, 1).random == (noise > 0)


def test_a_search_that_is_stopped_keeps_what_it_has(tmp_path, monkeypatch):
    path, calls = tmp_path / "small.toml", []
    path.write_text(SCENARIO)

    def interrupted(*arguments):
        calls.append(arguments)
        time.sleep(0.05)  # by then there is something to save
        if len(calls) == 7:
            os.kill(os.getpid(), signal.SIGINT)
        return bowl(*arguments)

    monkeypatch.setattr(module, "cost", interrupted)
    ended = call("tune", path, "--seeds", 1, "--iterations", 12, "--out", tmp_path)
    assert ended.exit_code == 130, ended.output
    assert "interrupted after" in ended.output
    data = xr.load_dataset(tmp_path / "tune.nc")
    assert 1 <= data.sizes["iteration"] < 12
    tuned = Scenario.from_toml((tmp_path / "tuned.toml").read_text())
    assert tuned.control.pid.present["heave"].kp == pytest.approx(float(data["tuned"][0]), rel=1e-5)


def test_where_nothing_can_be_run_nothing_is_written(tmp_path, monkeypatch):
    path = tmp_path / "small.toml"
    path.write_text(SCENARIO)
    monkeypatch.setattr(module, "cost", lambda *a: bowl(np.full((3, 3), 2.0), *a[1:]))
    ended = call("tune", path, "--seeds", 1, "--out", tmp_path / "out")
    assert ended.exit_code == 3
    assert "failed at t = 0.14 s" in ended.output
    assert not (tmp_path / "out").exists()


# --- the command -----------------------------------------------------------------------------


def test_the_tuned_scenario_has_the_best_gains_and_nothing_else_changed(folder):
    data, given = xr.load_dataset(folder / "tune.nc"), Scenario.from_toml(SCENARIO)
    tuned = Scenario.from_toml((folder / "tuned.toml").read_text())
    present = tuned.control.pid.present
    found = [present["heave"].kp, present["heave"].ki, present["tilt"].ki]
    np.testing.assert_allclose(found, data["tuned"], rtol=1e-5)
    assert data["gain"].values.tolist() == ["heave.kp", "heave.ki", "tilt.ki"]
    np.testing.assert_allclose(data["given"], [0.02, 0.1, 0.1])
    start, iteration = np.unravel_index(np.nanargmin(data["cost"]), data["cost"].shape)
    np.testing.assert_array_equal(data["tuned"], data["gains"][start, iteration])
    back = {f"control.pid.{name}.{gain}": getattr(given.control.pid.present[name], gain)
            for name, gain in (("heave", "kp"), ("heave", "ki"), ("tilt", "ki"))}  # fmt: skip
    assert tuned.with_values(back) == given


def test_it_gets_better_in_draws_that_it_was_not_tuned_for(folder):
    data = xr.load_dataset(folder / "tune.nc")
    assert float(data["after"].mean()) < 0.9 * float(data["before"].mean())
    assert float(data["after_error"].mean()) < float(data["before_error"].mean())


def test_the_figure_shows_the_search(folder, tmp_path):
    (figure,) = write_report(folder / "tune.nc", tmp_path)
    assert figure.name == "tune.png"
    assert_shows_something(figure)
    broken = tmp_path / "tune.nc"
    xr.load_dataset(folder / "tune.nc").drop_vars("gains").to_netcdf(broken)
    with pytest.raises(ReportError, match="it has no gains over start, iteration, gain"):
        write_report(broken)


IDLE = {"kind": "pid", "controlled": ["angle"], "pid": {"tilt": {}}}


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"control": {"kind": "none"}}, 'control.kind: got "none", which has no gains to tune'),
        (
            {"control": {"kind": "pid", "controlled": ["angle"], "pid": {"tilt": {}}}},
            "control.pid: has no gains to tune",
        ),
        ({"vary": {"arm.length": [0.4, 0.5]}}, "vary: tuning is of one case"),
    ],
)
def test_what_has_nothing_to_tune_is_refused(values, words):
    scenario = Scenario.from_dict(Scenario.from_toml(SCENARIO).to_dict() | values)
    with pytest.raises(ScenarioError, match=words):
        check_tunable(scenario)


@pytest.mark.parametrize("option", ["--seeds", "--iterations"])
def test_numbers_below_one_are_refused(option, tmp_path):
    ended = call("tune", "station-keeping", option, 0, "--out", tmp_path / "out")
    assert ended.exit_code == 2
    assert f"{option}: got 0, takes a number of 1 or more" in ended.output
