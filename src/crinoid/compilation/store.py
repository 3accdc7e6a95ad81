"""Store of compiled programs: their keys, and a folder that only its user can write to."""

import functools
import hashlib
import io
import os
import pickle
import platform
import stat
import sys
import time
import types
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import equinox as eqx
import filelock
import jax
import jaxlib
import numpy as np

from crinoid.foundation import version
from crinoid.foundation.atomic_file import atomic_write
from crinoid.foundation.cache_folder import cache_folder

_IMPORT_TIME = time.time()
_SOURCE = Path(__file__).parents[1]  # folder whose sources a program depends on: all of crinoid
_SOUND = {"builtins", "crinoid", "equinox", "jax", "numpy"}
"""Packages whose classes and functions a key identifies by name and version."""
_ELSEWHERE = ("cache", "log", "traceback")
"""Parts of the names of JAX settings that change no program."""
_CPU = ("vendor_id", "cpu family", "model", "flags", "CPU ", "Features")
"""Starts of the lines of ``/proc/cpuinfo`` that list the features of a processor."""


class UncacheableError(Exception):
    """Dependence of a program on something that a key cannot describe."""


@dataclass(frozen=True)
class Slot:
    """Place of an array in a tree: its number or its kind."""

    array: int | str


def setting(name: str) -> Any:
    """Return a setting of JAX in this context."""
    return getattr(jax.config, name)


def settings() -> tuple[Any, ...]:
    """Return all settings that compiled code depends on and that may change in a process."""
    others = jax.config.values  # builds a dictionary at each access
    found = (getattr(jax.config, name, others[name]) for name in _names())
    return (*found, os.environ.get("XLA_FLAGS"))


def key_of(
    function: Callable[..., Any],
    options: tuple[tuple[str, Any], ...],
    tree: Any,
    form: tuple[Any, ...],
    around: tuple[Any, ...],
) -> bytes:
    """Return the key of a compiled program: a digest of all that its code depends on.

    That is the source of crinoid, the versions of the packages below it, the processor, the
    settings of JAX and XLA (``around``), the options of XLA, and the arguments except the numbers
    in arrays. Their ``form`` has the kind of each leaf that is an array, and of others the type and
    the value, as 1 equals 1.0 and True.
    """
    if not _is_sound(function):
        raise UncacheableError
    leaves = [each[1] if isinstance(each, tuple) else Slot(repr(each)) for each in form]
    text = io.BytesIO()
    try:
        name = f"{function.__module__}.{function.__qualname__}"
        pickler = _Pickler(text)
        pickler.fast = True  # equal text for equal parts, whether one object or several
        pickler.dump((name, options, jax.tree.unflatten(tree, leaves)))
    except (pickle.PicklingError, AttributeError, TypeError, ValueError) as error:
        raise UncacheableError from error
    return _digest(_sources(), around, text.getvalue())


def key_of_operations(text: str, options: tuple[tuple[str, Any], ...], around: Any) -> bytes:
    """Return the key of a program by its operations, which also tell what a user's classes do."""
    return _digest(repr(options).encode(), around, text.encode())


def _digest(first: bytes, around: Any, text: bytes) -> bytes:
    devices = [(device.platform, device.device_kind) for device in jax.devices()]
    found = hashlib.sha256(repr((_machine(), _names(), around, devices)).encode())
    for part in (first, text):
        found.update(hashlib.sha256(part).digest())
    return found.digest()


class _Pickler(pickle.Pickler):
    """Pickler of objects that names and versions of packages describe completely."""

    def persistent_id(self, obj: Any) -> None:
        if isinstance(obj, (type, types.FunctionType, types.BuiltinFunctionType)):
            if not _is_sound(obj):
                raise UncacheableError
        elif isinstance(obj, (jax.Array, np.ndarray)):
            raise UncacheableError


@functools.cache
def _names() -> tuple[str, ...]:
    """Return the names of the JAX settings that may change a program."""
    names = (name for name in jax.config.values if not any(part in name for part in _ELSEWHERE))
    return tuple(sorted(names))


def _is_sound(named: Any) -> bool:
    return (named.__module__ or "").partition(".")[0] in _SOUND


@functools.cache
def _machine() -> tuple[Any, ...]:
    """Return the versions of the packages below crinoid's own code, and the machine."""
    versions = [version.__version__, *(each.__version__ for each in (eqx, jax, jaxlib, np))]
    return versions, sys.version, sys.platform, platform.machine(), _processor()


@functools.cache
def _sources() -> bytes:
    """Return a digest of the sources of crinoid."""
    found = hashlib.sha256()
    for path in sorted(_SOURCE.rglob("*.py")):
        if path.stat().st_mtime > _IMPORT_TIME:
            raise UncacheableError  # changed since it was imported
        found.update(path.relative_to(_SOURCE).as_posix().encode() + path.read_bytes())
    return found.digest()


def _processor() -> list[str]:
    """Return the features of the processor, or the name of the machine if they are unknown."""
    try:
        first = Path("/proc/cpuinfo").read_text("utf-8", "replace").partition("\n\n")[0]
    except OSError:
        first = ""
    lines = [line for line in first.splitlines() if line.startswith(_CPU)]
    return lines or [platform.processor(), platform.node()]


_MOST_BYTES = 500_000_000  # total size of files beyond which the least recently used are deleted
_PATIENCE = 60.0  # time after which a process no longer waits for another one that compiles (s)
_DIGEST = 32  # bytes of a digest


@dataclass(frozen=True)
class Store:
    """Folder of files by keys.

    Their content will be executed. So nothing is read or written if the folder or the file belongs
    to another user or is open to others, and a damaged, truncated or misplaced file is ignored.
    """

    folder: Path

    def read(self, key: bytes) -> bytes | None:
        """Return the content under a key, None if there is none that can be trusted."""
        path = self._path(key)
        try:
            if not _is_private(self.folder.lstat(), stat.S_ISDIR):
                return None
            # no links, and checked after opening: nobody can exchange it in between
            with open(os.open(path, os.O_RDONLY | _AS_IT_IS), "rb") as file:
                if not _is_private(os.fstat(file.fileno()), stat.S_ISREG):
                    return None
                digest, content = file.read(_DIGEST), file.read()
            os.utime(path)  # recently used
        except OSError:
            return None
        return content if digest == _seal(key, content) else None

    def write(self, key: bytes, content: bytes) -> None:
        """Save content under a key if possible, and delete the least recently used files."""
        with suppress(OSError):
            self.folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            if _is_private(self.folder.lstat(), stat.S_ISDIR):
                with atomic_write(self._path(key), private=True) as temporary:
                    temporary.write_bytes(_seal(key, content) + content)
                self._make_room()

    @contextmanager
    def claim(self, key: bytes) -> Iterator[None]:
        """Lock a key while a process compiles its program; others wait at most a minute.

        The operating system removes the lock of a process that ends.
        """
        lock = filelock.FileLock(self.folder / f"{key.hex()[:2]}.lock")
        with suppress(OSError, NotImplementedError, filelock.Timeout):  # then several compile it
            self.folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            lock.acquire(timeout=_PATIENCE)
        try:
            yield
        finally:
            lock.release()

    def _path(self, key: bytes) -> Path:
        return self.folder / f"{key.hex()}.program"

    def _make_room(self) -> None:
        """Delete the least recently used files, but never the last one."""
        size = 0
        with suppress(OSError):  # another process may have removed one
            found = [(path.stat(), path) for path in self.folder.iterdir()]
            for status, path in sorted(found, key=lambda each: -each[0].st_mtime):
                size += status.st_size
                if size > _MOST_BYTES and size > status.st_size:
                    path.unlink()


@functools.cache
def opened() -> Store | None:
    """Return the store of this process, decided at the first use; None if programs are not kept.

    The folder is the user's cache folder, or ``crinoid`` in ``JAX_COMPILATION_CACHE_DIR`` if set.
    ``JAX_ENABLE_COMPILATION_CACHE = false`` disables it.
    """
    if not setting("jax_enable_compilation_cache"):
        return None
    return Store(cache_folder(setting("jax_compilation_cache_dir")) / "programs")


_AS_IT_IS = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_BINARY", 0)


def _seal(key: bytes, content: bytes) -> bytes:
    return hashlib.sha256(key + content).digest()


def _is_private(found: os.stat_result, is_kind: Callable[[int], bool]) -> bool:
    """Return whether a file or folder belongs to this user and is closed to others."""
    if not is_kind(found.st_mode):
        return False
    if not hasattr(os, "getuid"):  # Windows, where a user's folder is private
        return True
    return found.st_uid == os.geteuid() and not found.st_mode & 0o077
