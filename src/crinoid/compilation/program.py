"""Programs: functions compiled once for all processes."""

import ctypes
import functools
import gc
import os
import pickle
import threading
import weakref
from collections import OrderedDict
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Generic, NamedTuple, ParamSpec, TypeVar

import equinox as eqx
import jax
import numpy as np
from jax.experimental import serialize_executable
from jax.experimental.compilation_cache import compilation_cache

from crinoid.compilation.message import reported
from crinoid.compilation.store import (
    Slot,
    Store,
    UncacheableError,
    key_of,
    key_of_operations,
    opened,
    setting,
    settings,
)

P = ParamSpec("P")
R = TypeVar("R")
_PROGRAMS: "weakref.WeakSet[Program[Any, Any]]" = weakref.WeakSet()

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
_MOST_LOADED = 4  # number of loaded programs of one function: a study may need thousands


_first_process = functools.cache(os.getpid)


def require_own_process() -> None:
    """Refuse a fork of the process that has computed: it lacks JAX's threads, and would hang."""
    if _first_process() != os.getpid():
        text = "crinoid has computed before this process was forked, and would hang in it"
        raise RuntimeError(f'{text}. Start processes with multiprocessing.get_context("spawn").')


def compiled(**compiler_options: Any) -> "Callable[[Callable[P, R]], Program[P, R]]":
    """Compile a function like `equinox.filter_jit`, with options of XLA, and save the program."""
    return lambda function: Program(function, compiler_options)


class _Loaded(NamedTuple):
    run: Callable[..., Any] | None
    """Map from the arrays among the arguments to those of the result; none if it is not kept."""
    leaves: list[Any]
    """Leaves of the result, with slots for arrays."""
    tree: Any


_building = threading.Lock()


@contextmanager
def _without_jax_cache() -> Iterator[None]:
    """Disable JAX's compilation cache, if it is on: executables from it cannot be serialised."""
    if setting("jax_compilation_cache_dir") is None:
        yield
        return
    with _building:
        jax.config.update("jax_enable_compilation_cache", False)
        compilation_cache.reset_cache()  # else the change has no effect
        try:
            yield
        finally:
            jax.config.update("jax_enable_compilation_cache", True)
            compilation_cache.reset_cache()


class Program(Generic[P, R]):
    """Function of arrays and constants, compiled at its first call for each form of them.

    The compiled code is saved, unless arguments are traced or bound to a device, or it calls back
    into Python.
    """

    def __init__(self, function: Callable[P, R], options: dict[str, Any]) -> None:
        self.function = function
        """The function itself, for callers that compile it as part of their own."""
        self._options = options
        self._plain = eqx.filter_jit(function, compiler_options=options)  # type: ignore[call-overload]
        self._loaded: OrderedDict[Any, _Loaded] = OrderedDict()
        self._lock = threading.Lock()
        _PROGRAMS.add(self)

    def __call__(self, *args: P.args, **kwargs: P.kwargs) -> R:
        """Call the function."""
        require_own_process()
        leaves, tree = jax.tree.flatten((args, kwargs))
        store = opened()
        if store is None or _is_observed() or any(map(_is_placed, leaves)):
            return self._plain(*args, **kwargs)
        form = tree, _form(leaves), settings()
        with self._lock:  # threads with the same form wait, so that it is compiled once
            loaded = self._loaded.pop(form, None) or self._ready(store, form, leaves)
            self._loaded[form] = loaded  # most recently used
            if len(self._loaded) > _MOST_LOADED:
                self._loaded.popitem(last=False)
        if loaded.run is None:
            return self._plain(*args, **kwargs)
        found = loaded.run(*filter(_is_array, leaves))
        result = [found[leaf.array] if isinstance(leaf, Slot) else leaf for leaf in loaded.leaves]
        return jax.tree.unflatten(loaded.tree, result)

    def _ready(self, store: Store, form: tuple[Any, ...], leaves: list[Any]) -> _Loaded:
        """Return the program of a form, loaded or compiled."""
        tree, kinds, around = form
        options, count = tuple(self._options.items()), sum(map(_is_array, leaves))
        try:
            key = key_of(self.function, options, tree, kinds, around)
        except UncacheableError:
            key = None
        if key is not None and (found := _load(store, key, count)):
            return found
        with reported():
            lowered, result = self._lower(leaves, tree)
            known = key is not None
            if key is None:  # the operations tell what classes of the user do
                text = lowered.as_text()
                if "callback" in text:
                    return _Loaded(None, [], None)
                key = key_of_operations(text, options, around)
            with store.claim(key):
                if found := _load(store, key, count, result):  # of another process, meanwhile
                    return found
                with _without_jax_cache():
                    run = lowered.compile(compiler_options=self._options)
                with suppress(Exception):  # it still serves this process
                    code, _, _ = serialize_executable.serialize(run)
                    store.write(key, pickle.dumps((code, result if known else None)))
        return _Loaded(run, *jax.tree.flatten(result))

    def _lower(self, leaves: list[Any], tree: Any) -> tuple[Any, Any]:
        """Return the input of XLA, and the result with slots for arrays."""
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
        lowered = jax.jit(flat).lower(*filter(_is_array, leaves))
        return lowered, results[-1]


def _load(store: Store, key: bytes, count: int, result: Any = None) -> _Loaded | None:
    """Load a program of some arrays, with its result if that is known."""
    content = store.read(key)
    if content is None:
        return None
    try:
        code, saved = pickle.loads(content)
        form, into = jax.tree.flatten(saved if result is None else result)
        returned = sum(isinstance(leaf, Slot) for leaf in form)
        run = serialize_executable.deserialize_and_load(
            code,
            jax.tree.structure(((0,) * count, {})),
            jax.tree.structure((0,) * returned),
            execution_devices=jax.devices()[:1],
        )
    except Exception:  # any error: the file is useless, and replaced
        return None
    return _Loaded(run, form, into)


def _form(leaves: list[Any]) -> tuple[Any, ...]:
    """Return the kind of each leaf that is an array, the type and the value of any other."""
    return tuple(jax.typeof(leaf) if _is_array(leaf) else (type(leaf), leaf) for leaf in leaves)


def _is_array(leaf: Any) -> bool:
    return isinstance(leaf, (jax.Array, np.ndarray, np.generic))


def _is_placed(array: Any) -> bool:
    """Return whether an array is traced, or bound to a device."""
    return isinstance(array, jax.core.Tracer) or getattr(array, "committed", False)


def _is_observed() -> bool:
    """Return whether a setting of JAX for debugging is on."""
    return any(map(setting, ("jax_disable_jit", "jax_debug_nans", "jax_debug_infs")))


def make_room() -> None:
    """Free compiled code if it uses half of the memory maps that Linux grants a process.

    A program needs some; a process without any left crashes. Other systems have no such limit.
    """
    with suppress(OSError):
        most = int(Path("/proc/sys/vm/max_map_count").read_text())
        if 2 * Path("/proc/self/maps").read_bytes().count(b"\n") > most:
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
