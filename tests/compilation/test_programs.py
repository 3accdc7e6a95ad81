"""Compiled programs between processes: the same results, and nothing run that cannot be trusted."""

import os
import stat
import subprocess
import sys
import time
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from crinoid.compilation import about, compiled, message, program
from crinoid.compilation import store as keys
from crinoid.compilation.store import Store

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
    monkeypatch.setattr(program, "opened", lambda: store)
    return store


BY = jnp.linspace(0.0, 1.0, 5) ** 0.5


def in_a_new_process(function=pulled, **options):
    """Return the function as a process has it that has compiled nothing yet."""
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
            keys._machine.cache_clear()
            in_a_new_process()(spring(), BY, 1)
        keys._machine.cache_clear()
        assert len(traces) == count + number, name
    with jax.default_matmul_precision("float32"):
        in_a_new_process()(spring(), BY, 1)
    assert len(traces) == count + 3


def test_a_changed_source_is_another_program(store, monkeypatch, tmp_path):
    source = tmp_path / "crinoid" / "__init__.py"
    source.parent.mkdir()
    source.write_text("a = 1\n")
    assert (keys._SOURCE / "dynamics" / "system.py").exists()  # all of crinoid
    monkeypatch.setattr(keys, "_SOURCE", source.parent)
    found = set()
    for text in ("a = 1\n", "a = 2\n"):
        source.write_text(text)
        keys._sources.cache_clear()
        found.add(keys._sources())
    assert len(found) == 2
    monkeypatch.setattr(
        keys, "_IMPORT_TIME", time.time() - 3600
    )  # it was loaded before it was changed
    keys._sources.cache_clear()
    for _ in range(2):  # then its operations are its key
        in_a_new_process()(spring(), BY, 1)
    keys._sources.cache_clear()
    assert traces == [1, 1]
    assert len(programs_in(store)) == 1


def test_programs_on_a_device_traced_or_with_callbacks_are_not_kept(store):
    def total(by):
        return jnp.sum(run(spring(), by, 2)[0].stiffness)

    def called_back(by):
        return jax.pure_callback(lambda x: 3 * np.asarray(x), by, by)

    in_a_new_process()(spring(), jax.device_put(BY, jax.devices()[0]), 1)
    run = in_a_new_process()
    np.testing.assert_allclose(jax.grad(total)(BY), 4 * BY * spring().stiffness, rtol=1e-14)
    for _ in range(2):
        np.testing.assert_array_equal(in_a_new_process(called_back)(BY), 3 * BY)
    assert not programs_in(store)


def test_programs_with_classes_of_a_user_are_known_by_their_operations(store, monkeypatch):
    factor = 2

    def of_a_user(by):
        traces.append(factor)
        return factor * by, Spring(by, by, 1)

    monkeypatch.setattr(Spring, "__module__", "an_element_of_a_user")
    for factor, kept in ((2, 1), (2, 1), (3, 2)):
        run = in_a_new_process(of_a_user)
        for _ in range(2):
            found, made = run(BY)
            np.testing.assert_array_equal(found, factor * BY)
            assert isinstance(made, Spring)
        assert len(programs_in(store)) == kept
    assert traces == [2, 2, 3]
    for _ in range(2):
        in_a_new_process()(spring(), BY, 1)
    assert len(programs_in(store)) == 3


@pytest.mark.parametrize(
    "damage",
    [
        lambda file: file.write_bytes(b""),
        lambda file: file.write_bytes(file.read_bytes()[:-1]),
        lambda file: file.write_bytes(file.read_bytes()[:20]),
        lambda file: file.write_bytes(b"x" * 32 + file.read_bytes()[32:]),
        lambda file: file.write_bytes(file.read_bytes()[:-9] + b"123456789"),
        lambda file: file.chmod(0o644),
        lambda file: file.parent.chmod(0o755),
        lambda file: file.replace(file.with_suffix(".x")) and file.symlink_to(f"{file.stem}.x"),
        lambda file: file.unlink() or file.mkdir(),
    ],
    ids=["empty", "short", "head", "seal", "end", "open", "folder", "link", "no file"],
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


def test_the_oldest_programs_go_first_and_those_in_use_stay(tmp_path, monkeypatch):
    monkeypatch.setattr(keys, "_MOST_BYTES", 2500)
    store = Store(tmp_path / "programs")
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


@pytest.mark.slow
def test_processes_at_once_compile_a_program_once_and_agree(tmp_path):
    code = (
        "import crinoid, numpy as np\n"
        "from crinoid.assembly.prepared import system\n"
        "from crinoid.compilation.store import Store\n"
        "write, built = Store.write, []\n"
        "Store.write = lambda self, *given: built.append(self) or write(self, *given)\n"
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


def test_a_process_that_does_not_get_ready_is_not_waited_for(tmp_path, monkeypatch):
    monkeypatch.setattr(keys, "_PATIENCE", 0.1)
    with Store(tmp_path).claim(KEY), Store(tmp_path).claim(KEY):
        pass


def test_a_long_compilation_is_said_once(monkeypatch, caplog):
    monkeypatch.setattr(message, "_LONG", 0.05)
    monkeypatch.setattr(message, "_SOON", 0.02)
    monkeypatch.setattr(message, "_said", set())
    monkeypatch.setattr(message, "_spent", message.defaultdict(float))
    about("a worm")
    for _ in range(2):  # two programs
        with message.reported():
            time.sleep(0.2)
    about("the arm")
    line = "crinoid: compiling a worm (once for this kind of arm; usually 5 to 30 s)"
    assert caplog.messages == [line]


def test_a_short_compilation_is_not_said(monkeypatch, caplog):
    monkeypatch.setattr(message, "_spent", message.defaultdict(float))
    with message.reported():
        pass
    assert not caplog.messages


@pytest.mark.parametrize(
    ("changes", "folder"),
    [
        ({}, "crinoid/programs"),
        ({"jax_compilation_cache_dir": "chosen"}, "chosen/crinoid/programs"),
        ({"jax_enable_compilation_cache": False}, None),
    ],
    ids=["default", "elsewhere", "not at all"],
)
def test_programs_are_kept_where_the_user_wants_it(tmp_path, monkeypatch, changes, folder):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("platformdirs.user_cache_path", Path)
    given = {"jax_compilation_cache_dir": None, "jax_enable_compilation_cache": True} | changes
    monkeypatch.setattr(keys, "setting", given.__getitem__)
    store = keys.opened.__wrapped__()
    assert (store and store.folder) == (folder and Path(folder))


def test_no_setting_of_jax_is_changed(store, tmp_path):
    before = dict(jax.config.values)
    in_a_new_process()(spring(), BY, 1)
    assert jax.config.values == before
