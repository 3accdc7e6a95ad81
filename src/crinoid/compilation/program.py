"""Programs: functions compiled once for all processes."""

from __future__ import annotations

import ctypes
import functools
import gc
import hashlib
import logging
import os
import pickle
import threading
import time
import weakref
from collections import OrderedDict
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from contextvars import copy_context
from pathlib import Path
from typing import Any, Generic, NamedTuple, ParamSpec, TypeVar

import equinox as eqx
import jax
import numpy as np
from jax.experimental import serialize_executable
from jax.experimental.compilation_cache import compilation_cache

from crinoid.compilation.store import (
    STORE,
    Slot,
    Store,
    UncacheableError,
    key_of,
    setting,
    settings,
)

P = ParamSpec("P")
R = TypeVar("R")
_PROGRAMS: weakref.WeakSet[Program[Any, Any]] = weakref.WeakSet()

OFTEN = {
    "xla_cpu_use_fusion_emitters": False,
    "xla_cpu_experimental_ynn_fusion_type": "",
    "xla_cpu_prefer_vector_width": 512,
}
"""XLA options for programs that run often, with one arm or many. The newer emitters of fused loops
take a third longer to compile, and their code is slower on arrays as small as an arm's; the library
for reductions is made for long ones, and triples the step of a batch of arms. Vectors of the full
width of the processor shorten a step in turbulence.
"""
SOMETIMES = OFTEN | {
    "xla_disable_hlo_passes": "small-while-loop-hoisting,while-loop-invariant-code-motion"
}
"""XLA options for programs that run tens of times: two thirds of the compile time, half the speed.
They disable the passes that turn a loop into one kernel and move values out of it.
"""
ONCE = SOMETIMES | {"xla_backend_optimization_level": 0}
"""XLA options for programs that run once, with the shortest compile time."""
_LONG = 15.0
"""Compile time after which a message is logged (s)."""
_LOGGER = logging.getLogger(__name__)
_MOST_LOADED = 4
"""Number of loaded programs of one function: a study may need thousands."""


_first_process = functools.cache(os.getpid)


def require_own_process() -> None:
    """Refuse a fork of the process that has computed: it lacks JAX's threads, and would hang."""
    if _first_process() != os.getpid():
        text = "crinoid has computed before this process was forked, and would hang in it"
        raise RuntimeError(f'{text}. Start processes with multiprocessing.get_context("spawn").')


def compiled(**compiler_options: Any) -> Callable[[Callable[P, R]], Program[P, R]]:
    """Compile a function like `equinox.filter_jit`, with options of XLA, and save the program."""
    return lambda function: Program(function, compiler_options)


class _Loaded(NamedTuple):
    run: Callable[..., Any]
    """Map from the arrays among the arguments to those of the result."""
    leaves: list[Any]
    """Leaves of the result, with slots for arrays."""
    tree: Any


class _Lowered(NamedTuple):
    code: Any
    """Input of XLA."""
    result: Any
    """Result, with slots for arrays."""


class _WithoutJaxCache:
    """Disable JAX's compilation cache: executables loaded from it cannot be serialised.

    It is disabled for all threads while one of them is inside.
    """

    _lock, _count, _enabled = threading.Lock(), 0, True

    def __enter__(self) -> None:
        with self._lock:
            if not self._count:
                type(self)._enabled = setting("jax_enable_compilation_cache")
                self._set(False)
            type(self)._count += 1

    def __exit__(self, *_: object) -> None:
        with self._lock:
            type(self)._count -= 1
            if not self._count:
                self._set(self._enabled)

    def _set(self, enabled: bool) -> None:
        jax.config.update("jax_enable_compilation_cache", enabled)
        compilation_cache.reset_cache()  # else the change has no effect


class Program(Generic[P, R]):
    """Function of arrays and constants, compiled at its first call for each form of them.

    After `keep_programs` the compiled code is saved, unless arguments are traced, are bound to a
    device, or belong to classes from outside of crinoid.
    """

    def __init__(self, function: Callable[P, R], options: dict[str, Any]) -> None:
        self.function = function
        """The function itself, for callers that compile it as part of their own."""
        self._options = options
        passed = {"compiler_options": options} if options else {}
        self._uncached = eqx.filter_jit(function, **passed)  # type: ignore[call-overload]
        self._loaded: OrderedDict[bytes, _Loaded] = OrderedDict()
        self._ahead: dict[bytes, Future[_Loaded]] = {}
        self._foreign: dict[Any, bool] = {}
        """Forms of calls with classes from outside of crinoid, and whether each was called."""
        self._lock = threading.Lock()
        _PROGRAMS.add(self)

    def __call__(self, *args: P.args, **kwargs: P.kwargs) -> R:
        """Call the function."""
        require_own_process()
        leaves, tree = jax.tree.flatten((args, kwargs))
        loaded = self._ready(leaves, tree)
        if loaded is None:
            with self._first_call(leaves, tree):
                return self._uncached(*args, **kwargs)
        found = loaded.run(*filter(_is_array, leaves))
        result = [found[leaf.array] if isinstance(leaf, Slot) else leaf for leaf in loaded.leaves]
        return jax.tree.unflatten(loaded.tree, result)

    def compile_ahead(self, *args: P.args, **kwargs: P.kwargs) -> None:
        """Start to compile for such arguments, if `will_compile`; a call waits for the end.

        Tracing ends before the return; a thread does the rest.
        """
        leaves, tree = jax.tree.flatten((args, kwargs))
        key = self._key(leaves, tree)
        if key is None:
            return
        with self._lock:
            if not self._is_missing(key):
                return
            lowered, pool = self._lower(leaves, tree), ThreadPoolExecutor(1)
            count = sum(map(_is_array, leaves))
            with suppress(RuntimeError):  # no thread available: the call compiles it
                run = copy_context().run
                self._ahead[key] = pool.submit(run, self._compile, key, lowered, count)
            pool.shutdown(wait=False)

    def will_compile(self, *args: P.args, **kwargs: P.kwargs) -> bool:
        """Return whether a call with such arguments will compile and save a program."""
        key = self._key(*jax.tree.flatten((args, kwargs)))
        return key is not None and self._is_missing(key)

    def _is_missing(self, key: bytes) -> bool:
        return not (key in self._loaded or key in self._ahead or _store().holds(key))

    def _key(self, leaves: list[Any], tree: Any) -> bytes | None:
        """Return the key of a call; None if its program is not saved."""
        if STORE.get() is None or _is_observed() or any(map(_is_placed, leaves)):
            return None
        form, around = _form(leaves), settings()
        if (tree, form, around) in self._foreign:
            return None
        try:
            return key_of(self.function, tuple(self._options.items()), tree, form, around)
        except UncacheableError:
            self._foreign[tree, form, around] = False
            return None

    @contextmanager
    def _first_call(self, leaves: list[Any], tree: Any) -> Iterator[None]:
        """Let one process after the other make its first call of a form with foreign classes.

        So the first one compiles it, and the others find it in JAX's cache.
        """
        traced = STORE.get() is None or any(map(_is_placed, leaves))
        form = None if traced else (tree, _form(leaves), settings())
        if form is None or self._foreign.get(form, True):
            yield
            return
        text = repr((self.function.__qualname__, form))
        with _store().claim(hashlib.sha256(text.encode()).digest()):
            yield
        self._foreign[form] = True

    def _ready(self, leaves: list[Any], tree: Any) -> _Loaded | None:
        """Return the program of a call, loaded or compiled; None if it is not saved."""
        key = self._key(leaves, tree)
        if key is None:
            return None
        with self._lock:  # threads with the same form wait, so that it is compiled once
            count = sum(map(_is_array, leaves))
            loaded = (
                self._loaded.pop(key, None)
                or self._compiled_ahead(key)
                or self._load(key, count)
                or self._compile(key, self._lower(leaves, tree), count)
            )
            self._loaded[key] = loaded  # most recently used
            if len(self._loaded) > _MOST_LOADED:
                self._loaded.popitem(last=False)
        return loaded

    def _compiled_ahead(self, key: bytes) -> _Loaded | None:
        ahead = self._ahead.pop(key, None)
        with suppress(Exception):  # the call meets any error again, and reports it
            return None if ahead is None else ahead.result()
        return None

    def _load(self, key: bytes, count: int) -> _Loaded | None:
        content = _store().read(key)
        if content is None:
            return None
        try:
            code, result = pickle.loads(content)
            form, into = jax.tree.flatten(result)
            returned = sum(isinstance(leaf, Slot) for leaf in form)
            run = serialize_executable.deserialize_and_load(
                code,
                jax.tree.structure(((0,) * count, {})),
                jax.tree.structure((0,) * returned),
                execution_devices=jax.devices()[:1],
            )
        except Exception:  # any error: the file is useless
            _store().remove(key)
            return None
        return _Loaded(run, form, into)

    def _lower(self, leaves: list[Any], tree: Any) -> _Lowered:
        results = []

        def flat(*arrays: Any) -> tuple[Any, ...]:
            given = iter(arrays)
            filled = [next(given) if _is_array(leaf) else leaf for leaf in leaves]
            args, kwargs = jax.tree.unflatten(tree, filled)
            found, form = jax.tree.flatten(self.function(*args, **kwargs))
            returned = tuple(filter(_is_array, found))
            number = iter(range(len(returned)))
            slots = [Slot(next(number)) if _is_array(leaf) else leaf for leaf in found]
            results.append(jax.tree.unflatten(form, slots))
            return returned

        flat.__name__ = self.function.__name__  # for profiles
        code = jax.jit(flat).lower(*filter(_is_array, leaves))
        return _Lowered(code, results[-1])

    def _compile(self, key: bytes, lowered: _Lowered, count: int) -> _Loaded:
        store = _store()
        with store.claim(key):
            # another process may have compiled it meanwhile
            return self._load(key, count) or self._build(store, key, lowered, count)

    def _build(self, store: Store, key: bytes, lowered: _Lowered, count: int) -> _Loaded:
        name, start = f"{self.function.__name__} of {count} arrays", time.perf_counter()
        with _WithoutJaxCache(), _message_if_long(name, store.time_of(name)):
            run = lowered.code.compile(compiler_options=self._options)
        store.keep_time(name, time.perf_counter() - start)
        unserialisable = AttributeError, NotImplementedError, TypeError, ValueError
        with suppress(*unserialisable, pickle.PicklingError):  # it still serves this process
            code, _, _ = serialize_executable.serialize(run)
            store.write(key, pickle.dumps((code, lowered.result)))
        return _Loaded(run, *jax.tree.flatten(lowered.result))


def _form(leaves: list[Any]) -> tuple[Any, ...]:
    """Return the kind of each leaf that is an array, the type and the value of any other."""
    return tuple(jax.typeof(leaf) if _is_array(leaf) else (type(leaf), leaf) for leaf in leaves)


def _store() -> Store:
    store = STORE.get()
    assert store is not None
    return store


@contextmanager
def _message_if_long(name: str, last: float | None) -> Iterator[None]:
    """Log a slow compilation, with its duration the last time."""
    text = f"crinoid: compiling, once for this kind of arm ({name})"
    if last is not None:
        text += f"; {last:.0f} s the last time"
    timer = threading.Timer(_LONG, _LOGGER.warning, [text])
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


def _is_array(leaf: Any) -> bool:
    return isinstance(leaf, (jax.Array, np.ndarray, np.generic))


def _is_placed(array: Any) -> bool:
    """Return whether an array is traced, or bound to a device."""
    return isinstance(array, jax.core.Tracer) or getattr(array, "committed", False)


def _is_observed() -> bool:
    """Return whether a setting of JAX for debugging is on."""
    return any(map(setting, ("jax_disable_jit", "jax_debug_nans", "jax_debug_infs")))


def make_room() -> None:
    """Free compiled code if it uses half of the memory maps."""
    if _crowded():
        free_memory()


def free_memory() -> None:
    """Free compiled code that is not running, and return the free memory of glibc to the system.

    Otherwise glibc keeps what the compiler used, which is hundreds of megabytes.
    """
    for program in list(_PROGRAMS):
        with program._lock:
            program._loaded.clear()
    jax.clear_caches()
    gc.collect()
    with suppress(AttributeError, OSError, TypeError):  # another library
        ctypes.CDLL(None).malloc_trim(0)


def _crowded() -> bool:
    """Return whether half of the memory maps that Linux grants a process are in use.

    A program needs some; a process without any left crashes. Other systems have no such limit.
    """
    try:
        most = int(Path("/proc/sys/vm/max_map_count").read_text())
        return 2 * Path("/proc/self/maps").read_bytes().count(b"\n") > most
    except OSError:
        return False
