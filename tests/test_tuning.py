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
from crinoid.assembly.prepared import Prepared
from crinoid.cli.folder import check_own
from crinoid.report import ReportError, write_report
from crinoid.scenario import Scenario, ScenarioError
from crinoid.simulation.margins import find_margins
from crinoid.tuning import tuning as module
from crinoid.tuning.cost import Cost, cost
from crinoid.tuning.design import Design, tuned_numbers
from crinoid.tuning.search import Trial, constrain, descend, nearest
from crinoid.tuning.tuning import STARTS, Tuning
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


MARGIN = 0.6


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return where `crinoid tune` has written."""
    folder = tmp_path_factory.mktemp("tune")
    (folder / "small.toml").write_text(SCENARIO)
    arguments = ("--seeds", 2, "--iterations", 6, "--margin", MARGIN, "--out", folder)
    ended = call("tune", folder / "small.toml", *arguments)
    assert ended.exit_code == 0, ended.output
    for words in (
        "heave.kp",
        "tilt.ki",
        "modulus margin",
        "delay margin",
        "root of cost, other draws",
        "tip error, RMS",
    ):
        assert words in ended.output
    for name in ("tuned.toml", "tune.nc", "tune.png"):
        assert f"wrote {folder / name}" in ended.output
    return folder


@pytest.fixture(scope="module")
def search(folder):
    """Return a search that takes the program which the command has compiled."""
    return Tuning(Scenario.from_toml(SCENARIO), 2, 6, MARGIN)


def slopes_and_differences(design, at, h):
    """Return the slopes of a cost, and its central differences."""
    none = np.zeros(len(design.given))
    around = design.around(none)
    found = at(around.here, around.slopes)
    assert found.converged
    steps = h * np.eye(none.size)
    more, less = (
        [at(design.controller(sign * step), around.slopes).total for step in steps]
        for sign in (1, -1)
    )
    return np.asarray(found.slope), (np.array(more) - np.array(less)) / (2 * h)


def test_the_slope_is_that_of_central_differences(search):
    draw = search.draws[0]

    def at(controller, slopes):
        return cost(controller, slopes, draw.loop, draw.state, search._weights, 50)

    slope, differences = slopes_and_differences(search._design, at, 1e-3)
    assert (differences != 0).all()
    # tolerance: that of both steps
    np.testing.assert_allclose(slope, differences, rtol=1e-4)


# the horizon of a predictive controller takes long to compile
@pytest.mark.parametrize("kind", ["lqg", "mpc"])
def test_the_slope_by_weights_is_that_of_the_whole_design(kind):
    # gentle enough for no limit to begin or end to be met between the differences
    weight = {f"control.{kind}.smoothness": 0.02}
    values = {"control.kind": kind, "control.mpc.horizon": 0.2} | weight
    tuning = Tuning(Scenario.from_toml(SCENARIO).with_values(values), 1, 1)
    draw = tuning.draws[0]

    def at(controller, slopes):
        return cost(controller, slopes, draw.loop, draw.state, tuning._weights, 50)

    slope, differences = slopes_and_differences(tuning._design, at, 3e-4)
    names = [f"control.{kind}.{name}" for name in ("smoothness", "integral_time")]
    assert list(tuning.given) == names
    assert (differences != 0).all()
    np.testing.assert_allclose(slope, differences, rtol=1e-4)  # round-off of the design


def test_the_cost_is_error_and_effort(search):
    draw = search.draws[0]
    around = search._design.around(np.zeros(3))
    found = cost(around.here, around.slopes, draw.loop, draw.state, search._weights, 50)
    seen = eqx.filter_jit(crinoid.rollout, compiler_options=QUICKLY)(draw.loop, draw.state, 50).kept
    z, angle = seen.error[:, 1], 0.5 * seen.error[:, 2]
    speed = np.diff(seen.command, axis=0, prepend=0.0)[:, 1:] * [1.0, 0.5] / 0.02
    expected = np.mean(z**2 + angle**2) + 1e-4 * np.mean(np.sum(speed**2, axis=1))
    np.testing.assert_allclose(found.total, expected, rtol=1e-9)
    np.testing.assert_allclose(found.error, np.mean(seen.error[:, 0] ** 2 + z**2), rtol=1e-9)


# --- the search ------------------------------------------------------------------------------


def bowl(controller, slopes, loop, state, weights, steps):
    """Return a cost that is least at ten times the gains, and none where one is above 1.3."""
    gains = np.array([controller.kp[1], controller.ki[1], controller.ki[2]])
    away = np.log(gains / [0.2, 1.0, 1.0])
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
    np.testing.assert_array_equal(tuning.best, tuning.logs[start, number])
    np.testing.assert_allclose(np.exp(tuning.best), 10.0, rtol=0.05)
    given = tuning.tuned().control.pid.present["heave"].kp
    assert given == pytest.approx(0.02 * np.exp(tuning.best[0]), rel=1e-5)


def test_numbers_close_by_are_looked_for_so_often_only():
    """Where there are none that keep the margin: the least excess of all that were looked at."""
    seen = []

    def excess(x):
        seen.append(1 + float(np.abs(x).sum()) ** 0.5)
        return seen[-1], np.sign(x) / (2 * (seen[-1] - 1))

    found = nearest(excess, np.array([1.3, -0.7]))
    assert len(seen) <= 60
    assert 1 + float(np.abs(found).sum()) ** 0.5 == min(seen) < seen[0]


def test_a_constraint_is_met_where_the_cost_wants_beyond_it():
    """The least distance from (3, 1) within the unit circle, and beyond |x| = 2 nothing runs."""

    def attempt(x):
        far = float(np.linalg.norm(x))
        value = np.nan if far > 2 else (x[0] - 3) ** 2 + (x[1] - 1) ** 2
        slope = 2 * (x - [3.0, 1.0])
        return Trial(value, slope, 0.5 * (far**2 - 1), x)

    seen = []
    constrain(lambda x: seen.append(x) or attempt(x), np.array([0.2, 0.1]))
    np.testing.assert_allclose(seen[-1], np.array([3.0, 1.0]) / np.sqrt(10), atol=0.02)
    # a penalty holds it up to its weight
    seen.clear()
    descend(lambda x: seen.append(x) or attempt(x), np.array([0.2, 0.1]))
    assert 1.0 < np.linalg.norm(seen[-1]) < 1.25
    found = nearest(lambda x: (0.5 * float(x @ x - 1), x), np.array([1.2, 1.6]))
    np.testing.assert_allclose(found, [0.6, 0.8], atol=0.02)


def test_the_nearness_has_the_slope_of_its_differences_and_bounds_the_margin(search):
    stability, design = search._stability, search._design
    logs = np.log([5.0, 8.0, 3.0])
    found = stability.nearness(design.around(logs), MARGIN)
    assert found.margin.stable
    # tolerance: that of fewer frequencies
    assert found.excess > 1 - found.margin.modulus / MARGIN - 2e-3 > 0.1
    h = 1e-2 * np.eye(3)
    more, less = (
        [stability.nearness(design.around(logs + s * step), MARGIN).excess for step in h]
        for s in (1, -1)
    )
    np.testing.assert_allclose(found.slope, (np.array(more) - less) / 2e-2, rtol=0.01, atol=1e-4)
    assert stability.lack(found.margin, MARGIN) > 0.1
    # one that is well away from -1 but would not bear late commands is no good either
    brief = found.margin._replace(modulus=0.9, delay=0.5 * stability._late)
    assert stability.lack(brief, MARGIN) == pytest.approx(0.5)
    assert stability.lack(brief._replace(delay=3 * stability._late), MARGIN) < 0
    swinging = stability.nearness(design.around(logs + 3.0), MARGIN)
    assert not swinging.margin.stable
    assert swinging.excess >= 1
    assert swinging.slope.sum() > 0  # smaller gains grow more slowly


@pytest.mark.parametrize("noise", [0.0, 1e-3])
def test_draws_differ_where_a_sensor_is_noisy(search, noise):
    calm = search.scenario.with_values({"flow": [], "sensor.noise_position": noise})
    assert Tuning(calm, 2, 1).random == (noise > 0)


def test_a_search_that_is_stopped_keeps_what_it_has(tmp_path, monkeypatch):
    path, calls = tmp_path / "small.toml", []
    path.write_text(SCENARIO)

    def interrupted(*arguments):
        calls.append(arguments)
        number = len(calls)
        time.sleep(0.05)  # by then there is something to save
        if number == 7:
            os.kill(os.getpid(), signal.SIGINT)
        return bowl(*arguments)

    monkeypatch.setattr(module, "cost", interrupted)
    numbers = ("--seeds", 1, "--iterations", 12, "--margin", 0)
    ended = call("tune", path, *numbers, "--out", tmp_path)
    assert ended.exit_code == 130, ended.output
    assert "interrupted after" in ended.output
    data = xr.load_dataset(tmp_path / "tune.nc")
    assert 1 <= data.sizes["iteration"] < 12
    tuned = Scenario.from_toml((tmp_path / "tuned.toml").read_text())
    assert tuned.control.pid.present["heave"].kp == pytest.approx(float(data["tuned"][0]), rel=1e-5)


def failing(*arguments):
    found = bowl(*arguments)
    nothing = jnp.full_like(found.total, jnp.nan)
    return eqx.tree_at(lambda x: (x.total, x.converged), found, (nothing, jnp.asarray(False)))


def test_where_nothing_can_be_run_nothing_is_written(tmp_path, monkeypatch):
    path = tmp_path / "small.toml"
    path.write_text(SCENARIO)
    monkeypatch.setattr(module, "cost", failing)
    ended = call("tune", path, "--seeds", 1, "--margin", 0, "--out", tmp_path / "out")
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
    assert data["key"].values.tolist() == ["heave.kp", "heave.ki", "tilt.ki"]
    np.testing.assert_allclose(data["given"], [0.02, 0.1, 0.1])
    kept = data["cost"].where(data["modulus"] >= MARGIN)
    start, iteration = np.unravel_index(np.nanargmin(kept), kept.shape)
    np.testing.assert_allclose(data["tuned"], data["tried"][start, iteration], rtol=1e-12)
    back = {f"control.pid.{name}.{gain}": getattr(given.control.pid.present[name], gain)
            for name, gain in (("heave", "kp"), ("heave", "ki"), ("tilt", "ki"))}  # fmt: skip
    assert tuned.with_values(back) == given


def test_the_margins_are_those_that_the_linear_loop_has(folder):
    data = xr.load_dataset(folder / "tune.nc")
    given = (folder / "small.toml", folder / "tuned.toml")
    for when, path in zip(("before", "after"), given, strict=True):
        found = find_margins(Prepared(Scenario.from_toml(path.read_text())))
        for name in ("modulus", "gain", "phase", "delay"):
            expected = float(found[f"{name}_margin"])
            assert float(data[f"{when}_{name}_margin"]) == pytest.approx(expected, rel=1e-4)
    assert float(data["after_modulus_margin"]) >= MARGIN
    # else it would not have had to be kept to
    assert np.nanmin(data["modulus"]) < MARGIN


def test_it_gets_better_in_draws_that_it_was_not_tuned_for(folder):
    data = xr.load_dataset(folder / "tune.nc")
    assert float(data["after"].mean()) < 0.9 * float(data["before"].mean())
    assert float(data["after_error"].mean()) < float(data["before_error"].mean())


def test_the_figure_shows_the_search(folder, tmp_path):
    check_own(folder / "tune.nc")  # a second search may replace it
    (figure,) = write_report(folder / "tune.nc", tmp_path)
    assert figure.name == "tune.png"
    assert_shows_something(figure)
    broken = tmp_path / "tune.nc"
    xr.load_dataset(folder / "tune.nc").drop_vars("tried").to_netcdf(broken)
    with pytest.raises(ReportError, match="it has no tried over start, iteration, key"):
        write_report(broken)


IDLE = {"kind": "pid", "controlled": ["angle"], "pid": {"tilt": {}}}


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"control": {"kind": "none"}}, 'control.kind: got "none", which has nothing to tune'),
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
        tuned_numbers(scenario)


@pytest.mark.parametrize("option", ["--seeds", "--iterations"])
def test_numbers_below_one_are_refused(option, tmp_path):
    ended = call("tune", "station-keeping", option, 0, "--out", tmp_path / "out")
    assert ended.exit_code == 2
    assert f"{option}: got 0, takes a number of 1 or more" in ended.output


@pytest.mark.parametrize("margin", [-0.1, 1.0, "nan"])
def test_a_margin_that_no_loop_has_is_refused(margin, tmp_path):
    ended = call("tune", "station-keeping", f"--margin={margin}", "--out", tmp_path / "out")
    assert ended.exit_code == 2
    assert f"--margin: got {margin}" in ended.output.replace("got 1,", "got 1.0,")


def test_the_default_weights_are_those_of_the_design():
    described = Scenario.from_toml(SCENARIO).with_values({"control.kind": "lqg"})
    plan = Tuning(described, 1, 1)._design._plan
    design = Design(plan)
    here, given = design.controller(np.zeros(2)), design._plan.scenario.control.lqg
    assert given.smoothness is None
    loop = crinoid.closed_loop(described)[0]
    np.testing.assert_allclose(here.gains, loop.controller.gains, rtol=1e-6)
