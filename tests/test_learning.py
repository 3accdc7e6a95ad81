"""Policies: their files, gradients through the loop, training that repeats itself."""

import re
from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

import crinoid
from crinoid.assembly.prepared import Prepared
from crinoid.assembly.weights import read_policy, write_policy
from crinoid.cli.app import app
from crinoid.control.neural import Neural
from crinoid.learning.learner import TRACE, returns
from crinoid.learning.network import new_critic, new_policy
from crinoid.learning.settings import Settings
from crinoid.learning.stage import Crew
from crinoid.learning.stretch import run_stretch, trial
from crinoid.learning.training import Training, trained
from crinoid.learning.usual import usual_draws
from crinoid.metrics import tip_error
from crinoid.plausibility import Facts, doubts
from crinoid.plausibility.policy import POLICY

SCENARIO = crinoid.Scenario.from_toml("""
title = "Small"
[arm]
nodes = 3
youngs_modulus = 2e6
damping_time = 0.05
[base]
tilt_deg = 90.0
[base.channels.slide]
range = [-0.3, 0.3]
[[flow]]
kind = "gauss-markov"
mean = [0.1, 0.0]
standard_deviation = 0.05
correlation_time = 0.3
[sensor]
delay = 0.02
noise_position = 1e-4
[control]
controlled = ["x"]
compare = false
[simulation]
duration = 0.8
time_step = 0.02
""")
HOW = Settings(arms=2, updates=4, draw=usual_draws(SCENARIO))


@pytest.fixture(scope="module")
def training():
    found = Training(SCENARIO, HOW)
    found.begin()
    return found


@pytest.fixture(scope="module")
def finished(training, tmp_path_factory):
    """Train to the end, with what was saved on the way."""
    path = tmp_path_factory.mktemp("half") / "half.npz"

    def report(training):
        if training.updates == 2:
            training.save(path)

    assert not trained(training, report, lambda: False)
    return training, path


@pytest.fixture(scope="module")
def file(finished, tmp_path_factory):
    path = tmp_path_factory.mktemp("policy") / "policy.eqx"
    finished[0].write(path)
    return path


def test_draws_what_is_random_and_uncertain():
    draws = usual_draws(SCENARIO)
    assert draws["arm.youngs_modulus"] == pytest.approx((1.4e6, 2.6e6))
    assert draws["flow.0.mean.0"] == pytest.approx((0.05, 0.15))
    assert "flow.0.mean.1" not in draws
    assert draws["sensor.delay"] == pytest.approx((0.01, 0.03))


def test_training_improves_on_what_it_imitates(finished):
    training, _ = finished
    first = training.rows[0]
    assert first[1] == pytest.approx(1.0)  # the unit of costs
    assert training.least <= 1.0
    assert np.isfinite(np.array(training.rows)).all()
    assert training.updates == HOW.updates
    assert training.over


def test_training_gone_on_with_gives_the_same_weights(finished):
    whole, half = finished
    again = Training(SCENARIO, HOW)
    again.restore(half)
    assert again.updates == 2
    trained(again, lambda _: None, lambda: False)
    for one, other in zip(
        jax.tree.leaves(whole.learner), jax.tree.leaves(again.learner), strict=True
    ):
        np.testing.assert_array_equal(one, other)
    assert again.rows == whole.rows


def test_another_training_is_not_gone_on_with(finished, tmp_path):
    _, half = finished
    other = Training(SCENARIO, replace(HOW, updates=5))
    with pytest.raises(crinoid.ScenarioError, match="got --updates 5, takes 4, or no --resume"):
        other.restore(half)
    broken = tmp_path / "broken.npz"
    broken.write_bytes(half.read_bytes()[:1000])
    with pytest.raises(crinoid.ScenarioError, match="cannot be gone on with"):
        other.restore(broken)


def test_slope_is_that_of_differences(training):
    arm = training._stage.drawn(7)
    course = replace(training._course, steps=20)
    policy = training.learner.policy
    random = np.random.default_rng(0)
    way = jax.tree.map(lambda x: jnp.asarray(random.normal(size=x.shape)), policy.layers)

    @jax.jit
    def cost(along):
        layers = jax.tree.map(lambda x, by: x + along * by, policy.layers, way)
        moved = Neural(course.observation, eqx.tree_at(lambda p: p.layers, policy, layers))
        return jnp.mean(run_stretch(course, moved, *arm).cost)

    step = 1e-4
    differences = float(cost(step) - cost(-step)) / (2 * step)
    assert jax.grad(cost)(0.0) == pytest.approx(differences, rel=1e-5)
    assert abs(differences) > 1e-6


def test_returns_sum_up_what_is_to_come():
    cost, expected = np.random.default_rng(1).normal(size=(2, 1, 5))
    discount = 0.9
    wanted = np.empty(5)
    wanted[4] = expected[0, 4]
    for step in (3, 2, 1, 0):
        mixed = (1 - TRACE) * expected[0, step + 1] + TRACE * wanted[step + 1]
        wanted[step] = (1 - discount) * cost[0, step] + discount * mixed
    found = returns(jnp.asarray(cost), jnp.asarray(expected), jnp.asarray(discount))
    np.testing.assert_allclose(found[0], wanted, rtol=1e-12)
    # what costs the same for ever is worth just that
    same = returns(jnp.ones((1, 5)), jnp.ones((1, 5)), jnp.asarray(discount))
    np.testing.assert_allclose(same, 1.0, rtol=1e-12)


def test_arms_together_are_those_in_threads(training):
    shared = replace(training._course, steps=20), training.learner.policy
    threads, together = Crew(), Crew()
    together._pool = None  # as on an accelerator
    arms = training._held[:2]
    one, other = (crew.each(trial, shared, arms) for crew in (threads, together))
    for a, b in zip(one, other, strict=True):
        np.testing.assert_allclose(b.cost, a.cost, rtol=1e-9)
        np.testing.assert_allclose(b.error, a.error, rtol=1e-9)
    assert one[0].cost != one[1].cost


def test_ppo_learns_within_its_clip(training):
    how = replace(HOW, method="ppo", updates=2)
    one, other = Training(SCENARIO, how), Training(SCENARIO, how)
    for each in (one, other):
        each.learner = replace(training.learner, by_policy=each_state(each, training))
        each._judge()
        each.update()
    same = zip(jax.tree.leaves(one.learner), jax.tree.leaves(other.learner), strict=True)
    assert all(np.array_equal(a, b) for a, b in same)
    assert not np.array_equal(one.learner.policy.linear, training.learner.policy.linear)
    assert np.isfinite(one.learner.spread).all()


def each_state(each, training):
    return each._pace.of_policy.init(training.learner.trained)


def test_run_under_the_policy_is_the_one_it_was_judged_by(finished, file):
    training, _ = finished
    seed = 1_000_000 - 1  # the first that was held out
    values = {"control.kind": "neural", "control.neural.weights": str(file)}
    drawn = training._stage.episode(seed).scenario
    result = crinoid.simulate(drawn.with_values(values))
    course = replace(training._course, steps=SCENARIO.simulation.steps)
    found = run_stretch(course, Neural(course.observation, training.best), *training._held[0])
    judged = np.sqrt(np.mean(np.asarray(found.distance) ** 2))
    assert tip_error(result).rms == pytest.approx(judged, rel=0.05)


def test_policy_survives_its_file(finished, file):
    policy, told = read_policy(file)
    for one, other in zip(jax.tree.leaves(policy), jax.tree.leaves(finished[0].best), strict=True):
        np.testing.assert_array_equal(one, other)
    assert told.actions == [["slide", "m"]]
    assert told.rate_hz == 50.0
    assert told.draw["flow.0.mean.0"] == [pytest.approx(0.05), pytest.approx(0.15)]


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (lambda data: b"nothing", "is no policy"),
        (lambda data: data.replace(b'"version": 1', b'"version": 9', 1), "version 9"),
        (lambda data: data[:-100], "is damaged"),
        (lambda data: data + b"x", "is damaged"),
        (lambda data: data.replace(b'"averages": 6', b'"averages": 5', 1), "is damaged"),
        (lambda data: data.replace(b'"rate_hz"', b'"rate_xx"', 1), "is damaged"),
    ],
)
def test_damaged_policy_is_refused(file, tmp_path, damage, words):
    broken = tmp_path / "broken.eqx"
    broken.write_bytes(damage(file.read_bytes()))
    with pytest.raises(crinoid.ScenarioError, match=f"control.neural.weights.*{words}"):
        read_policy(broken)


def test_policy_with_a_number_that_is_none_is_refused(finished, tmp_path):
    training, _ = finished
    linear = training.best.linear.at[0, 0].set(jnp.nan)
    policy = eqx.tree_at(lambda p: p.linear, training.best, linear)
    write_policy(tmp_path / "nan.eqx", policy, training.description)
    with pytest.raises(crinoid.ScenarioError, match="is damaged"):
        read_policy(tmp_path / "nan.eqx")


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"control.rate_hz": 25.0}, "control.rate_hz: got 25, takes 50"),
        ({"sensors": [{"kind": "wrench"}]}, "it observes error.x"),
        ({"base.channels.heave": {}}, "it observes error.x"),
        ({"control.neural.weights": "/nowhere.eqx"}, "No such file"),
        ({"control.neural.weights": None}, "control.neural.weights: missing"),
    ],
)
def test_policy_of_another_arm_is_refused(file, values, words):
    given = {"control.kind": "neural", "control.neural.weights": str(file)} | values
    with pytest.raises(crinoid.ScenarioError, match=words):
        crinoid.closed_loop(SCENARIO.with_values(given))


@pytest.mark.parametrize(
    ("how", "words"),
    [
        ({"method": "magic"}, '--method: got "magic"'),
        ({"teacher": "hybrid"}, '--teacher: got "hybrid"'),
        ({"arms": 0}, "--arms: got 0"),
        ({"updates": -1}, "--updates: got -1"),
    ],
)
def test_settings_that_cannot_be_are_refused(how, words):
    with pytest.raises(crinoid.ScenarioError, match=words):
        Settings(**how)


def test_checkpoint_that_lacks_numbers_is_refused(finished, tmp_path):
    _, half = finished
    with np.load(half) as file:
        kept = {name: each for name, each in file.items() if name != "good_0"}
    np.savez(tmp_path / "half.npz", **kept)
    with pytest.raises(crinoid.ScenarioError, match=r"cannot be gone on with .*good_0"):
        Training(SCENARIO, HOW).restore(tmp_path / "half.npz")


def test_rate_falls_over_all_steps_of_a_training(training):
    for method, steps in (("gradient", 1), ("ppo", 16)):
        pace = Training(SCENARIO, replace(HOW, method=method, updates=100))._pace
        assert pace.updates == 100 * steps


def test_draw_without_an_equilibrium_is_left_out(training, monkeypatch):
    stage = Training(SCENARIO, HOW)._stage
    drawn, number = stage.drawn, stage.begun

    def some(seed):
        if seed == stage._first + number:
            raise RuntimeError("no static equilibrium")
        return drawn(seed)

    monkeypatch.setattr(stage, "drawn", some)
    stage._next(0)
    assert stage.numbers[0] == number + 1


@pytest.mark.parametrize("name", crinoid.scenario.builtin_names())
def test_usual_draws_are_values_of_their_keys(name):
    scenario = crinoid.load(name).cases()[0][1]
    for end in (0, 1):
        scenario.with_values({key: pair[end] for key, pair in usual_draws(scenario).items()})


@pytest.fixture(scope="module")
def command(tmp_path_factory):
    """Train from the command line, without an update."""
    folder = tmp_path_factory.mktemp("command")
    path = folder / "small.toml"
    path.write_text(SCENARIO.to_toml())

    def run(*options):
        given = [str(path), "--updates", "0", "--arms", "1", "--out", str(folder / "out")]
        return CliRunner().invoke(app, ["train", *given, *options], catch_exceptions=False)

    return run, folder / "out"


def test_command_trains_and_says_what_it_wrote(command):
    run, out = command
    found = run()
    assert found.exit_code == 0, found.output
    assert {path.name for path in out.glob("[!.]*")} == {
        *("policy.eqx", "training.nc", "training.npz", "training.png")
    }
    with xr.open_dataset(out / "training.nc", engine="netcdf4") as data:
        assert data.attrs["status"] == "ok"
    assert run("--resume").exit_code == 0
    other = run("--seed", "1")
    assert other.exit_code == 2
    assert "got --seed 1, takes 0, or --force" in " ".join(other.output.split())
    (out / "policy.eqx").write_text("mine")
    assert run().exit_code == 2
    assert (out / "policy.eqx").read_text() == "mine"


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--draw", "arm.youngs_modulus"], "takes KEY=LOW:HIGH"),
        (["--draw", "arm.youngs_modulus=3:2"], "takes the smaller one first"),
        (["--draw", "seed=1:2", "--draw", "seed=1:2"], "takes each key once"),
        (["--force", "--draw", "arm.density=-1:1000"], "arm.density: got -1"),
        (["--seed", "9999999"], "--seed: got 9999999, takes a number up to"),
        (["--resume", "--out", "nowhere"], "--resume: there is no"),
    ],
)
def test_mistakes_of_the_command_are_one_line(command, options, words):
    run, _ = command
    found = run(*options)
    assert found.exit_code == 2
    assert words in " ".join(found.output.split())


def test_averages_are_those_of_a_filter_and_features_add_up():
    policy = new_policy(2, np.ones(1), 0.02, np.random.default_rng(0))
    policy = eqx.tree_at(lambda p: p.usual, policy, jnp.ones_like(policy.usual))
    zero, one = jnp.zeros(2), jnp.array([1.0, -2.0])
    averages = policy.start(zero)
    for _ in range(50):
        averages = policy.remembered(averages, one)
    times = np.array([0.02, 0.05, 0.12, 0.3, 0.8, 2.0])
    left = np.exp(-1.0 / times)  # after a second
    np.testing.assert_allclose(averages, np.outer(1 - left, one), rtol=1e-9)
    features = policy.features(averages, one).reshape(-1, 2)
    np.testing.assert_allclose(features.sum(axis=0), one, rtol=1e-12)


def test_new_networks_say_nothing():
    random = np.random.default_rng(0)
    policy, critic = new_policy(3, np.ones(2), 0.01, random), new_critic(21, random)
    features = jnp.asarray(random.normal(size=21))
    np.testing.assert_array_equal(policy.speed(features), 0.0)
    assert critic(features) == 0.0


def test_an_arm_that_goes_astray_is_put_back():
    stage = Training(SCENARIO, HOW)._stage
    begun, (first, second) = stage.begun, stage.arms
    moved = [eqx.tree_at(lambda x: x.steps, arm.now, arm.now.steps + 1) for arm in stage.arms]
    stage.ends[:] = 40
    stage.go_on(moved, 1, np.array([False, True]))
    assert stage.arms[0].now is moved[0]
    assert stage.arms[1].now is second.now  # where it was
    for _ in range(2):
        stage.go_on(moved, 1, np.array([False, True]))
    assert stage.earlier[0] == [first.now, moved[0], moved[0]]
    stage.go_on(moved, 1, np.array([True, True]))
    assert stage.arms[0].now is first.now  # three stretches before
    assert stage.tries.tolist() == [1, 4]
    assert stage.begun == begun
    for _ in range(7):
        stage.go_on(moved, 1, np.array([False, True]))
    assert stage.begun == begun + 1  # given up
    assert stage.tries.tolist() == [1, 0]


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({}, None),
        ({"arm.youngs_modulus": 3e6}, "youngs_modulus = 3e\\+06 .*on 1.4e\\+06 to 2.6e\\+06"),
        ({"arm.length": 0.6}, "has not met arm.length = 0.6 .*on 0.5.*, and may fail"),
        ({"load": [{"kind": "tip", "force": [0.1, 0.0]}]}, "load.0.*on none.*"),
        ({"seed": 7, "simulation.duration": 2.0, "control.lqg.smoothness": 0.01}, None),
    ],
)
def test_scenario_that_the_policy_has_not_met_gets_a_note(file, values, words):
    given = {"control.kind": "neural", "control.neural.weights": str(file)} | values
    found = list(POLICY[0].doubts(Facts(Prepared(SCENARIO.with_values(given)))))
    assert len(found) == (words is not None)
    assert not words or re.search(words, found[0])


@pytest.mark.parametrize("name", ["station-keeping", "station-keeping-3d", "reach-under-load"])
def test_policies_that_come_along_fit_their_scenarios(name):
    scenario = crinoid.load(name).with_values({"control.kind": "neural"})
    assert not [each for each in doubts(Prepared(scenario)) if "has not met" in each]
    loop, _ = crinoid.closed_loop(scenario)
    assert isinstance(loop.controller, Neural)


def test_policy_that_comes_along_beats_the_pid():
    scenario = crinoid.load("station-keeping").with_values({"control.compare": False})
    found = {}
    for kind in ("pid", "neural"):
        case = scenario.with_values({"control.kind": kind, "simulation.duration": 12.0})
        found[kind] = tip_error(crinoid.simulate(case)).rms
    assert found["neural"] < 0.65 * found["pid"]
