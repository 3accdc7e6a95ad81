"""Benchmarks at a tiny size: their rows are there, finite and positive; no time is judged."""

import json
import math

import jax
import jax.numpy as jnp
import pytest

from benchmarks import engines
from benchmarks.command import app, run_benchmarks
from benchmarks.measurement import Row, Scope, in_turn, row
from benchmarks.registry import BENCHMARKS
from benchmarks.releases import RELEASES
from benchmarks.start import equations
from helpers.command import refused, succeeded

TINY = Scope(repeats=2, nodes=(5, 9), duration=0.2, arms=2, seeds=1, most=2)
FEW = {
    "controllers": TINY._replace(most=1),
    "gradient": TINY._replace(most=1),
    "optimise": TINY._replace(most=1),
    "precision": TINY._replace(most=1),
    "step": TINY._replace(most=1),
    # the error of a path counts from 2 s on
    "tasks": TINY._replace(most=1, duration=2.5),
}
NAMES = {
    "precision": {release.name for release in RELEASES},
    "step": {"plane, closed loop", "plane, bare step", "plane, vortices"},
    "batch": {"whole runs, moving", "bare steps, one by one", "bare steps, together (vmap)"},
    "gradient": {"plane, run", "plane, gradient by all numbers"},
    "optimise": {"gains, grid", "gains, optimise"},
    "start": {"import crinoid, first time", "import jax, later", "time step, plane"},
    "controllers": {"station-keeping, neural", "0.08 m/s, none, vortices"},
    "tasks": {"trace"},
}


def test_every_benchmark_has_a_test():
    assert set(NAMES) == set(BENCHMARKS)


def test_values_are_summed_up_over_repeats_that_run_in_turn():
    calls = []
    times = in_turn([lambda: calls.append("a"), lambda: calls.append("b")], 2)
    assert calls == ["a", "b"] * 3  # the first ones do not count
    assert times.shape == (2, 2)
    assert row("x", "time", "s", [3.0, 1.0, 2.0], nodes=5)[3:6] == (2.0, 1.0, 3.0)


def test_equations_of_parts_count_too():
    def wave(x):
        return jnp.sin(x) + 1.0  # two

    def program(x):
        return jax.lax.map(wave, x) * 2.0 + jax.jit(wave)(x)

    # a loop and a call, each of two equations, a product and a sum
    assert equations(jax.make_jaxpr(program)(jnp.ones(3)).jaxpr) == 2 + 2 * 2 + 2


@pytest.mark.slow
def test_a_command_writes_rows_conditions_and_a_figure(tmp_path):
    folder = tmp_path / "bench"
    assert run_benchmarks(["start"], folder, peers=False, force=False, scope=TINY) == ""
    found = json.loads((folder / "bench.json").read_text("utf-8"))
    assert set(found) == {
        *("command", "status", "date", "machine", "versions", "peers", "benchmarks")
    }
    assert found["machine"]["cores"] >= 1
    assert found["versions"].keys() >= {"crinoid", "Python", "jax", "numpy"}
    rows = found["benchmarks"]["start"]["rows"]
    assert {each["name"] for each in rows} >= NAMES["start"]
    assert rows[0].keys() == set(Row._fields)
    assert (folder / "start.png").stat().st_size > 1000
    assert "contains benchmarks" in refused("start", "--out", folder, of=app)


def test_what_is_done_is_kept_after_an_interruption(tmp_path, monkeypatch):
    def interrupted(scope):
        yield row("first", "time", "s", [1.0])
        raise KeyboardInterrupt

    monkeypatch.setattr(BENCHMARKS["step"], "benchmark", interrupted)
    ended = run_benchmarks(["step", "start"], tmp_path, peers=False, force=False, scope=TINY)
    assert ended.startswith("interrupted in step")
    found = json.loads((tmp_path / "bench.json").read_text("utf-8"))
    assert found["status"] == ended
    assert [each["name"] for each in found["benchmarks"]["step"]["rows"]] == ["first"]


@pytest.mark.slow
def test_a_failure_is_reported_and_the_others_run(tmp_path, monkeypatch):
    def failing(scope):
        yield row("first", "time", "s", [1.0])
        raise RuntimeError("a step failed")

    monkeypatch.setattr(BENCHMARKS["step"], "benchmark", failing)
    ended = run_benchmarks(["step", "start"], tmp_path, peers=False, force=False, scope=TINY)
    assert ended == "step: a step failed"
    assert (tmp_path / "start.png").exists()


def test_the_list_names_all_and_another_name_is_refused():
    listed = succeeded("--list", of=app)
    assert [line.split()[0] for line in listed.splitlines()] == list(BENCHMARKS)
    line = refused("stepp", of=app)
    assert line.startswith('crinoid: NAME: got "stepp"; must be "precision", "step", ')


def test_a_peer_that_is_not_installed_is_a_line(monkeypatch):
    monkeypatch.setattr(engines, "PEERS", {"nothing": engines.PEERS["mujoco"]})
    found, (line,) = engines.find_peers()
    assert found == ()
    assert line.startswith("nothing is left out (")
    assert line.endswith("pip install -e '.[peers]'")


@pytest.mark.parametrize("name", engines.PEERS)
def test_a_peer_lets_the_arm_fall(name):
    program = pytest.importorskip(f"validation.peers.{name}", exc_type=ImportError).prepare
    engine = engines.PEERS[name]._replace(program=program)
    for release in RELEASES:
        if release.name in engine.states:
            short = release._replace(duration=0.2)
            tips, seconds = engine.prepare(short, engine.meshes[0], 0.0005)()
            assert tips.shape == (2, 3 if "space" in release.name else 2)
            assert -0.05 < tips[-1, -1] < tips[0, -1]
            assert seconds > 0


@pytest.mark.release
@pytest.mark.parametrize("name", [name for name in BENCHMARKS if name != "start"])
def test_a_benchmark_yields_its_rows(name):
    found = BENCHMARKS[name].benchmark(FEW.get(name, TINY))
    rows = [each for each in found if isinstance(each, Row)]
    assert NAMES[name] <= {each.name for each in rows}
    for each in rows:
        assert -math.inf < each.least <= each.median <= each.most < math.inf
        # shares of runs may be none, and the power of a time is anything where nothing is long
        assert each.least > 0 or each.unit == "1"
