"""Compiled programs between processes: the same results, and nothing run that cannot be trusted."""

import os
import signal
import stat
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from contextvars import copy_context
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from crinoid.compilation import Store, compiled, keep_programs
from crinoid.compilation import store as keys
from crinoid.compilation.store import STORE

KEY = b"key"
traces: list[int] = []


class Spring(eqx.Module):
    """A tree with arrays, a static field, something that is missing and a random key."""

    stiffness: jax.Array
    seed: jax.Array
    power: int = eqx.field(static=True)
    damping: jax.Array | None = None


Spring.__module__ = "crinoid.made_up"  # as if it were crinoid's own


def spring(power: int = 2, **changes: jax.Array) -> Spring:
    fields = {"stiffness": jnp.linspace(1.0, 2.0, 5), "seed": jax.random.key(3)} | changes
    return Spring(power=power, **fields)


def pulled(spring, by, repeats):
    traces.append(repeats)
    noise = jax.random.normal(spring.seed, by.shape)
    count = repeats if isinstance(repeats, int) else len(repeats)
    force = sum(spring.stiffness * by**spring.power + noise for _ in range(count))
    return eqx.tree_at(lambda s: s.stiffness, spring, force), repeats, None, {"mean": force.mean()}


pulled.__module__ = "crinoid.made_up"


def programs_in(store: Store) -> list[Path]:
    return list(store.folder.glob("*.program"))


@pytest.fixture
def store(tmp_path, monkeypatch):
    """Keep programs in a new folder for the time of a test."""
    monkeypatch.setitem(sys.modules, "crinoid.made_up", sys.modules[__name__])
    # this tree is edited while its tests are run
    monkeypatch.setattr(keys, "_IMPORT_TIME", time.time() + 60)
    traces.clear()
    store = Store(tmp_path / "programs")
    token = STORE.set(store)
    yield store
    STORE.reset(token)


BY = jnp.linspace(0.0, 1.0, 5) ** 0.5


def in_a_new_process(function=pulled, **options):
    """Return the function as a process has it that has compiled nothing yet."""
    keys.key_of.cache_clear()
    return compiled(**options)(function)


def test_a_kept_program_gives_the_same_bits_and_is_not_traced_again(store):
    expected = eqx.filter_jit(pulled)(spring(), BY, 3)
    traces.clear()
    for repeat in range(2):
        found = in_a_new_process()(spring(), BY, 3)
        assert traces == [3]
        assert jax.tree.structure(found) == jax.tree.structure(expected), repeat
        assert eqx.tree_equal(found, expected)
    # an output serves as an input
    again, *_ = in_a_new_process()(found[0], BY, 3)
    assert traces == [3]
    assert not np.array_equal(again.stiffness, found[0].stiffness)


def test_other_inputs_options_and_versions_are_other_programs(store, monkeypatch):
    run = in_a_new_process()
    for change in (
        lambda: run(spring(), BY, 1),
        lambda: run(spring(), BY, 2),  # what is no array
        lambda: run(spring(power=3), BY, 2),  # a static field
        lambda: run(spring(damping=jnp.ones(())), BY, 2),  # the structure
        lambda: run(spring(stiffness=jnp.ones(1)), BY, 2),  # a shape
        lambda: run(spring(), jnp.ones(5, int), 2),  # a type
        lambda: in_a_new_process(xla_backend_optimization_level=0)(spring(), BY, 2),
    ):
        before = len(traces)
        change()
        assert len(traces) == before + 1
        change()
        assert len(traces) == before + 1
    assert len(programs_in(store)) == len(traces)

    count = len(traces)
    others = {
        "crinoid.foundation.version.__version__": "0.0.0",
        "crinoid.compilation.store._processor": list,
    }
    for number, (name, value) in enumerate(others.items(), start=1):
        with monkeypatch.context() as other:
            other.setattr(name, value)
            keys._surroundings.cache_clear()
            in_a_new_process()(spring(), BY, 1)
        keys._surroundings.cache_clear()
        assert len(traces) == count + number, name
    with jax.default_matmul_precision("float32"):
        in_a_new_process()(spring(), BY, 1)
    assert len(traces) == count + 3


def test_a_program_compiled_ahead_is_the_one_that_is_called(store):
    (expected, *_) = in_a_new_process()(spring(), BY, 1)
    store.remove(bytes.fromhex(programs_in(store)[0].stem))
    run = in_a_new_process()
    assert run.will_compile(spring(), BY, 1)
    traces.clear()
    run.compile_ahead(spring(), np.zeros(5), 1)  # other numbers
    assert traces == [1]  # here, and not in the thread
    found, *_ = run(spring(), BY, 1)
    assert traces == [1]
    np.testing.assert_array_equal(found.stiffness, expected.stiffness)
    assert jax.config.values["jax_enable_compilation_cache"]
    for later in (run, in_a_new_process()):
        assert not later.will_compile(spring(), BY, 1)
        later.compile_ahead(spring(), BY, 1)
        later(spring(), BY, 1)
    assert traces == [1]


def test_a_call_compiles_what_cannot_be_compiled_ahead(store, monkeypatch, capfd):
    def fail(*_: object) -> None:
        raise RuntimeError("can't start new thread")

    run = in_a_new_process()
    with pytest.raises(AttributeError):  # a mistake holds up nothing
        run.compile_ahead(spring(), None, 1)
    with monkeypatch.context() as patch:
        patch.setattr(threading.Thread, "start", fail)
        run.compile_ahead(spring(), BY, 1)
    assert run(spring(), BY, 1)[1] == 1
    with monkeypatch.context() as patch:
        patch.setattr(run, "_compile", fail)  # in the thread
        run.compile_ahead(spring(), BY, 2)
    assert run(spring(), BY, 2)[1] == 2
    assert capfd.readouterr().err == ""


def test_without_a_store_nothing_is_compiled_ahead(store):
    token = STORE.set(None)
    run = compiled()(pulled)
    assert not run.will_compile(spring(), BY, 1)
    run.compile_ahead(spring(), BY, 1)
    assert traces == []
    STORE.reset(token)
    run = in_a_new_process()
    # a thread has a context of its own, in which programs are not kept
    contexts = [copy_context() for _ in range(4)]
    with ThreadPoolExecutor(4) as pool:
        asked = [pool.submit(each.run, run.compile_ahead, spring(), BY, 1) for each in contexts]
    assert [each.result() for each in asked] == [None] * 4
    run(spring(), BY, 1)
    assert traces == [1]


def test_a_changed_source_is_another_program(store, monkeypatch, tmp_path):
    source = tmp_path / "crinoid" / "__init__.py"
    source.parent.mkdir()
    source.write_text("a = 1\n")
    assert (keys._SOURCE / "dynamics" / "system.py").exists()  # all of crinoid
    monkeypatch.setattr(keys, "_SOURCE", source.parent)
    found = set()
    for text in ("a = 1\n", "a = 2\n"):
        source.write_text(text)
        keys._surroundings.cache_clear()
        found.add(keys._surroundings())
    assert len(found) == 2
    monkeypatch.setattr(
        keys, "_IMPORT_TIME", time.time() - 3600
    )  # it was loaded before it was changed
    keys._surroundings.cache_clear()
    in_a_new_process()(spring(), BY, 1)
    keys._surroundings.cache_clear()
    assert not programs_in(store)


def test_programs_of_a_user_on_a_device_or_traced_are_not_kept(store, monkeypatch):
    def of_a_user(by):
        return 2 * by

    def total(by):
        return jnp.sum(program(spring(), by, 2)[0].stiffness)

    np.testing.assert_array_equal(in_a_new_process(of_a_user)(BY), 2 * BY)
    in_a_new_process()(spring(), jax.device_put(BY, jax.devices()[0]), 1)
    program = in_a_new_process()
    np.testing.assert_allclose(jax.grad(total)(BY), 4 * BY * spring().stiffness, rtol=1e-14)
    monkeypatch.setattr(Spring, "__module__", "an_element_of_a_user")
    in_a_new_process()(spring(), BY, 1)
    assert not programs_in(store)


@pytest.mark.parametrize(
    "damage",
    [
        lambda file: file.write_bytes(b""),
        lambda file: file.write_bytes(file.read_bytes()[:-1]),
        lambda file: file.write_bytes(file.read_bytes()[:50]),
        lambda file: file.write_bytes(b"x" + file.read_bytes()[1:]),
        lambda file: file.write_bytes(file.read_bytes()[:-9] + b"123456789"),
        lambda file: file.chmod(0o644),
        lambda file: file.parent.chmod(0o755),
        lambda file: file.replace(file.with_suffix(".x")) and file.symlink_to(f"{file.stem}.x"),
        lambda file: file.unlink() or file.mkdir(),
    ],
    ids=["empty", "short", "head", "mark", "end", "open", "folder", "link", "no file"],
)
def test_a_file_that_cannot_be_trusted_is_not_run(store, damage):
    store.write(KEY, b"content")
    assert store.read(KEY) == b"content"
    damage(store._path(KEY))
    assert store.read(KEY) is None
    if store.folder.stat().st_mode & 0o077:
        store.write(b"another", b"content")
        assert not store._path(b"another").exists()


def test_a_file_of_another_key_or_owner_is_not_run(store, monkeypatch):
    store.write(KEY, b"content")
    store._path(KEY).rename(store._path(b"another"))
    assert store.read(b"another") is None
    store.write(KEY, b"content")
    if hasattr(os, "geteuid"):
        monkeypatch.setattr(os, "geteuid", lambda: 12345)
        assert store.read(KEY) is None
    assert stat.S_IMODE(store._path(KEY).stat().st_mode) == 0o600


@pytest.mark.parametrize("content", [b"no pickle", b"\x80\x05N."], ids=["garbage", "nothing"])
def test_a_program_that_cannot_be_loaded_is_compiled_again(store, content):
    in_a_new_process()(spring(), BY, 1)
    (file,) = programs_in(store)
    store.write(bytes.fromhex(file.stem), content)  # sound as a file, but no program
    for _ in range(2):
        in_a_new_process()(spring(), BY, 1)
        assert traces == [1, 1]


def test_the_oldest_programs_go_first_and_those_in_use_stay(tmp_path):
    store = Store(tmp_path / "programs", most_bytes=2500)
    for number in range(3):
        store.write(bytes([number]), bytes(900))
        os.utime(store._path(bytes([number])), (number, number))
        if number == 1:
            assert store.read(b"\0") is not None  # used now
    assert [store.read(bytes([number])) is not None for number in range(3)] == [True, False, True]
    store.write(b"large", bytes(10_000))
    assert store.read(b"large") is not None
    assert len(list(store.folder.iterdir())) == 1


def test_a_folder_that_cannot_be_written_to_is_done_without(tmp_path):
    (tmp_path / "file").write_text("")
    for folder in (tmp_path / "file" / "programs", tmp_path / ("x" * 300)):
        store = Store(folder)
        store.write(KEY, b"content")
        assert store.read(KEY) is None
        assert not store.holds(KEY)


@pytest.mark.slow
def test_processes_at_once_compile_a_program_once_and_agree(tmp_path):
    code = (
        "import crinoid, numpy as np\n"
        "from crinoid.assembly.prepared import system\n"
        "from crinoid.compilation import keep_programs\n"
        "from crinoid.compilation.program import Program\n"
        "build, built = Program._build, []\n"
        "Program._build = lambda self, *given: built.append(self) or build(self, *given)\n"
        "keep_programs()\n"
        "arm = system(crinoid.load('still-water'))\n"
        "print(len(built), np.asarray(arm.reference.rest_length).tobytes().hex())\n"
    )
    environment = os.environ | {"JAX_COMPILATION_CACHE_DIR": str(tmp_path)}
    how = {"env": environment, "stdout": subprocess.PIPE, "text": True}
    both = [subprocess.Popen([sys.executable, "-c", code], **how) for _ in range(2)]
    said = [process.communicate(timeout=120)[0].split() for process in both]
    assert [process.returncode for process in both] == [0, 0]
    counts, lengths = zip(*said, strict=True)
    assert lengths[0] == lengths[1] != ""
    assert sorted(counts) == ["0", "1"]
    assert len(programs_in(Store(tmp_path / "crinoid" / "programs"))) == 1


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux tells who locks a file")
@pytest.mark.parametrize(
    ("stopped", "words"), [(True, "is stopped, and is not"), (False, "compiles too: waiting")]
)
def test_a_process_that_does_not_get_ready_is_not_waited_for(
    tmp_path, monkeypatch, caplog, stopped, words
):
    monkeypatch.setattr(keys, "_SAID", 0.1)
    monkeypatch.setattr(keys, "_PATIENCE", 30.0 if stopped else 0.1)
    code = "import fcntl, sys; file = open(sys.argv[1], 'w'); fcntl.flock(file, 2); "
    code += "print(flush=True); sys.stdin.read()"
    command = [sys.executable, "-c", code, str(tmp_path / "00.lock")]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as other:
        assert other.stdout.readline() == b"\n"
        if stopped:
            other.send_signal(signal.SIGSTOP)
            os.waitpid(other.pid, os.WUNTRACED)
        with Store(tmp_path).claim(b"\0"):
            pass
        other.kill()
    assert f"crinoid: process {other.pid} {words}" in caplog.text


def test_programs_are_kept_where_the_user_wants_it(tmp_path, monkeypatch):
    monkeypatch.setattr("platformdirs.user_cache_path", lambda name: tmp_path / name)
    own, updates = tmp_path / "crinoid" / "jax", {}
    monkeypatch.setattr(
        type(jax.config), "update", lambda _, key, value: updates.update({key: value})
    )
    before = STORE.set(None)
    settings = {"jax_compilation_cache_dir": None, "jax_enable_compilation_cache": True}
    for change, folder in (
        ({}, tmp_path / "crinoid" / "programs"),
        ({"jax_compilation_cache_dir": "chosen"}, Path("chosen/crinoid/programs")),
        ({"jax_enable_compilation_cache": False}, None),
    ):
        monkeypatch.setattr(type(jax.config), "values", property(lambda _, s=settings | change: s))
        updates.clear()
        keep_programs()
        store = STORE.get()
        assert (store and store.folder) == folder
        # JAX itself keeps what depends on classes of the user's
        assert updates.get("jax_compilation_cache_dir") == (None if change else str(own))
    assert stat.S_IMODE(own.stat().st_mode) == 0o700
    STORE.reset(before)
