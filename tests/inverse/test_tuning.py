"""Tuning of gains: cost and its slope, the margin, the search, and what the command writes."""

import json
import os
import signal

import numpy as np
import pytest
import xarray as xr

import crinoid
from crinoid.analysis.margins import find_margins
from crinoid.assembly.prepared import Prepared
from crinoid.cli.folder import check_own
from crinoid.inverse import StoppedError, smooth_loop
from crinoid.inverse.constrained_search import SearchTrial, constrain, move_inside
from crinoid.inverse.smooth_loop import SmoothLoop
from crinoid.inverse.stability import StabilityMargin
from crinoid.inverse.trial_runs import TrialRuns
from crinoid.inverse.tuning import Tuning, tunable_numbers
from crinoid.results.effort import control_cost
from crinoid.results.errors import tip_error
from crinoid.scenario import Scenario
from crinoid.simulation import simulate
from crinoid.view.figures import write_report
from helpers.command import call, succeeded
from helpers.figures import assert_shows_something

GUSTS = {"kind": "gauss-markov", "mean": [0.0, 0.3], "standard_deviation": [0.05, 0.1]}
GAINS = {"heave": {"kp": 0.02, "ki": 0.1}, "tilt": {"ki": 0.1}}
SCENARIO = Scenario(
    title="small gains",
    seed=3,
    arm={"nodes": 5, "youngs_modulus": 1e6},
    base={"channels": {"heave": {"range": [-0.2, 0.2]}, "tilt": {}}},
    flow=[GUSTS | {"correlation_time": 0.2, "ramp_time": 0.2}],
    control={"kind": "pid", "controlled": ["z", "angle"], "rate_hz": 50.0, "pid": GAINS},
    simulation={"duration": 1.0, "time_step": 0.02},
)
KEYS = ["control.pid.heave.kp", "control.pid.heave.ki", "control.pid.tilt.ki"]
MARGIN = 0.6


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return where `crinoid tune` has written."""
    folder = tmp_path_factory.mktemp("tune")
    (folder / "small.toml").write_text(SCENARIO.to_toml())
    arguments = ("--seeds", 2, "--iterations", 6, "--margin", MARGIN, "--out", folder)
    succeeded("tune", folder / "small.toml", *arguments)
    return folder


@pytest.fixture(scope="module")
def data(folder):
    return xr.load_dataset(folder / "tune.nc")


def tuned_in(folder):
    return Scenario.from_toml((folder / "tuned.toml").read_text())


# --- the cost --------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("begin", [0.0, 0.42])
def test_the_cost_is_error_and_effort_from_the_time_that_is_judged(begin):
    result = simulate(SCENARIO.with_values({"target.judged_from": begin}))
    data = result.dataset
    counted = data["time"].values >= begin - 1e-9
    z = (data["tip_position"] - data["tip_target"]).values[counted, 1]
    angle = 0.5 * (data["tip_angle"] - data["tip_angle_target"]).values[counted]
    # the arm is 0.5 m long
    moves = np.diff(data["base_command"].values[counted] * [0.5, 1.0, 0.5], axis=0)
    assert data["channel"].values.tolist() == ["slide", "heave", "tilt"]
    speed = moves / np.diff(data["time"].values[counted])[:, None]
    expected = np.mean(z**2 + angle**2) + 1e-4 * np.mean(np.sum(speed**2, axis=1))
    assert control_cost(result) == pytest.approx(np.sqrt(expected), rel=1e-12)
    assert np.mean(np.sum(speed**2, axis=1)) > 0


def loop_of(scenario):
    tuning = Tuning(scenario, 1, 1)
    return SmoothLoop(tuning.scenario, tuning.ranges, [3, 4], rest=False), tuning


# the horizon of a predictive controller compiles slowly
@pytest.mark.slow
@pytest.mark.parametrize(
    "kind",
    [
        "pid",
        pytest.param("lqg", marks=pytest.mark.release),
        pytest.param("mpc", marks=pytest.mark.release),
    ],
)
def test_the_slope_of_the_cost_is_that_of_central_differences_of_runs(kind, monkeypatch):
    """In each draw, forward and in reverse; all draws have the controller of the first one."""
    scenario = SCENARIO
    if kind != "pid":
        # gentle enough for no limit to begin or end to be met between the differences
        weight = {f"control.{kind}.smoothness": 0.02}
        scenario = SCENARIO.with_values({"control.kind": kind, "control.mpc.horizon": 0.2} | weight)
        names = [f"control.{kind}.{name}" for name in ("smoothness", "integral_time")]
        assert list(tunable_numbers(scenario)) == names
    loop, tuning = loop_of(scenario)
    assert loop.acts_on == "controller"
    start, names, h = tuning.ranges.start, ("control_cost",), 2e-5
    values, slopes = loop.measures(start, names)
    runs = TrialRuns(tuning.goal, [3, 4], lambda: False, rest=False)
    steps = h * np.eye(start.size)
    points = [start, *(start + steps), *(start - steps)]
    base, *others = runs([tuning.ranges.scenario(each) for each in points])[:, 0]
    np.testing.assert_allclose(values[0], base, rtol=1e-9)
    half = len(others) // 2
    differences = (np.array(others[:half]) - others[half:]).T / (2 * h)
    assert (differences != 0).all()
    # tolerance: that of both steps, and of the design's round-off
    np.testing.assert_allclose(slopes[0], differences, rtol=2e-4)
    monkeypatch.setattr(smooth_loop, "_FEW", 0)
    np.testing.assert_allclose(loop.measures(start, names)[1], slopes, rtol=1e-9)


# --- the search ------------------------------------------------------------------------------


WIDTH = 2 * np.log(1e3)


def bowl(values):
    """Return a cost that is least at ten times the gains, none where one is above 1.3; its slope.

    The slope is that by the coordinates of the ranges.
    """
    gains = [values[key] for key in KEYS]
    away = np.log(np.array(gains) / [0.2, 1.0, 1.0])
    return (np.nan if max(gains) > 1.3 else 1.0 + float(away @ away)), 2 * WIDTH * away


@pytest.fixture
def in_a_bowl(monkeypatch):
    """Give runs and loops the cost of a bowl."""

    def measures(loop, point, forms):
        cost, slope = bowl(loop._ranges.values(point))
        return np.array([[cost]]), slope[None, None]

    def runs(self, scenarios, seeds=None):
        found = np.full((len(scenarios), len(self._goal.names), 1), 9.0)
        for at, scenario in enumerate(scenarios):
            if scenario.control.kind == "pid":
                found[at] = bowl(tunable_numbers(scenario))[0]
        if self._stop():
            raise StoppedError
        return found

    monkeypatch.setattr(SmoothLoop, "measures", measures)
    monkeypatch.setattr(TrialRuns, "__call__", runs)


def test_the_search_keeps_the_best_gains_and_leaves_those_that_fail(in_a_bowl):
    tuning = Tuning(SCENARIO, 1, 60)
    tuning.run(lambda *_: None, lambda: False)
    assert tuning.method == "gradients"
    of_start = [
        np.array([trial.found[0, 0] for trial in tuning.trials if trial.start == start])
        for start in range(4)
    ]
    assert np.isnan(of_start[2]).all()  # its integral gains are 1.6 from the start
    for found in (of_start[0], of_start[1], of_start[3]):
        assert np.nanmin(found[1:]) == pytest.approx(1.0, rel=1e-3)  # each got there
    assert tuning.least == pytest.approx(1.0, rel=1e-3)
    assert [*tuning.numbers().values()] == pytest.approx([0.2, 1.0, 1.0], rel=0.05)


def test_a_point_inside_is_sought_in_a_limited_number_of_tries():
    """Where none keeps the margin: the least excess of all that were looked at."""
    seen, centre = [], np.array([0.5, 0.6])

    def excess(x):
        away = x - centre
        seen.append(1 + float(np.abs(away).sum()) ** 0.5)
        return seen[-1], np.sign(away) / (2 * (seen[-1] - 1))

    found = move_inside(excess, np.array([0.7, 0.5]), 0.02)
    assert len(seen) <= 20
    assert 1 + float(np.abs(found - centre).sum()) ** 0.5 == min(seen) < seen[0]


def test_a_constraint_is_met_where_the_cost_wants_beyond_it():
    """The least distance from (3, 1) / 4 within a circle, and farther out nothing runs."""
    seen, centre = [], np.array([0.1, 0.1])

    def attempt(x):
        seen.append(x)
        away = 4 * (x - centre)
        far = float(np.linalg.norm(away))
        value = np.nan if far > 2 else (away[0] - 3) ** 2 + (away[1] - 1) ** 2
        return SearchTrial(value, 8 * (away - [3.0, 1.0]), 0.5 * (far**2 - 1), 4 * away)

    constrain(attempt, centre + np.array([0.05, 0.025]), 0.05)
    np.testing.assert_allclose(4 * (seen[-1] - centre), [0.949, 0.316], atol=0.02)
    begin = centre + np.array([0.3, 0.4])

    def excess(x):
        away = 4 * (x - centre)
        return 0.5 * float(away @ away - 1), 4 * away

    found = move_inside(excess, begin, 0.05)
    np.testing.assert_allclose(4 * (found - centre), [0.6, 0.8], atol=0.02)


@pytest.mark.slow
def test_the_violation_has_the_slope_of_its_differences_and_bounds_the_margin():
    def at(shift):
        near = loop.neighbours(tuning.ranges.start + (logs + shift) / WIDTH)
        return stability.excess(near), stability._plant.closed(stability._linear(near.loop))

    loop, tuning = loop_of(SCENARIO)
    stability, logs = StabilityMargin(SCENARIO, MARGIN), np.log([5.0, 8.0, 3.0])
    (kept, excess, gradient), closed = at(0.0)
    margin = closed.open.margin()
    assert margin.stable
    assert kept == pytest.approx(min(margin.modulus, MARGIN * margin.delay / stability._late))
    # tolerance: that of fewer frequencies
    assert excess > 1 - margin.modulus / MARGIN - 2e-3 > 0.1
    between = [(at(h)[0][1] - at(-h)[0][1]) / 2e-2 for h in 1e-2 * np.eye(3)]
    np.testing.assert_allclose(gradient / WIDTH, between, rtol=0.01, atol=1e-4)
    (kept, excess, gradient), closed = at(3.0)
    assert not closed.open.margin().stable
    assert kept == 0.0
    assert excess >= 1
    assert gradient.sum() > 0  # smaller gains grow more slowly


@pytest.mark.slow
@pytest.mark.parametrize("noise", [0.0, 1e-3])
def test_draws_differ_where_a_sensor_is_noisy(noise):
    calm = SCENARIO.with_values({"flow": [], "sensor.noise_position": noise})
    tuning = Tuning(calm, 2, 1)
    (tuning.given,) = tuning.runs([tuning.scenario])
    tuning._look_at_given()
    assert tuning.random == (noise > 0)
    assert len(tuning.seeds) == tuning.given.shape[1] == 1 + tuning.random


def run_briefly(folder):
    (folder / "small.toml").write_text(SCENARIO.to_toml())
    numbers = ("--seeds", 1, "--iterations", 12, "--margin", 0)
    return call("tune", folder / "small.toml", *numbers, "--out", folder / "out")


@pytest.mark.parametrize("last", [2, 7])  # the first trial has the given values
def test_a_search_that_is_interrupted_keeps_its_best(tmp_path, monkeypatch, in_a_bowl, last):
    keep = Tuning._keep

    def interrupted(self, trial):
        keep(self, trial)
        if len(self.trials) == last:
            os.kill(os.getpid(), signal.SIGINT)

    monkeypatch.setattr(Tuning, "_keep", interrupted)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell may ignore it
    try:
        ended = run_briefly(tmp_path)
    finally:
        signal.signal(signal.SIGINT, before)
    assert ended.exit_code == 130, ended.output
    assert "interrupted after" in ended.output
    data = xr.load_dataset(tmp_path / "out" / "tune.nc")
    assert last <= data.sizes["trial"] < 48
    found = tuned_in(tmp_path / "out").control.pid.present["heave"].kp
    assert found == pytest.approx(float(data["best"][0]), rel=1e-5)


def test_a_gain_at_the_end_of_its_search_is_noted(tmp_path, monkeypatch, in_a_bowl):
    def sloping(values):
        return 1.0 / values[KEYS[0]], np.array([-WIDTH / values[KEYS[0]], 0.0, 0.0])

    monkeypatch.setitem(globals(), "bowl", sloping)
    ended = run_briefly(tmp_path)
    assert ended.exit_code == 0, ended.output
    assert tuned_in(tmp_path / "out").control.pid.present["heave"].kp == pytest.approx(20.0)
    assert "note: at an end of its range: control.pid.heave.kp. " in ended.stdout


def test_nothing_is_written_where_nothing_can_be_run(tmp_path, monkeypatch):
    def failing(self, scenarios, seeds=None):
        self.failure = "failed at t = 0.14 s"
        return np.full((len(scenarios), 1, 1), np.nan)

    monkeypatch.setattr(TrialRuns, "__call__", failing)
    ended = run_briefly(tmp_path)
    assert ended.exit_code == 3
    assert "failed at t = 0.14 s" in ended.output
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_given_gains_that_cannot_be_run_are_tuned_for_a_margin(tmp_path, monkeypatch, in_a_bowl):
    """Their measures are unknown, and the search begins at others."""
    runs, calls = TrialRuns.__call__, []

    def failing_first(self, scenarios, seeds=None):
        found = runs(self, scenarios, seeds)
        if not calls:
            self.failure, found[:] = "failed at t = 0.33 s", np.nan
        calls.append(self)
        return found

    monkeypatch.setattr(TrialRuns, "__call__", failing_first)
    (tmp_path / "small.toml").write_text(SCENARIO.to_toml())
    numbers = ("--seeds", 1, "--iterations", 4, "--margin", 0.1)
    ended = call("tune", tmp_path / "small.toml", *numbers, "--out", tmp_path / "out")
    assert ended.exit_code == 0, ended.output
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["measures"]["control_cost"]["before"] == [None]
    assert summary["measures"]["control_cost"]["after"][0] < 9.0


# --- the command -----------------------------------------------------------------------------


@pytest.mark.slow
def test_the_tuned_scenario_has_the_best_gains_and_nothing_else_changed(folder, data):
    given, tuned = tunable_numbers(SCENARIO), tunable_numbers(tuned_in(folder))
    np.testing.assert_allclose([*tuned.values()], data["best"], rtol=1e-5)
    assert data["key"].values.tolist() == KEYS == list(given)
    np.testing.assert_allclose(data["given"], [0.02, 0.1, 0.1])
    cost, margin = data["found"].mean("draw").transpose("measure", "trial").values
    best = np.nanargmin(np.where(margin >= MARGIN, cost, np.nan))
    np.testing.assert_allclose(data["best"], data["tried"][best], rtol=1e-5)
    assert tuned_in(folder).with_values(given) == SCENARIO


@pytest.mark.slow
def test_the_margins_are_those_of_the_linear_loop(folder, data):
    for when, scenario in (("before", SCENARIO), ("after", tuned_in(folder))):
        found = find_margins(Prepared(scenario))
        for name in ("modulus", "gain", "phase", "delay"):
            expected = float(found[f"{name}_margin"])
            assert float(data[f"{when}_{name}_margin"]) == pytest.approx(expected, rel=1e-4)
    assert float(data["after_modulus_margin"]) >= MARGIN
    # else it would not have had to be kept to
    assert float(data["found"].sel(measure="margin").min()) < MARGIN


@pytest.mark.release
def test_tuning_gains_in_draws_other_than_its_own(data):
    before, after, _ = data["held_out"].mean("held_out_draw").values
    assert after[0] < 0.9 * before[0]
    assert after[1] < before[1]


@pytest.mark.slow
def test_the_error_without_control_is_that_of_runs_without_it(data):
    for seed, found in zip((5, 6), data["held_out"].values[2, 1], strict=True):
        alone = SCENARIO.with_values({"seed": seed, "control.kind": "none"})
        assert found == pytest.approx(tip_error(simulate(alone)).rms, rel=1e-3)


@pytest.mark.slow
def test_the_figure_shows_the_search(folder, tmp_path):
    check_own(folder / "tune.nc")  # a second search may replace it
    (figure,) = write_report(folder / "tune.nc", tmp_path)
    assert_shows_something(figure)


def test_the_default_weights_are_those_of_the_design():
    described = SCENARIO.with_values({"control.kind": "lqg"})
    assert described.control.lqg.smoothness is None
    numbers = tunable_numbers(described)
    gains = [
        crinoid.closed_loop(each)[0].controller.gains
        for each in (described, described.with_values(numbers))
    ]
    np.testing.assert_allclose(*gains, rtol=1e-6)
