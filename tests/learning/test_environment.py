"""Environments of Gymnasium: the closed loop, with seeds and draws, of one arm and of many."""

import subprocess
import sys

import gymnasium
import jax.numpy as jnp
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode

import crinoid
from crinoid.control import Controller, pose_error
from crinoid.learning.environment import TASKS, vector
from crinoid.learning.environment.reward import RewardInput, Success, closeness
from helpers.refusals import mistake

FLOW = {"mean": [0.1, 0.1], "standard_deviation": 0.05, "correlation_time": 1.0}
CHAMBER = {"offset": 0.01, "area": 2e-4, "max_pressure": 1e5, "time_constant": 0.1, "pair": True}
SCENARIO = crinoid.Scenario(
    arm={"nodes": 5, "youngs_modulus": 1e6},
    base={
        "channels": {"slide": {"range": [-0.1, 0.1]}, "tilt": {}},
        "motion": [{"channel": "heave", "kind": "sine", "amplitude": 0.01, "frequency_hz": 1.0}],
    },
    chamber=[CHAMBER],
    flow=[FLOW | {"kind": "gauss-markov"}],
    load=[{"kind": "tip", "force": [0.0, 0.0], "start": 0.1}],
    target={"time": [0.0, 0.2], "tip": [[0.5, -10.0], [0.5, -9.95]], "feed_forward": False},
    sensor={"delay": 0.013, "noise_position": 1e-3},
    sensors=[{"kind": "wrench"}],
    control={"rate_hz": 50.0, "start": 0.03, "controlled": ["x", "z"]},
    simulation={"duration": 0.25, "max_halvings": 0},
    output={"interval": 0.01},
)
SMALL = {"arm.nodes": 7, "simulation.duration": 0.1}
EXPECTED = ("is -infinity", "is infinity", "recommend using a symmetric and normalized space")
"""Words of Gymnasium on limits that are those of physics."""
ACTIONS = np.random.default_rng(0).uniform(-0.1, 0.1, (30, 3, 3))
"""Commands of three arms, more than for two episodes."""
BREAKS = {"load.0.force": [-1e5, 0.0]}
"""A force along the arm that folds any."""


@pytest.fixture(scope="module")
def env():
    return crinoid.make_env(SCENARIO, render_mode="rgb_array")


def episode(env, act, **reset):
    """Return observations, rewards and infos of an episode, from the reset on."""
    seen, info = env.reset(**reset)
    found, over = [(seen, 0.0, info)], False
    while not over:
        seen, reward, ended, late, info = env.step(act(seen))
        found.append((seen, reward, info))
        over = ended or late
    seen, rewards, infos = zip(*found, strict=True)
    return np.array(seen), np.array(rewards), infos


def idle(seen):
    return np.zeros(3)


def pushed(seen):
    """Move the tip toward its target."""
    return np.array([seen[0], 2.0 * seen[1], 3.0 * seen[1]])


class Pushed(Controller):
    def start(self, seen):
        return None

    def command(self, memory, seen):
        x, z = pose_error(seen.reference, seen.measured)[:2]
        # slide, heave, tilt and the chamber
        return jnp.stack([x, 0.0, 2.0 * z, 3.0 * z]), None


@pytest.fixture(scope="module")
def run():
    """Return the run of a controller that does the same."""
    return crinoid.simulate(SCENARIO.with_values({"seed": 7}), controller=Pushed())


@pytest.mark.slow
@pytest.mark.parametrize(("act", "controlled"), [(pushed, True), (idle, False)])
def test_an_episode_is_the_closed_loop(env, run, act, controlled):
    data = (run if controlled else run.uncontrolled).dataset
    _, _, infos = episode(env, act, seed=7)
    times = np.array([info["time"] for info in infos])
    assert times == pytest.approx([*np.arange(0.03, 0.25, 0.02), 0.25], abs=1e-12)
    wanted = data["tip_error"].sel(time=times, method="nearest")
    assert [info["error"] for info in infos] == pytest.approx(wanted.values, abs=1e-12)
    del infos[-1]["time"], infos[-1]["error"]
    assert infos[-1] == {"status": "ok", "is_success": False}


def test_observations_have_names_and_units_and_keep_their_limits(env):
    names, space = env.unwrapped.observation_names, env.observation_space
    assert len(names) == len(env.observation_units) == space.shape[0] == len(set(names))
    units = dict(zip(names, env.observation_units, strict=True))
    assert (units["heave.pose"], units["rate.angle"]) == ("m", "rad s-1")
    lower = dict(zip(names, space.low, strict=True))
    assert lower["slide.position"] == lower["slide.command"] == -0.1
    assert lower["chamber_0.state"] == -1.0
    assert lower["error.x"] == -np.inf
    assert env.action_names == ("slide", "tilt", "chamber_0")
    assert env.action_units == ("m", "rad", "1")
    assert env.action_space.low == pytest.approx([-0.1, -np.pi / 3, -1.0])
    env.action_space.seed(1)
    for seed in range(3):
        seen, _, _ = episode(env, lambda _: env.action_space.sample(), seed=seed)
        assert all(row in space for row in seen)


def test_observations_describe_the_arm(env):
    seen, _, infos = episode(env, pushed, seed=7)
    of = dict(zip(env.observation_names, seen.T, strict=True))
    assert of["slide.command"][1:] == pytest.approx(np.clip(of["error.x"][:-1], -0.1, 0.1))
    assert of["rate.x"][0] == 0.0
    # the target is constant in x, so only the tip changes
    assert of["rate.x"][1:-1] == pytest.approx(-np.diff(of["error.x"])[:-1] * 50)
    assert of["error.sin_angle"] ** 2 + of["error.cos_angle"] ** 2 == pytest.approx(1.0)
    assert of["ahead.z"][0] > 0.03
    assert of["ahead.z"][-1] == pytest.approx(0.0, abs=1e-12)
    times = np.array([info["time"] for info in infos])
    assert of["heave.pose"] == pytest.approx(0.01 * np.sin(2 * np.pi * times))


def test_seeds_and_numbers_make_an_episode_without_compiling(env):
    ranges = {"arm.youngs_modulus": (8e5, 1.2e6), "flow.0.mean.0": (0.0, 0.3)}
    options = {"set": {"water.drag_normal": 1.3}, "draw": ranges}
    plain, _, _ = episode(env, idle, seed=3)
    for seed in (None, 4):
        assert np.abs(episode(env, idle, seed=seed)[0] - plain).max() > 1e-4
    compiled = env._advance._cache_size()
    drawn, found = [], []
    for seed in (3, 4, 3):
        drawn.append(episode(env, idle, seed=seed, options=options)[0])
        scenario = env.scenario
        found.append((scenario.arm.youngs_modulus, scenario.flow[0].mean[0]))
        assert scenario.water.drag_normal == 1.3
        for value, (low, high) in zip(found[-1], ranges.values(), strict=True):
            assert low <= value <= high
    assert found[0] == found[2] != found[1]
    assert np.array_equal(drawn[0], drawn[2])
    assert np.abs(drawn[0] - plain).max() > 1e-6
    assert compiled == env._advance._cache_size() == 1
    # those of one reset are gone at the next
    assert np.array_equal(plain, episode(env, idle, seed=3)[0])


SLIDE, RANGE = "base.channels.slide.range", "must be two numbers, the smaller one first"
NAN = float("nan")


@pytest.mark.parametrize(
    ("kind", "numbers", "line"),
    [
        ("set", {"arm.nodes": 7}, "arm.nodes: got 7; must not change the compiled program. Make"),
        ("set", {SLIDE: [-0.2, 0.2]}, f"{SLIDE}: got [-0.2, 0.2]; must not change the limits of"),
        ("sett", {}, 'options: sett: unknown; must be "set" or "draw"'),
        ("set", 3, "options: set: got 3; must be a dictionary of dotted keys"),
        ("draw", {"arm.length": 0.5}, f"options: draw: arm.length: got 0.5; {RANGE}"),
        ("draw", {"arm.length": (0.5, NAN)}, f"options: draw: arm.length: got [0.5, nan]; {RANGE}"),
        ("draw", {"arm.length": (-2.0, -1.0)}, "arm.length: got -"),
    ],
)
def test_wrong_options_are_refused(env, kind, numbers, line):
    assert mistake(env.reset, seed=0, options={kind: numbers}).startswith(line)


def test_wrong_actions_are_refused(env):
    env.reset(seed=0)
    with pytest.raises(ValueError, match=r"^action: got 2 numbers; must be 3: slide \(m\), "):
        env.step([0.0, 0.0])
    with pytest.raises(ValueError, match=r"^action: got \[nan, 0.0, 0.0\]; must be finite"):
        env.step([float("nan"), 0.0, 0.0])
    for wrong in ([1j, 0, 0], ["1", "0", "0"], [True, False, True], [None, 0, 0]):
        with pytest.raises(ValueError, match=r"^action: got .*; must be numbers$"):
            env.step(np.array(wrong) if wrong[0] == 1j else wrong)
    episode(env, idle)
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(np.zeros(3))


def test_a_fork_is_refused(env, monkeypatch):
    env.reset(seed=0)
    monkeypatch.setattr("os.getpid", lambda: -1)
    with pytest.raises(RuntimeError, match=r'get_context\("spawn"\)'):
        env.step([0.0, 0.0, 0.0])


def test_a_failure_ends_an_episode_and_costs_its_rest(env):
    _, rewards, infos = episode(env, idle, seed=0, options={"set": BREAKS})
    assert infos[-1]["time"] < 0.2
    assert infos[-1]["status"].startswith("failed at t = ")
    assert "; try " in infos[-1]["status"]
    left = (0.25 - infos[-1]["time"]) * 50
    assert rewards[-1] == pytest.approx(-1.1 * (1 + left))


def test_pictures_show_the_arm(env):
    env.reset(seed=0)
    first = env.render()
    for _ in range(5):
        env.step([0.1, 1.0, 1.0])
    later = env.render()
    assert first.shape == later.shape == (480, 640, 3)
    assert first.dtype == np.uint8
    assert np.any(first != later, axis=2).sum() > 200


def moment(**given):
    zero = jnp.zeros(())
    usual = {"time": zero, "deviation": zero, "left": zero, "error": jnp.zeros(3)}
    usual |= {"command": jnp.zeros(2), "change": jnp.zeros(2)}
    usual |= {"failed": jnp.asarray(False), "success": jnp.asarray(False)}
    return RewardInput(**usual | {name: jnp.asarray(value) for name, value in given.items()})


def test_the_reward_is_bounded_and_falls_with_the_error():
    errors = [0.0, 0.005, 0.02, 0.1, 1.0, 1e6]
    rewards = [float(closeness(moment(deviation=error))) for error in errors]
    assert rewards == sorted(rewards, reverse=True)
    assert rewards[0] == 0.0
    assert rewards[2] == pytest.approx(-0.25, abs=1e-3)
    assert rewards[-1] == pytest.approx(-1.0)
    assert float(closeness(moment(change=[1.0, 0.0]))) == pytest.approx(-0.05)


MANY = {
    "draw": {"arm.youngs_modulus": (3e5, 1e6)},
    "reward": lambda moment: -moment.deviation - 0.5 * moment.success,
    # which comes for some
    "success": Success(time=0.1, position=0.12),
}


def played(many):
    """Return what many arms answer from the reset on."""
    seen, _ = many.reset(seed=20)
    answers = [many.step(some) for some in ACTIONS]
    assert all(rows in many.observation_space for rows, *_ in answers)
    return seen, answers


@pytest.fixture(scope="module")
def many():
    many = crinoid.make_vec_env(SCENARIO, 3, draws=5, **MANY)
    with pytest.raises(gymnasium.error.ResetNeeded):
        many.step(ACTIONS[0])
    return many


@pytest.fixture(scope="module")
def answered(many):
    return played(many)


@pytest.mark.slow
def test_many_arms_are_those_that_run_alone(answered):
    alone = crinoid.make_env(SCENARIO, **MANY)
    seen, answers = answered
    outcomes = set()
    for arm in range(3):
        draw, fresh = arm, False
        one, _ = alone.reset(seed=20 + draw)
        assert one == pytest.approx(seen[arm], abs=1e-10)
        for some, (rows, rewards, ended, late, infos) in zip(ACTIONS, answers, strict=True):
            if fresh:
                draw = (draw + 3) % 5
                one, info = alone.reset(seed=20 + draw)
                reward, is_ended, is_late = 0.0, False, False
            else:
                one, reward, is_ended, is_late, info = alone.step(some[arm])
            assert one == pytest.approx(rows[arm], abs=1e-10)
            assert reward == pytest.approx(rewards[arm], abs=1e-10)
            assert (is_ended, is_late) == (ended[arm], late[arm])
            for name, value in info.items():
                close = name in ("time", "error")
                assert infos[name][arm] == (pytest.approx(value, abs=1e-10) if close else value)
            fresh = is_ended or is_late
            outcomes |= {(is_ended, is_late)} if fresh else set()
    assert outcomes == {(True, False), (False, True)}


@pytest.mark.slow
def test_many_arms_in_threads_are_those_that_step_together(answered, monkeypatch):
    # as where JAX computes on an accelerator
    monkeypatch.setattr(vector, "on_accelerator", lambda: True)
    seen, answers = played(crinoid.make_vec_env(SCENARIO, 3, draws=5, **MANY))
    assert seen == pytest.approx(answered[0], abs=1e-10)
    for one, other in zip(answered[1], answers, strict=True):
        for mine, its in zip(one[:2], other[:2], strict=True):
            assert its == pytest.approx(mine, abs=1e-10)
        for mine, its in zip(one[2:4], other[2:4], strict=True):
            assert np.array_equal(mine, its)


@pytest.mark.slow
def test_many_arms_report_failures(many):
    assert many.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    many.reset(seed=0, options={"set": BREAKS})
    for _ in range(12):
        _, _, ended, _, infos = many.step(np.zeros((3, 3)))
        if ended.any():
            break
    assert ended.all()
    assert all(status.startswith("failed at t = ") for status in infos["status"])
    with pytest.raises(ValueError, match=r"^action: got the shape \(3,\); must be \(3, 3\)"):
        many.step(np.zeros(3))
    many.close()


@pytest.mark.slow
@pytest.mark.parametrize("name", [None, "StationKeeping3D"])
def test_gymnasium_finds_nothing_wrong(env, name, recwarn):
    if name is not None:
        env = gymnasium.make(f"crinoid:crinoid/{name}-v0", values=SMALL).unwrapped
    check_env(env, skip_render_check=True)
    said = [str(warning.message) for warning in recwarn]
    assert [words for words in said if not any(part in words for part in EXPECTED)] == []


def test_stable_baselines_finds_nothing_wrong(env, recwarn):
    checker = pytest.importorskip(
        "stable_baselines3.common.env_checker", reason="Stable-Baselines3 is not installed"
    )
    scaled = gymnasium.wrappers.RescaleAction(env, -1.0, 1.0)
    recwarn.clear()  # the wrapper warns of its numbers
    checker.check_env(scaled)
    assert [str(warning.message) for warning in recwarn] == []


def test_targets_of_tasks_are_drawn():
    for name in ("crinoid/Reach-v0", "crinoid/Reach3D-v0"):
        task = TASKS[name]
        scenario = crinoid.load(task.scenario).with_values(task.values)
        # a key for each axis, whose value is within its range
        assert len(task.draw) == scenario.arm.dimension
        for (low, high), value in zip(task.draw.values(), scenario.target.tip, strict=True):
            assert low <= value <= high


@pytest.mark.parametrize(
    ("program", "said"),
    [
        (
            "import crinoid; assert 'gymnasium' not in sys.modules; "
            "sys.modules['gymnasium'] = None; crinoid.make_env",
            'environments need Gymnasium: pip install "crinoid[learn]"\n',
        ),
        # as gymnasium.make("crinoid:crinoid/SwingUp-v0") does
        (
            "import gymnasium, crinoid; sys.exit(str(gymnasium.spec('crinoid/SwingUp-v0').kwargs))",
            "{'task': 'crinoid/SwingUp-v0'}\n",
        ),
    ],
)
def test_gymnasium_is_loaded_on_demand(program, said):
    command = [sys.executable, "-c", f"import sys; {program}"]
    assert subprocess.run(command, capture_output=True, text=True).stderr.endswith(said)
