"""The example with Stable-Baselines3: its adapter is the environment that it adapts."""

import numpy as np
import pytest

import crinoid
from crinoid.learning.environment.reward import Success
from helpers.paths import ROOT
from helpers.scripts import load_script

pytest.importorskip("stable_baselines3", reason="of the libraries only an example needs it")

example = load_script(ROOT / "examples" / "ppo_station_keeping.py")
CHANNELS = {"slide": {"range": [-0.3, 0.1]}, "tilt": {"range_deg": [-30.0, 30.0]}}
FLOW = {"mean": [0.1, 0.0], "standard_deviation": 0.05, "correlation_time": 0.3}
SCENARIO = crinoid.Scenario(
    arm={"nodes": 3, "youngs_modulus": 2e6},
    base={"tilt_deg": 90.0, "channels": CHANNELS},
    flow=[FLOW | {"kind": "gauss-markov"}],
    sensor={"noise_position": 1e-4},
    simulation={"duration": 0.12, "time_step": 0.02},
)
ARMS, SEED, CALLS = 2, 7, 20
LOW, HIGH = np.array([-0.3, -np.pi / 6]), np.array([0.1, np.pi / 6])


def stepped(env, commands):
    """Return the first observations, and all that steps give; where all end, one more starts."""
    first, _ = env.reset(seed=SEED)
    answers = []
    for command in commands:
        answers.append(env.step(command))
        if (answers[-1][2] | answers[-1][3]).all():
            answers.append(env.step(command))
    return first, iter(answers)


def test_steps_and_resets_are_those_of_the_environment():
    env = crinoid.make_vec_env(SCENARIO, ARMS, draws=6)
    every = np.random.default_rng(1).uniform(-1.0, 1.0, (CALLS, ARMS, 2))
    first, answers = stepped(env, LOW + (every + 1.0) / 2.0 * (HIGH - LOW))
    adapted, ended = example.Adapter(env, SEED), 0
    assert adapted.observation_space == env.single_observation_space
    np.testing.assert_array_equal(adapted.reset(), first)
    for actions in every:
        last, reward, terminated, truncated, info = next(answers)
        seen, earned, over, infos = adapted.step(actions)
        # limits of actions have 32 bits
        np.testing.assert_allclose(earned, reward, rtol=0, atol=1e-7)
        np.testing.assert_allclose([each["error"] for each in infos], info["error"], atol=1e-7)
        np.testing.assert_array_equal(over, truncated)
        assert not terminated.any()
        if over.any():
            ended += 1
            assert over.all()
            assert all(each["TimeLimit.truncated"] for each in infos)
            inside = [each["terminal_observation"] for each in infos]
            np.testing.assert_allclose(inside, last, rtol=0, atol=1e-5)
            last, reward, *_ = next(answers)
            np.testing.assert_array_equal(seen, last)
            np.testing.assert_array_equal(reward, 0.0)
        else:
            assert not any("terminal_observation" in each for each in infos)
            np.testing.assert_allclose(seen, last, rtol=0, atol=1e-5)
    assert ended == CALLS // 6


def test_an_arm_that_ends_alone_restarts_a_step_later():
    # the second arm goes away from its target, the first stays at it
    success = Success(time=0.08, position=0.004)
    env = crinoid.make_vec_env(SCENARIO, ARMS, success=success)
    commands = np.array([[0.0, 0.0], [LOW[0], HIGH[1]]])
    _, answers = stepped(env, [commands] * 10)
    adapted, alone = example.Adapter(env, SEED), []
    adapted.reset()
    for last, reward, terminated, truncated, _ in answers:
        seen, earned, over, infos = adapted.step((commands - LOW) / (HIGH - LOW) * 2.0 - 1.0)
        np.testing.assert_allclose(seen, last, rtol=0, atol=1e-5)
        np.testing.assert_allclose(earned, reward, rtol=0, atol=1e-7)
        np.testing.assert_array_equal(over, terminated | truncated)
        alone.append(over.sum())
        for arm in np.flatnonzero(over):
            assert infos[arm]["TimeLimit.truncated"] == truncated[arm]
            np.testing.assert_array_equal(infos[arm]["terminal_observation"], seen[arm])
    assert alone == [0, 0, 0, 1, 0, 1, 0, 0, 1, 0]
