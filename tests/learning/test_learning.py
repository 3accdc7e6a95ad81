"""Policies: their files, gradients through the loop, training that repeats itself."""

import re
from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr

import crinoid
from crinoid.assembly.neural import read_policy
from crinoid.assembly.prepared import Prepared
from crinoid.control.neural import Neural
from crinoid.diagnostics.plausibility import plausibility_warnings
from crinoid.learning import training as module
from crinoid.learning.gradient import TRACE, lambda_returns, new_critic, new_policy
from crinoid.learning.rollout import Learners, evaluate, run_segment
from crinoid.learning.settings import TrainingSettings, default_randomization
from crinoid.learning.training import Training
from crinoid.results.errors import tip_error
from helpers.command import refused, succeeded

pytestmark = pytest.mark.slow

FLOW = {"mean": [0.1, 0.0], "standard_deviation": 0.05, "correlation_time": 0.3}
SCENARIO = crinoid.Scenario(
    title="Small",
    arm={"nodes": 3, "youngs_modulus": 2e6, "damping_time": 0.05},
    base={"tilt_deg": 90.0, "channels": {"slide": {"range": [-0.3, 0.3]}}},
    flow=[FLOW | {"kind": "gauss-markov"}],
    sensor={"delay": 0.02, "noise_position": 1e-4},
    control={"controlled": ["x"], "compare": False},
    simulation={"duration": 0.8, "time_step": 0.02},
)
HOW = TrainingSettings(arms=2, updates=4, draw=default_randomization(SCENARIO))


@pytest.fixture(scope="module", autouse=True)
def _small():
    """Let a training find the equilibria of fewer episodes."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "_TAUGHT", 3)
        patch.setattr(module, "_HELD_OUT", 4)
        yield


@pytest.fixture(scope="module")
def training():
    found = Training(SCENARIO, HOW)
    found.begin()
    return found


@pytest.fixture
def fresh():
    return Training(SCENARIO, HOW)


@pytest.fixture(scope="module")
def finished(training, tmp_path_factory):
    """Train to the end, with what was saved on the way."""
    path = tmp_path_factory.mktemp("half") / "half.npz"

    def report(training):
        if training.updates == 2:
            training.save(path)

    assert not training.run(report, lambda: False)
    return training, path


def neural(weights, values=None, scenario=SCENARIO):
    """Return a scenario under a policy, with other values of keys."""
    given = {"control.kind": "neural", "control.neural.weights": str(weights)}
    return scenario.with_values(given | (values or {}))


def assert_same(one, other):
    for mine, its in zip(jax.tree.leaves(one), jax.tree.leaves(other), strict=True):
        np.testing.assert_array_equal(mine, its)


@pytest.fixture(scope="module")
def file(finished, tmp_path_factory):
    path = tmp_path_factory.mktemp("policy") / "policy.eqx"
    finished[0].write(path)
    return path


def test_random_and_uncertain_numbers_are_drawn():
    draws = default_randomization(SCENARIO)
    assert draws["arm.youngs_modulus"] == pytest.approx((1.4e6, 2.6e6))
    assert draws["flow.0.mean.0"] == pytest.approx((0.05, 0.15))
    assert "flow.0.mean.1" not in draws
    assert draws["sensor.delay"] == pytest.approx((0.01, 0.03))


@pytest.mark.release
def test_training_improves_on_its_teacher(finished):
    training, _ = finished
    first = training.rows[0]
    assert first[1] == pytest.approx(1.0)  # the unit of costs
    assert training.least <= 1.0
    assert np.isfinite(np.array(training.rows)).all()
    assert training.updates == HOW.updates
    assert training.over
    assert training._optimisers.updates == HOW.updates  # the rate decays over all of them


@pytest.mark.release
def test_a_resumed_training_gives_the_same_weights(finished, fresh):
    whole, half = finished
    fresh.restore(half)
    assert fresh.updates == 2
    fresh.run(lambda _: None, lambda: False)
    assert_same(whole.learner, fresh.learner)
    assert fresh.rows == whole.rows


@pytest.mark.release
def test_another_training_and_damaged_checkpoints_are_not_resumed(
    finished, fresh, tmp_path, monkeypatch
):
    _, half = finished
    with monkeypatch.context() as patch:
        patch.setattr(fresh, "settings", replace(HOW, updates=5))
        with pytest.raises(
            crinoid.ScenarioError, match=r"--updates 5; must be 4\. .* or omit --resume"
        ):
            fresh.restore(half)
    path = tmp_path / "half.npz"
    path.write_bytes(half.read_bytes()[:1000])
    with pytest.raises(crinoid.ScenarioError, match="cannot be resumed"):
        fresh.restore(path)
    with np.load(half) as file:
        np.savez(path, **{name: each for name, each in file.items() if name != "good_0"})
    with pytest.raises(crinoid.ScenarioError, match=r"cannot be resumed .*good_0"):
        fresh.restore(path)
    with np.load(half) as file:
        saved = dict(file)
    header = saved["about"].tobytes().replace(b'"gradient"', b'"ppo"')
    np.savez(path, **saved | {"about": np.frombuffer(header, np.uint8)})
    with pytest.raises(crinoid.ScenarioError, match=r'training by "ppo", which .* omit --resume'):
        fresh.restore(path)


def test_slope_is_that_of_differences(training):
    arm = training._episodes.start(7)
    segment = replace(training._segment, steps=20)
    policy = training.learner.policy
    random = np.random.default_rng(0)
    way = jax.tree.map(lambda x: jnp.asarray(random.normal(size=x.shape)), policy.layers)

    @jax.jit
    @jax.value_and_grad
    def cost(along):
        layers = jax.tree.map(lambda x, by: x + along * by, policy.layers, way)
        moved = Neural(segment.observation, eqx.tree_at(lambda p: p.layers, policy, layers))
        return jnp.mean(run_segment(segment, moved, *arm).cost)

    step = 1e-4
    differences = float(cost(step)[0] - cost(-step)[0]) / (2 * step)
    assert cost(0.0)[1] == pytest.approx(differences, rel=1e-5)
    assert abs(differences) > 1e-6


def test_returns_sum_up_later_costs():
    cost, expected = np.random.default_rng(1).normal(size=(2, 1, 5))
    discount = 0.9
    wanted = np.empty(5)
    wanted[4] = expected[0, 4]
    for step in (3, 2, 1, 0):
        mixed = (1 - TRACE) * expected[0, step + 1] + TRACE * wanted[step + 1]
        wanted[step] = (1 - discount) * cost[0, step] + discount * mixed
    found = lambda_returns(jnp.asarray(cost), jnp.asarray(expected), jnp.asarray(discount))
    np.testing.assert_allclose(found[0], wanted, rtol=1e-12)
    # a cost that stays the same is worth just that
    same = lambda_returns(jnp.ones((1, 5)), jnp.ones((1, 5)), jnp.asarray(discount))
    np.testing.assert_allclose(same, 1.0, rtol=1e-12)


def test_arms_together_are_those_in_threads(training):
    # a whole episode, as in an evaluation
    steps = SCENARIO.simulation.steps
    shared = replace(training._segment, steps=steps), training.learner.policy
    threads, together = Learners(), Learners()
    together._pool = None  # as on an accelerator
    arms = training._held_out[:2]
    one, other = (learners.run(evaluate, shared, arms) for learners in (threads, together))
    for a, b in zip(one, other, strict=True):
        np.testing.assert_allclose(b, a, rtol=1e-9)
    assert one[0][0] != one[1][0]


def test_run_under_the_policy_is_the_one_it_was_judged_by(finished, file):
    training, _ = finished
    seed = 1_000_000 - 1  # the first that was held out
    drawn = training._episodes.draw(seed).scenario
    result = crinoid.simulate(neural(file, scenario=drawn))
    segment = replace(training._segment, steps=SCENARIO.simulation.steps)
    _, error = evaluate((segment, training.best.policy), training._held_out[0])
    assert tip_error(result).rms == pytest.approx(float(np.sqrt(error)), rel=0.05)


def test_policy_survives_its_file(finished, file):
    policy, description = read_policy(file)
    assert_same(policy, finished[0].best.policy)
    assert description.actions == [["slide", "m"]]
    assert description.rate_hz == 50.0
    assert description.draw["flow.0.mean.0"] == [pytest.approx(0.05), pytest.approx(0.15)]


def test_draw_without_an_equilibrium_is_left_out(fresh, monkeypatch):
    pool = fresh._episodes
    start, number = pool.start, pool.started

    def some(seed):
        if seed == pool._first + number:
            raise RuntimeError("no static equilibrium")
        return start(seed)

    monkeypatch.setattr(pool, "start", some)
    pool._next(0)
    assert pool.numbers[0] == number + 1


@pytest.mark.parametrize("name", crinoid.scenario.builtin_names())
def test_default_ranges_are_values_of_their_keys(name):
    scenario = crinoid.load(name).cases()[0][1]
    for end in (0, 1):
        scenario.with_values(
            {key: pair[end] for key, pair in default_randomization(scenario).items()}
        )


def test_command_trains_and_writes_its_files(tmp_path):
    out = tmp_path / "out"
    (tmp_path / "small.toml").write_text(SCENARIO.to_toml())
    train = ("train", tmp_path / "small.toml", "--updates", 0, "--arms", 1, "--out", out)
    succeeded(*train)
    names = sorted(path.name for path in out.glob("[!.]*"))
    assert names == ["policy.eqx", "training.nc", "training.npz", "training.png"]
    assert xr.load_dataset(out / "training.nc", engine="netcdf4").attrs["status"] == "ok"
    succeeded(*train, "--resume")
    assert "got --seed 1; must be 0. Use the same settings" in refused(*train, "--seed", 1)
    (out / "policy.eqx").write_text("mine")
    refused(*train)
    assert (out / "policy.eqx").read_text() == "mine"


def test_averages_are_those_of_a_filter_and_new_networks_answer_zero():
    policy = new_policy(2, np.ones(1), 0.02, np.random.default_rng(0))
    policy = eqx.tree_at(lambda p: p.usual, policy, jnp.ones_like(policy.usual))
    zero, one = jnp.zeros(2), jnp.array([1.0, -2.0])
    averages = policy.start(zero)
    for _ in range(50):
        averages = policy.update_memory(averages, one)
    times = np.array([0.02, 0.05, 0.12, 0.3, 0.8, 2.0])
    left = np.exp(-1.0 / times)  # after a second
    np.testing.assert_allclose(averages, np.outer(1 - left, one), rtol=1e-9)
    features = policy.features(averages, one).reshape(-1, 2)
    np.testing.assert_allclose(features.sum(axis=0), one, rtol=1e-12)
    # new networks answer zero
    random = np.random.default_rng(0)
    policy, critic = new_policy(3, np.ones(2), 0.01, random), new_critic(21, random)
    features = jnp.asarray(random.normal(size=21))
    np.testing.assert_array_equal(policy.speed(features), 0.0)
    assert critic(features) == 0.0


def test_an_arm_that_fails_is_put_back(fresh):
    pool = fresh._episodes
    count, (first, second) = pool.started, pool.arms
    moved = [eqx.tree_at(lambda x: x.steps, arm.now, arm.now.steps + 1) for arm in pool.arms]
    pool.ends[:] = 40
    pool.advance(moved, 1, np.array([False, True]))
    assert pool.arms[0].now is moved[0]
    assert pool.arms[1].now is second.now  # where it was
    for _ in range(2):
        pool.advance(moved, 1, np.array([False, True]))
    assert pool.history[0] == [first.now, moved[0], moved[0]]
    pool.advance(moved, 1, np.array([True, True]))
    assert pool.arms[0].now is first.now  # three segments before
    assert pool.tries.tolist() == [1, 4]
    assert pool.started == count
    for _ in range(7):
        pool.advance(moved, 1, np.array([False, True]))
    assert pool.started == count + 1  # given up
    assert pool.tries.tolist() == [1, 0]


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({}, None),
        ({"arm.youngs_modulus": 3e6}, "youngs_modulus = 3e\\+06 .*on 1.4e\\+06 to 2.6e\\+06"),
        ({"load": [{"kind": "tip", "force": [0.1, 0.0]}]}, "load.0.*on none.*"),
        ({"seed": 7, "simulation.duration": 2.0, "control.lqg.smoothness": 0.01}, None),
    ],
)
def test_scenario_that_the_policy_has_not_met_gets_a_note(file, values, words):
    notes = plausibility_warnings(Prepared(neural(file, values)))
    found = [each for each in notes if each.startswith("control.neural.weights")]
    assert len(found) == (words is not None)
    assert not words or re.search(words, found[0])


@pytest.mark.parametrize(
    "name",
    [
        "station-keeping",
        pytest.param("station-keeping-3d", marks=pytest.mark.release),
        pytest.param("reach-under-load", marks=pytest.mark.release),
    ],
)
def test_built_in_policies_fit_their_scenarios(name):
    calm = {"simulation.start": "rest"}
    calm |= {"water.vortices.model": "none"} if name == "station-keeping-3d" else {}
    scenario = crinoid.load(name).with_values({"control.kind": "neural", **calm})
    assert not [each for each in plausibility_warnings(Prepared(scenario)) if "has not met" in each]
    loop, _ = crinoid.closed_loop(scenario)
    assert isinstance(loop.controller, Neural)


@pytest.mark.release
def test_the_built_in_policy_beats_the_pid():
    # upright, the arm has the same shape with its weight and without
    plain = {"control.compare": False, "simulation.start": "rest"}
    scenario = crinoid.load("station-keeping").with_values(plain)
    found = {}
    for kind in ("pid", "neural"):
        case = {"control.kind": kind, "simulation.duration": 12.0}
        found[kind] = tip_error(crinoid.simulate(scenario.with_values(case))).rms
    assert found["neural"] < 0.65 * found["pid"]
