"""The key of a compiled program: a digest of everything that the program depends on."""

import functools
import hashlib
import io
import os
import pickle
import platform
import sys
import time
import types
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jaxlib
import numpy as np

from crinoid import version

_BEGUN = time.time()
_SOUND = {"builtins", "crinoid", "equinox", "jax", "numpy"}
"""Packages whose classes and functions are known by their name and version."""
_ELSEWHERE = ("cache", "log", "traceback")
"""Parts of the names of settings of JAX that change no program."""
_CPU = ("vendor_id", "cpu family", "model", "flags", "CPU ", "Features")
"""How lines of ``/proc/cpuinfo`` begin that tell of what a processor can do."""


class UnkeepableError(Exception):
    """A program that depends on something that a key cannot describe."""


@dataclass(frozen=True)
class Slot:
    """Where an array stands in a tree: which one, or of which kind."""

    array: int | str


def setting(name: str) -> Any:
    """Return a setting of JAX, as it is in this context."""
    return getattr(jax.config, name)


def settings() -> tuple[Any, ...]:
    """Return what compiled code depends on and may change while a process runs."""
    others = jax.config.values  # a dictionary that is made each time
    found = (getattr(jax.config, name, others[name]) for name in _names())
    return (*found, os.environ.get("XLA_FLAGS"))


@functools.lru_cache(256)  # a description takes longer than many a program
def key_of(
    function: Callable[..., Any],
    options: tuple[tuple[str, Any], ...],
    tree: Any,
    form: tuple[Any, ...],
    around: tuple[Any, ...],
) -> bytes:
    """Return the key of a function compiled for arguments.

    It describes everything that the compiled code depends on: the source of crinoid, the versions
    of the packages below it, the processor, the settings of JAX and XLA, the options, and the
    arguments but for the numbers in their arrays.

    Parameters
    ----------
    function, options
        What is compiled, and options of XLA.
    tree, form
        Structure of the arguments, and of each of its leaves the kind if it is an array, else its
        type and itself: 1 is equal to 1.0 and to True.
    around
        `settings`.

    Raises
    ------
    UnkeepableError
        If the arguments hold something that its name does not describe, such as a user's class.
    """
    if not _is_sound(function):
        raise UnkeepableError
    leaves = [each[1] if isinstance(each, tuple) else Slot(_words(each)) for each in form]
    text = io.BytesIO()
    try:
        name = f"{function.__module__}.{function.__qualname__}"
        pickler = _Pickler(text)
        pickler.fast = True  # equal parts give equal text, be they one object or several
        pickler.dump((name, options, jax.tree.unflatten(tree, leaves)))
    except (pickle.PicklingError, AttributeError, TypeError, ValueError) as error:
        raise UnkeepableError from error
    devices = [(device.platform, device.device_kind) for device in jax.devices()]
    found = hashlib.sha256(_surroundings())
    found.update(repr((_names(), around, devices)).encode())
    found.update(text.getvalue())
    return found.digest()


class _Pickler(pickle.Pickler):
    """Takes only what its name and the versions of packages tell all of."""

    def persistent_id(self, obj: Any) -> None:
        if isinstance(obj, (type, types.FunctionType, types.BuiltinFunctionType)):
            if not _is_sound(obj):
                raise UnkeepableError
        elif isinstance(obj, (jax.Array, np.ndarray)):
            raise UnkeepableError


def _words(kind: Any) -> str:
    return f"{kind.dtype}{kind.shape}{'*' if kind.weak_type else ''}"


@functools.cache
def _names() -> tuple[str, ...]:
    """Return the names of the settings of JAX that may change a program."""
    names = (name for name in jax.config.values if not any(part in name for part in _ELSEWHERE))
    return tuple(sorted(names))


def _is_sound(named: Any) -> bool:
    return (named.__module__ or "").partition(".")[0] in _SOUND


@functools.cache
def _surroundings() -> bytes:
    """Return a digest of the program, what it is built on, and the machine."""
    found = hashlib.sha256()
    versions = [version.__version__, *(each.__version__ for each in (eqx, jax, jaxlib, np))]
    found.update(
        repr((versions, sys.version, sys.platform, platform.machine(), _processor())).encode()
    )
    root = Path(version.__file__).parent
    for path in sorted(root.rglob("*.py")):
        if path.stat().st_mtime > _BEGUN:
            raise UnkeepableError  # changed since it was loaded
        found.update(path.relative_to(root).as_posix().encode() + path.read_bytes())
    return found.digest()


def _processor() -> list[str]:
    """Return what the processor can do; where a system does not tell, which machine it is."""
    try:
        with open("/proc/cpuinfo", encoding="utf-8", errors="replace") as file:
            first = file.read(1 << 14).partition("\n\n")[0]
    except OSError:
        first = ""
    lines = [line for line in first.splitlines() if line.startswith(_CPU)]
    return lines or [platform.processor(), platform.node()]
