"""Mistakes in environments, trainings and policies: one line each."""

import re
from functools import partial

import equinox as eqx
import jax.numpy as jnp
import pytest

import crinoid
from crinoid.assembly.description import POLICY
from crinoid.assembly.neural import read_policy, write_policy
from crinoid.learning.environment.reward import Success
from crinoid.scenario import builtin_files
from helpers.command import assert_refused
from helpers.planar_result import swaying_arm
from helpers.refusals import mistake
from helpers.studies import save

SMALL = ["arm.nodes=5", 'simulation.start="rest"', 'control.kind="neural"']
ARM = crinoid.load("station-keeping", SMALL)
(BUILT_IN,) = builtin_files("station-keeping")

make_env = partial(crinoid.make_env, ARM)


def loop(**values):
    return lambda: crinoid.closed_loop(ARM.with_values(values))


MISTAKES = [
    (partial(make_env, draw={"arm.length": (2.0, 1.0)}), r"draw: arm.length: got \[2.0, 1.0\]"),
    (partial(make_env, render_mode="human"), 'render_mode: got "human"; must be "rgb_array" or'),
    (partial(make_env, reward=lambda moment: moment.error), "reward: got an array of shape .3,.;"),
    (partial(crinoid.make_env, crinoid.Scenario()), "base.channels: none of the inputs can move"),
    (partial(crinoid.make_vec_env, ARM, 0), "num_envs: got 0; must be"),
    (partial(Success, time=-1.0, position=0.1), "success.time: got -1.0; must be at least 0 s"),
    (partial(Success, time=1.0, position=0.0), "success.position: got 0.0; must be above 0"),
    (partial(Success, time=1.0), "success: requires a position, an angle_deg or both"),
    (loop(**{"control.rate_hz": 25.0}), "control.rate_hz: got 25; must be 100"),
    (loop(sensors=[{"kind": "wrench"}]), "control.neural.weights: .*it observes error.x"),
    (loop(**{"base.channels.heave": {}}), "control.neural.weights: .*it observes error.x"),
    (loop(**{"control.neural.weights": "/nowhere.eqx"}), ".*No such file"),
    (loop(**{"control.neural.weights": None}), "control.neural.weights: missing"),
]


@pytest.mark.parametrize(("call", "line"), MISTAKES, ids=[line for _, line in MISTAKES])
def test_a_mistake_in_python_is_one_line(call, line):
    assert re.match(line, mistake(call))


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (lambda data: b"nothing", "is not a policy"),
        (lambda data: data.replace(b'"version": 1', b'"version": 9', 1), "version 9"),
        (lambda data: data[:-100], "is damaged"),
        (lambda data: re.sub(rb'"layers": \[\d+', b'"layers": [9000000000', data), "is damaged"),
    ],
)
def test_a_damaged_policy_is_refused(tmp_path, damage, words):
    broken = tmp_path / "broken.eqx"
    broken.write_bytes(damage(BUILT_IN.read_bytes()))
    assert re.match(f"control.neural.weights: .*{words}", mistake(read_policy, broken))


def test_a_policy_with_numbers_that_are_none_is_refused(tmp_path):
    policy, description = read_policy(BUILT_IN)
    spoilt = eqx.tree_at(lambda p: p.linear, policy, policy.linear.at[0, 0].set(jnp.nan))
    write_policy(tmp_path / "nan.eqx", spoilt, description)
    assert "is damaged" in mistake(read_policy, tmp_path / "nan.eqx")


COMMANDS = {
    "train arm.toml --draw arm.youngs_modulus": "--draw: .*must be KEY=LOW:HIGH",
    "train arm.toml --draw arm.length=3:2": "--draw: .*must have the smaller number first",
    "train arm.toml --draw seed=1:2 --draw seed=1:2": "--draw: .*must name each key once",
    "train arm.toml --draw arm.density=-1:1000": "arm.density: got -1",
    "train arm.toml --seed 9999999": "--seed: got 9999999; must be from 0 to 1000000",
    "train arm.toml --resume": "--resume: .*training.npz does not exist",
    "train arm.toml --teacher hybrid": '--teacher: got "hybrid"',
    "train arm.toml --arms 0": "--arms: got 0",
    "train arm.toml --updates -1": "--updates: got -1",
    "export . --to onnx --instants 5": "--instants: needs a result",
    "export . --to onnx --nodes 0": "--nodes: needs --to csv",
    "export . --to csv": ".* is a policy. Export it with --to onnx",
    f"export {POLICY} --to gltf": ".* is a policy. Export it with --to onnx",
    "export broken.eqx --to onnx": ".*broken.eqx: is damaged",
    "export result.nc --to onnx": ".*result.nc: is not a policy. Give a file that crinoid",
    "export nowhere --to onnx": ".*nowhere: no such file",
}


@pytest.mark.parametrize("call", COMMANDS)
def test_a_mistake_in_a_command_is_one_line_and_nothing_is_written(tmp_path, monkeypatch, call):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "arm.toml").write_text(ARM.to_toml())
    (tmp_path / POLICY).write_bytes(BUILT_IN.read_bytes())
    (tmp_path / "broken.eqx").write_bytes(BUILT_IN.read_bytes()[:-9])
    if "result.nc" in call:
        save(swaying_arm(records=2, duration=1.0, nodes=3), tmp_path / "result.nc")
    assert_refused(call, COMMANDS[call])
