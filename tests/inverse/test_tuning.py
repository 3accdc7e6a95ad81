"""Tuning of gains: the slope of the cost, the search, and what the command writes."""

import signal
import time
from itertools import count

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr

import crinoid
from crinoid.analysis.margins import find_margins
from crinoid.assembly.prepared import Prepared
from crinoid.cli.folder import check_own
from crinoid.inverse import tuning as module
from crinoid.inverse.constrained_search import constrain
from crinoid.inverse.gain_design import Cost, CostWeights, GainDesign, cost
from crinoid.inverse.gain_search import GainTrial, bounds, descend, nearest
from crinoid.inverse.tuning import STARTS, Tuning
from crinoid.results.errors import tip_error
from crinoid.scenario import Scenario
from crinoid.simulation import simulate
from crinoid.view.figures import write_report
from helpers.arms import QUICKLY
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


@pytest.fixture(scope="module")
def search(folder):
    """Return a search that reuses the compiled program of the command."""
    return Tuning(SCENARIO, 2, 6, MARGIN)


# the horizon of a predictive controller compiles slowly
@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "h"),
    [
        ("pid", 1e-3),
        pytest.param("lqg", 3e-4, marks=pytest.mark.release),
        pytest.param("mpc", 3e-4, marks=pytest.mark.release),
    ],
)
def test_the_slope_of_the_cost_is_that_of_central_differences(search, kind, h):
    tuning = search
    if kind != "pid":
        # gentle enough for no limit to begin or end to be met between the differences
        weight = {f"control.{kind}.smoothness": 0.02}
        values = {"control.kind": kind, "control.mpc.horizon": 0.2} | weight
        tuning = Tuning(SCENARIO.with_values(values), 1, 1)
        names = [f"control.{kind}.{name}" for name in ("smoothness", "integral_time")]
        assert list(tuning.initial) == names
    draw, design = tuning.draws[0], tuning._design

    def at(controller):
        return cost(controller, controllers.slopes, draw.loop, draw.state, tuning._weights, 50)

    none = np.zeros(len(design.initial))
    controllers = design.perturbations(none)
    found = at(controllers.nominal)
    assert found.converged
    more, less = (
        np.array([at(design.controller(step)).total for step in sign * h * np.eye(none.size)])
        for sign in (1, -1)
    )
    assert (more != less).all()
    # tolerance: that of both steps, and of the design's round-off
    np.testing.assert_allclose(found.gradient, (more - less) / (2 * h), rtol=1e-4)


run_without_slopes = eqx.filter_jit(crinoid.rollout, compiler_options=QUICKLY)


@pytest.mark.slow
@pytest.mark.parametrize(("begin", "first"), [(0.0, 0), (0.42, 20)])
def test_the_cost_is_error_and_effort_from_the_time_that_is_judged(search, begin, first):
    draw = search.draws[0]
    controllers = search._design.perturbations(np.zeros(3))
    judged = search.scenario.with_values({"target.judged_from": begin})
    weights = CostWeights.of(judged, draw.loop)
    found = cost(controllers.nominal, controllers.slopes, draw.loop, draw.state, weights, 50)
    seen = run_without_slopes(draw.loop, draw.state, 50).kept
    z, angle = seen.error[first:, 1], 0.5 * seen.error[first:, 2]
    speed = np.diff(seen.command, axis=0, prepend=0.0)[first:, 1:] * [1.0, 0.5] / 0.02
    expected = np.mean(z**2 + angle**2) + 1e-4 * np.mean(np.sum(speed**2, axis=1))
    np.testing.assert_allclose(found.total, expected, rtol=1e-9)
    np.testing.assert_allclose(found.error, np.mean(seen.error[first:, 0] ** 2 + z**2), rtol=1e-9)


# --- the search ------------------------------------------------------------------------------


def bowl(controller, slopes, loop, state, weights, steps):
    """Return a cost that is least at ten times the gains, and none where one is above 1.3."""
    gains = np.array([controller.kp[1], controller.ki[1], controller.ki[2]])
    away = np.log(gains / [0.2, 1.0, 1.0])
    total = np.nan if (gains > 1.3).any() else 1.0 + np.sum(away**2)
    numbers = (total, 2 * away, total, bool(np.isfinite(total)), 1, 7)
    return Cost(*map(jnp.asarray, numbers))


@pytest.mark.slow
def test_the_search_keeps_the_best_gains_and_leaves_those_that_fail(search, monkeypatch):
    monkeypatch.setattr(module, "cost", bowl)
    tuning = Tuning(search.scenario, 1, 30)
    tuning.run(lambda *_: None, lambda: False)
    failed = STARTS.index(16.0)  # its integral gains are 1.6 from the start
    assert np.isnan(tuning.cost[failed]).all()
    assert tuning.trials[failed] == 1
    assert tuning.failure.startswith("failed at t = 0.14 s: ")
    others = np.delete(tuning.cost, failed, axis=0)
    np.testing.assert_allclose(np.nanmin(others, axis=1), 1.0, rtol=1e-3)  # each got there
    assert tuning.least == np.nanmin(tuning.cost)
    least = tuning.logs[tuning.cost == tuning.least]  # several, to round-off
    assert (least == tuning.best).all(axis=1).any()
    np.testing.assert_allclose(np.exp(tuning.best), 10.0, rtol=0.05)
    given = tuning.tuned()["control.pid.heave.kp"]
    assert given == pytest.approx(0.02 * np.exp(tuning.best[0]), rel=1e-5)


def test_the_nearest_allowed_numbers_are_sought_in_a_limited_number_of_tries():
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
    seen = []

    def attempt(x):
        seen.append(x)
        far = float(np.linalg.norm(x))
        value = np.nan if far > 2 else (x[0] - 3) ** 2 + (x[1] - 1) ** 2
        return GainTrial(value, 2 * (x - [3.0, 1.0]), 0.5 * (far**2 - 1), x)

    constrain(attempt, np.array([0.2, 0.1]), bounds(np.zeros(2)))
    np.testing.assert_allclose(seen[-1], np.array([3.0, 1.0]) / np.sqrt(10), atol=0.02)
    # a penalty limits the excess by its weight
    descend(attempt, np.array([0.2, 0.1]))
    assert 1.0 < np.linalg.norm(seen[-1]) < 1.25
    found = nearest(lambda x: (0.5 * float(x @ x - 1), x), np.array([1.2, 1.6]))
    np.testing.assert_allclose(found, [0.6, 0.8], atol=0.02)


@pytest.mark.slow
def test_the_nearness_has_the_slope_of_its_differences_and_bounds_the_margin(search):
    def near(logs):
        return stability.excess(design.perturbations(logs), MARGIN)

    stability, design = search._stability, search._design
    logs = np.log([5.0, 8.0, 3.0])
    found = near(logs)
    assert found.margin.stable
    # tolerance: that of fewer frequencies
    assert found.excess > 1 - found.margin.modulus / MARGIN - 2e-3 > 0.1
    between = [(near(logs + h).excess - near(logs - h).excess) / 2e-2 for h in 1e-2 * np.eye(3)]
    np.testing.assert_allclose(found.gradient, between, rtol=0.01, atol=1e-4)
    assert stability.shortfall(found.margin, MARGIN) > 0.1
    # one that is well away from -1 but would not bear late commands is no good either
    brief = found.margin._replace(modulus=0.9, delay=0.5 * stability._late)
    assert stability.shortfall(brief, MARGIN) == pytest.approx(0.5)
    assert stability.shortfall(brief._replace(delay=3 * stability._late), MARGIN) < 0
    unstable = near(logs + 3.0)
    assert not unstable.margin.stable
    assert unstable.excess >= 1
    assert unstable.gradient.sum() > 0  # smaller gains grow more slowly


@pytest.mark.slow
@pytest.mark.parametrize("noise", [0.0, 1e-3])
def test_draws_differ_where_a_sensor_is_noisy(search, noise):
    calm = search.scenario.with_values({"flow": [], "sensor.noise_position": noise})
    assert Tuning(calm, 2, 1).random == (noise > 0)


def run_briefly(folder, monkeypatch, cost):
    """Call the command with another cost."""
    (folder / "small.toml").write_text(SCENARIO.to_toml())
    monkeypatch.setattr(module, "cost", cost)
    numbers = ("--seeds", 1, "--iterations", 12, "--margin", 0)
    return call("tune", folder / "small.toml", *numbers, "--out", folder / "out")


@pytest.mark.slow
@pytest.mark.parametrize("last", [2, 7])  # the first trial has the given values
def test_a_search_that_is_interrupted_keeps_its_best(tmp_path, monkeypatch, last):
    calls = count(1)

    def interrupted(*arguments):
        number = next(calls)
        time.sleep(0.05)  # by then there is something to save
        if number == last:
            signal.raise_signal(signal.SIGINT)
        return bowl(*arguments)

    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell may ignore it
    try:
        ended = run_briefly(tmp_path, monkeypatch, interrupted)
    finally:
        signal.signal(signal.SIGINT, before)
    assert ended.exit_code == 130, ended.output
    assert "interrupted after" in ended.output
    data = xr.load_dataset(tmp_path / "out" / "tune.nc")
    assert 1 <= data.sizes["iteration"] < 12
    found = tuned_in(tmp_path / "out").control.pid.present["heave"].kp
    assert found == pytest.approx(float(data["tuned"][0]), rel=1e-5)


def sloping(*arguments):
    """Return a cost that falls with the first gain without end."""
    gain = float(arguments[0].kp[1])
    numbers = (1.0 / gain, np.array([-1.0 / gain, 0.0, 0.0]), 1.0, True, 1, 50)
    return Cost(*map(jnp.asarray, numbers))


@pytest.mark.slow
def test_a_gain_at_the_end_of_its_search_is_noted(tmp_path, monkeypatch):
    ended = run_briefly(tmp_path, monkeypatch, sloping)
    assert ended.exit_code == 0, ended.output
    data = xr.load_dataset(tmp_path / "out" / "tune.nc")
    assert float(data["tuned"][0] / data["given"][0]) == pytest.approx(1e3, rel=1e-3)
    assert data.attrs["at_end"] == "control.pid.heave.kp"
    assert "note: at an end of the search: control.pid.heave.kp. " in ended.stdout


def failing(*arguments):
    found = bowl(*arguments)
    nothing = jnp.full_like(found.total, jnp.nan)
    return eqx.tree_at(lambda x: (x.total, x.converged), found, (nothing, jnp.asarray(False)))


def test_nothing_is_written_where_nothing_can_be_run(tmp_path, monkeypatch):
    ended = run_briefly(tmp_path, monkeypatch, failing)
    assert ended.exit_code == 3
    assert "failed at t = 0.14 s" in ended.output
    assert not (tmp_path / "out").exists()


# --- the command -----------------------------------------------------------------------------


@pytest.mark.slow
def test_the_tuned_scenario_has_the_best_gains_and_nothing_else_changed(folder, data):
    def gains(scenario):
        of = scenario.control.pid.present
        return {key: getattr(of[name], gain) for key in keys for name, gain in [key.split(".")]}

    keys = ["heave.kp", "heave.ki", "tilt.ki"]
    given, tuned = SCENARIO, tuned_in(folder)
    np.testing.assert_allclose(list(gains(tuned).values()), data["tuned"], rtol=1e-5)
    assert data["key"].values.tolist() == keys
    np.testing.assert_allclose(data["given"], [0.02, 0.1, 0.1])
    kept = data["cost"].where(data["modulus"] >= MARGIN)
    start, iteration = np.unravel_index(np.nanargmin(kept), kept.shape)
    np.testing.assert_allclose(data["tuned"], data["tried"][start, iteration], rtol=1e-12)
    back = {f"control.pid.{key}": gain for key, gain in gains(given).items()}
    assert tuned.with_values(back) == given


@pytest.mark.slow
def test_the_margins_are_those_of_the_linear_loop(folder, data):
    for when, scenario in (("before", SCENARIO), ("after", tuned_in(folder))):
        found = find_margins(Prepared(scenario))
        for name in ("modulus", "gain", "phase", "delay"):
            expected = float(found[f"{name}_margin"])
            assert float(data[f"{when}_{name}_margin"]) == pytest.approx(expected, rel=1e-4)
    assert float(data["after_modulus_margin"]) >= MARGIN
    # else it would not have had to be kept to
    assert np.nanmin(data["modulus"]) < MARGIN


@pytest.mark.release
def test_tuning_gains_in_draws_other_than_its_own(data):
    assert float(data["after"].mean()) < 0.9 * float(data["before"].mean())
    assert float(data["after_error"].mean()) < float(data["before_error"].mean())


@pytest.mark.slow
def test_the_error_without_control_is_that_of_runs_without_it(data):
    for seed, found in zip((5, 6), data["uncontrolled_error"].values, strict=True):
        alone = SCENARIO.with_values({"seed": seed, "control.kind": "none"})
        assert found == pytest.approx(tip_error(simulate(alone)).rms, rel=1e-3)


@pytest.mark.slow
def test_the_figure_shows_the_search(folder, tmp_path):
    check_own(folder / "tune.nc")  # a second search may replace it
    (figure,) = write_report(folder / "tune.nc", tmp_path)
    assert_shows_something(figure)


@pytest.mark.slow
def test_the_default_weights_are_those_of_the_design():
    described = SCENARIO.with_values({"control.kind": "lqg"})
    design = GainDesign(Tuning(described, 1, 1)._design._plan)
    assert design._plan.scenario.control.lqg.smoothness is None
    gains = crinoid.closed_loop(described)[0].controller.gains
    np.testing.assert_allclose(design.controller(np.zeros(2)).gains, gains, rtol=1e-6)
