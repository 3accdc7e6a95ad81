"""Policies as graphs of ONNX: another runtime gives the commands of crinoid's own controller."""

import json
from itertools import pairwise

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import onnx
import onnxruntime
import pytest

from crinoid.assembly.description import POLICY, Description
from crinoid.assembly.neural import write_policy
from crinoid.cli.folder import clear_own
from crinoid.control import ControllerInput, Neural, Observation, Target
from crinoid.control.controller import Reading
from crinoid.control.neural import Dense, Policy
from crinoid.foundation.version import __version__
from crinoid.results.own_files import is_own
from crinoid.view.export import write_export
from crinoid.view.export.formats import exports_of
from helpers.command import call, refused, succeeded
from helpers.planar_result import swaying_arm
from helpers.studies import save

ENTRIES, AVERAGES, INPUTS, DRIVEN = 5, 3, 4, (1, 3)
FEATURES = ENTRIES * (AVERAGES + 1)
SIZES = FEATURES, 8, 6, len(DRIVEN)
DESCRIPTION = Description(
    observations=[[f"entry_{number}", "m"] for number in range(ENTRIES)],
    actions=[["slide", "m"], ["tilt", "rad"]],
    rate_hz=50.0,
    averages=AVERAGES,
    layers=list(SIZES[1:]),
    scenario={"arm": {"nodes": 3}},
    draw={"arm.youngs_modulus": [1e6, 2e6]},
)


def random_policy():
    random = np.random.default_rng(3)

    def drawn(*shape):
        return jnp.asarray(random.normal(size=shape))

    layers = [Dense(drawn(after, before) / 2, drawn(after)) for before, after in pairwise(SIZES)]
    return Policy(
        centre=drawn(ENTRIES),
        usual=jnp.abs(drawn(FEATURES)),
        kept=jnp.array([0.3, 0.8, 0.95]),
        linear=drawn(len(DRIVEN), FEATURES) / 4,
        layers=tuple(layers),
        swing=jnp.array([0.2, 0.5]),
        fastest=jnp.array([0.03, 0.1]),
    )


@pytest.fixture
def policy(tmp_path):
    path = tmp_path / POLICY
    write_policy(path, random_policy(), DESCRIPTION)
    return path


class Given(Observation):
    """Observes the numbers of a reading, so that they may be any."""

    def __call__(self, seen, before):
        return seen.readings["all"].value


def seen(observed, command, limit):
    time, none = jnp.zeros(()), jnp.zeros(3)
    return ControllerInput(
        *(time, none, time, none, jnp.zeros(INPUTS), Target(none, None, ()), none, command, ()),
        lower=jnp.full(INPUTS, -limit),
        upper=jnp.full(INPUTS, 2 * limit),
        readings={"all": Reading(observed, time)},
    )


def test_another_runtime_gives_the_same_commands(policy, tmp_path):
    (file,) = write_export(policy, tmp_path, "onnx").files
    session = onnxruntime.InferenceSession(file)
    observation = Given((), jnp.asarray(0.02), 2, DRIVEN, (), (), False)
    controller = Neural(observation, random_policy())
    step = eqx.filter_jit(controller.command)
    every = np.random.default_rng(5).normal(size=(20, ENTRIES))
    limit, rows = 0.15, np.array(DRIVEN)
    ours, theirs = jnp.zeros(INPUTS), np.zeros(len(DRIVEN))
    memory = controller.start(seen(jnp.asarray(every[0]), ours, limit))
    averages = np.tile(every[0], (AVERAGES, 1))
    limited = moved = 0
    for observed in every:
        now = seen(jnp.asarray(observed), ours, limit)
        ours, memory = step(memory, now)
        lower, upper = np.asarray(now.lower)[rows], np.asarray(now.upper)[rows]
        given = {"observed": observed, "averages": averages, "command": theirs}
        given |= {"lower": lower, "upper": upper}
        before = theirs
        theirs, averages = session.run(None, given)
        np.testing.assert_allclose(theirs, ours[rows], rtol=0, atol=1e-12)
        np.testing.assert_allclose(averages, memory.averages, rtol=0, atol=1e-12)
        limited += np.sum((theirs == lower) | (theirs == upper))
        moved += np.sum(np.abs(theirs - before) > 0.01)
    assert limited >= 3
    assert moved >= 10
    # an observation that is no number gives none
    command, averages = session.run(None, given | {"observed": np.full(ENTRIES, np.nan)})
    assert np.isnan(command).all()
    assert np.isnan(averages).all()


def test_the_file_is_sound_and_describes_its_inputs_and_outputs(policy, tmp_path):
    succeeded("export", tmp_path, "--to", "onnx")
    model = onnx.load(tmp_path / "policy.onnx")
    onnx.checker.check_model(model, full_check=True)
    shapes = {
        each.name: [size.dim_value for size in each.type.tensor_type.shape.dim]
        for each in (*model.graph.input, *model.graph.output)
    }
    assert shapes == {
        "observed": [ENTRIES],
        "averages": [AVERAGES, ENTRIES],
        **{name: [len(DRIVEN)] for name in ("command", "lower", "upper", "next_command")},
        "next_averages": [AVERAGES, ENTRIES],
    }
    assert {each.data_type for each in model.graph.initializer} == {
        onnx.TensorProto.DOUBLE,
        onnx.TensorProto.INT64,  # shapes
    }
    about = {each.key: each.value for each in model.metadata_props}
    assert about.pop("crinoid_version") == __version__
    assert {name: json.loads(value) for name, value in about.items()} == DESCRIPTION._asdict()


def test_own_files_are_replaced_and_those_of_others_stay(policy, tmp_path):
    file = tmp_path / "policy.onnx"
    model = onnx.helper.make_model(onnx.helper.make_graph([], "mine", [], []))
    model.producer_name = "another"
    for content in (model.SerializeToString(), b"", b"text"):
        file.write_bytes(content)
        assert "was not written by crinoid" in refused("export", policy, "--to", "onnx")
        assert file.read_bytes() == content
        clear_own(tmp_path, exports_of(POLICY))
        assert file.exists()
    succeeded("export", policy, "--to", "onnx", "--force")
    assert is_own(file)
    succeeded("export", policy, "--to", "onnx", "--out", tmp_path)
    clear_own(tmp_path, exports_of(POLICY))  # as another training does
    assert [path.name for path in tmp_path.iterdir()] == [POLICY]


@pytest.mark.usefixtures("policy")
def test_of_a_folder_with_a_result_and_a_policy_each_format_takes_its_own(tmp_path):
    save(swaying_arm(records=2, duration=1.0, nodes=3), tmp_path / "result.nc")
    for kind, name in {"csv": "result.csv", "onnx": "policy.onnx"}.items():
        succeeded("export", tmp_path, "--to", kind)
        assert (tmp_path / name).exists()


def test_an_export_that_fails_leaves_nothing(policy, tmp_path, monkeypatch):
    def broken(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("pathlib.Path.write_bytes", broken)
    ended = call("export", policy, "--to", "onnx")
    assert ended.exit_code != 0
    assert "No space left" in ended.stderr
    assert list(tmp_path.iterdir()) == [policy]
