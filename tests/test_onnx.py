"""Policies as graphs of ONNX: another runtime gives the commands of crinoid's own controller."""

import json
import sys
from itertools import pairwise

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import onnx
import onnxruntime
import pytest

from crinoid.assembly.description import POLICY, Description
from crinoid.assembly.weights import write_policy
from crinoid.cli.training import clear_exports
from crinoid.control import Neural, Observation, Seen, Target
from crinoid.control.policy import Dense, Policy
from crinoid.control.seen import Reading
from crinoid.export import write_onnx
from crinoid.export.files import is_own
from crinoid.version import __version__
from test_cli import call
from test_report import save, swaying_arm

ENTRIES, AVERAGES, INPUTS, DRIVEN = 5, 3, 4, (1, 3)
FEATURES = ENTRIES * (AVERAGES + 1)
SIZES = FEATURES, 8, 6, len(DRIVEN)
TOLD = Description(
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

    return Policy(
        centre=drawn(ENTRIES),
        usual=jnp.abs(drawn(FEATURES)),
        kept=jnp.array([0.3, 0.8, 0.95]),
        linear=drawn(len(DRIVEN), FEATURES) / 4,
        layers=tuple(
            Dense(drawn(after, before) / 2, drawn(after)) for before, after in pairwise(SIZES)
        ),
        swing=jnp.array([0.2, 0.5]),
        fastest=jnp.array([0.03, 0.1]),
    )


@pytest.fixture
def policy(tmp_path):
    path = tmp_path / POLICY
    write_policy(path, random_policy(), TOLD)
    return path


class Given(Observation):
    """Observes what a reading says, so that it may be anything."""

    def __call__(self, seen, before):
        return seen.readings["all"].value


def observation():
    return Given((), jnp.asarray(0.02), 2, DRIVEN, (), (), False)


def seen(observed, command, limit):
    time, none = jnp.zeros(()), jnp.zeros(3)
    return Seen(
        *(time, none, time, none, jnp.zeros(INPUTS), Target(none, None, ()), none, command, ()),
        lower=jnp.full(INPUTS, -limit),
        upper=jnp.full(INPUTS, 2 * limit),
        readings={"all": Reading(observed, time)},
    )


def test_another_runtime_gives_the_same_commands(policy, tmp_path):
    (file,) = write_onnx(policy, tmp_path).files
    session = onnxruntime.InferenceSession(file)
    controller = Neural(observation(), random_policy())
    step = eqx.filter_jit(controller.command)
    every = np.random.default_rng(5).normal(size=(20, ENTRIES))
    limit, rows = 0.15, np.array(DRIVEN)
    ours, theirs = jnp.zeros(INPUTS), np.zeros(len(DRIVEN))
    memory = controller.start(seen(jnp.asarray(every[0]), ours, limit))
    averages = np.tile(every[0], (AVERAGES, 1))
    met = moved = 0
    for observed in every:
        now = seen(jnp.asarray(observed), ours, limit)
        ours, memory = step(memory, now)
        lower, upper = np.asarray(now.lower)[rows], np.asarray(now.upper)[rows]
        given = {"observed": observed, "averages": averages, "command": theirs}
        before = theirs
        theirs, averages = session.run(None, given | {"lower": lower, "upper": upper})
        np.testing.assert_allclose(theirs, ours[rows], rtol=0, atol=1e-12)
        np.testing.assert_allclose(averages, memory.averages, rtol=0, atol=1e-12)
        met += np.sum((theirs == lower) | (theirs == upper))
        moved += np.sum(np.abs(theirs - before) > 0.01)
    assert met >= 3
    assert moved >= 10


def test_a_number_that_is_none_gives_none(policy, tmp_path):
    (file,) = write_onnx(policy, tmp_path).files
    two = np.zeros(2)
    given = {"observed": np.full(ENTRIES, np.nan), "averages": np.zeros((AVERAGES, ENTRIES))}
    limits = {"command": two, "lower": two - 1.0, "upper": two + 1.0}
    command, averages = onnxruntime.InferenceSession(file).run(None, given | limits)
    assert np.isnan(command).all()
    assert np.isnan(averages).all()


def test_the_file_is_sound_and_says_what_goes_in_and_out(policy, tmp_path):
    done = call("export", tmp_path, "--to", "onnx")
    assert done.exit_code == 0, done.stderr
    file = tmp_path / "policy.onnx"
    model = onnx.load(file)
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
    assert {name: json.loads(value) for name, value in about.items()} == TOLD._asdict()


def test_own_files_are_replaced_and_those_of_others_stay(policy, tmp_path):
    file = tmp_path / "policy.onnx"
    model = onnx.helper.make_model(onnx.helper.make_graph([], "mine", [], []))
    model.producer_name = "another"
    for content in (model.SerializeToString(), b"", b"text"):
        file.write_bytes(content)
        done = call("export", policy, "--to", "onnx")
        assert done.exit_code == 2
        assert "was not written by crinoid" in done.stderr
        assert file.read_bytes() == content
        clear_exports(tmp_path)
        assert file.exists()
    assert call("export", policy, "--to", "onnx", "--force").exit_code == 0
    assert is_own(file)
    assert call("export", policy, "--to", "onnx", "--out", tmp_path).exit_code == 0
    clear_exports(tmp_path)  # as a training anew does
    assert [path.name for path in tmp_path.iterdir()] == [POLICY]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--to", "onnx", "--instants", "5"], "--instants: goes with results"),
        (["--to", "onnx", "--variables", "tip_error"], "--variables: goes with --to csv"),
        (["--to", "onnx", "--nodes", "0"], "--nodes: goes with --to csv"),
        (["--to", "onxn"], '--to: got "onxn"'),
        (["--to", "csv"], "a policy and no result, takes --to onnx"),
        (["--to", "gltf"], "a policy and no result, takes --to onnx"),
    ],
)
@pytest.mark.parametrize("name", ["", POLICY])
def test_options_that_do_not_go_with_it_are_refused(policy, tmp_path, name, options, words):
    done = call("export", tmp_path / name, *options)
    assert done.exit_code == 2
    (line,) = done.stderr.splitlines()
    assert words in line
    assert list(tmp_path.iterdir()) == [policy]


def test_what_is_no_policy_is_said_in_one_line(policy, tmp_path):
    save(swaying_arm(records=2, duration=1.0, nodes=3), tmp_path / "result.nc")
    (tmp_path / "broken.eqx").write_bytes(policy.read_bytes()[:-9])
    (tmp_path / "empty").mkdir()
    everywhere = {
        "result.nc": "is no policy, takes a file that crinoid train wrote",
        "broken.eqx": "is damaged",
        "empty": "policy.eqx: no such file",
        "nowhere": "nowhere: no such file",
    }
    for name, words in everywhere.items():
        done = call("export", tmp_path / name, "--to", "onnx")
        assert (done.exit_code, len(done.stderr.splitlines())) == (2, 1), done.stderr
        assert done.stderr.startswith(f"crinoid: {tmp_path}")
        assert words in done.stderr
    # a folder of both: each format takes its own
    assert call("export", tmp_path, "--to", "csv").exit_code == 0
    assert call("export", tmp_path, "--to", "onnx").exit_code == 0


def test_an_export_that_fails_leaves_nothing(policy, tmp_path, monkeypatch):
    def broken(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("pathlib.Path.write_bytes", broken)
    done = call("export", policy, "--to", "onnx")
    assert done.exit_code != 0
    assert "No space left" in done.stderr
    assert list(tmp_path.iterdir()) == [policy]


def test_a_missing_library_is_said(policy, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "onnx", None)
    monkeypatch.delitem(sys.modules, "crinoid.export.network", raising=False)
    done = call("export", policy, "--to", "onnx")
    assert done.exit_code == 2
    assert done.stderr == 'crinoid: ONNX is written by onnx: pip install "crinoid[export]"\n'
