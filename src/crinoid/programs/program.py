"""Functions that are compiled once for all processes."""

from __future__ import annotations

import pickle
import threading
from collections import OrderedDict
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from contextvars import copy_context
from typing import Any, Generic, NamedTuple, ParamSpec, TypeVar

import equinox as eqx
import jax
import numpy as np
from jax.experimental import serialize_executable
from jax.experimental.compilation_cache import compilation_cache

from crinoid.programs.key import Slot, UnkeepableError, key_of, setting, settings
from crinoid.programs.store import STORE

P = ParamSpec("P")
R = TypeVar("R")

OFTEN = {
    "xla_cpu_use_fusion_emitters": False,
    "xla_cpu_experimental_ynn_fusion_type": "",
    "xla_cpu_prefer_vector_width": 512,
}
"""Options for what runs often, one arm or many. XLA's newer emitters of fused loops take a third
longer to compile, and what they make is slower on arrays as small as an arm's; the library that it
hands reductions to is made for long ones, and costs a batch of arms three times its step.
Vectors as wide as the processor has make a step in turbulence shorter.
"""
ONCE = OFTEN | {"xla_backend_optimization_level": 0}
"""Options for what runs once: less time to compile is worth more than milliseconds of running."""
_MOST_LOADED = 4
"""Forms of one function that stay loaded: a study may go through thousands."""


def compiled(**compiler_options: Any) -> Callable[[Callable[P, R]], Program[P, R]]:
    """Compile a function as `equinox.filter_jit` does, and keep it where programs are kept.

    Parameters
    ----------
    compiler_options
        Options of XLA.
    """
    return lambda function: Program(function, compiler_options)


class _Loaded(NamedTuple):
    run: Callable[..., Any]
    """From the arrays among the arguments to those of the result."""
    leaves: list[Any]
    """Leaves of the result, with slots where there are arrays."""
    tree: Any


class _Lowered(NamedTuple):
    code: Any
    """As XLA takes it."""
    result: Any
    """Result with slots where there are arrays."""


class _Anew:
    """Compiling without the cache of JAX: code that was read from there cannot be written again.

    That cache is off for all threads as long as one of them compiles so.
    """

    def __init__(self) -> None:
        self._lock, self._count, self._enabled = threading.Lock(), 0, True

    def __enter__(self) -> None:
        with self._lock:
            if not self._count:
                self._enabled = setting("jax_enable_compilation_cache")
                self._set(False)
            self._count += 1

    def __exit__(self, *_: object) -> None:
        with self._lock:
            self._count -= 1
            if not self._count:
                self._set(self._enabled)

    def _set(self, enabled: bool) -> None:
        jax.config.update("jax_enable_compilation_cache", enabled)
        compilation_cache.reset_cache()  # else it goes on as it began


_COMPILED_ANEW = _Anew()


class Program(Generic[P, R]):
    """A function of arrays and of what never changes, compiled when it is first called for them.

    Once `keep_programs` was called the compiled code is kept. It is not where arguments are traced,
    were put on a device on purpose, or are of classes from outside of crinoid.
    """

    def __init__(self, function: Callable[P, R], options: dict[str, Any]) -> None:
        self.function = function
        """The function itself, for what compiles it as a part of a whole."""
        self._options = options
        passed = {"compiler_options": options} if options else {}
        self._unkept = eqx.filter_jit(function, **passed)  # type: ignore[call-overload]
        self._loaded: OrderedDict[bytes, _Loaded] = OrderedDict()
        self._ahead: dict[bytes, Future[_Loaded]] = {}
        self._lock = threading.Lock()

    def __call__(self, *args: P.args, **kwargs: P.kwargs) -> R:
        """Call the function."""
        leaves, tree = jax.tree.flatten((args, kwargs))
        loaded = self._ready(leaves, tree)
        if loaded is None:
            return self._unkept(*args, **kwargs)
        found = loaded.run(*filter(_is_array, leaves))
        result = [found[leaf.array] if isinstance(leaf, Slot) else leaf for leaf in loaded.leaves]
        return jax.tree.unflatten(loaded.tree, result)

    def compile_ahead(self, *args: P.args, **kwargs: P.kwargs) -> None:
        """Begin to compile for such arguments, if `will_compile`; a call waits until that is done.

        Tracing is done at the return, and a thread goes on from there.
        """
        leaves, tree = jax.tree.flatten((args, kwargs))
        key = self._key(leaves, tree)
        if key is None:
            return
        with self._lock:
            if not self._is_missing(key):
                return
            lowered, pool = self._lower(leaves, tree), ThreadPoolExecutor(1)
            with suppress(RuntimeError):  # no thread can be had: then the call compiles it
                run = copy_context().run
                self._ahead[key] = pool.submit(run, self._compile, key, lowered)
            pool.shutdown(wait=False)

    def will_compile(self, *args: P.args, **kwargs: P.kwargs) -> bool:
        """Tell whether programs are kept, and a call with such arguments will add one."""
        key = self._key(*jax.tree.flatten((args, kwargs)))
        return key is not None and self._is_missing(key)

    def _is_missing(self, key: bytes) -> bool:
        store = STORE.get()
        assert store is not None
        return not (key in self._loaded or key in self._ahead or store.holds(key))

    def _key(self, leaves: list[Any], tree: Any) -> bytes | None:
        """Return the key of what a call takes; None if that is not kept."""
        if STORE.get() is None or _is_observed() or any(map(_is_placed, leaves)):
            return None
        form = tuple(jax.typeof(leaf) if _is_array(leaf) else (type(leaf), leaf) for leaf in leaves)
        try:
            return key_of(self.function, tuple(self._options.items()), tree, form, settings())
        except UnkeepableError:
            return None

    def _ready(self, leaves: list[Any], tree: Any) -> _Loaded | None:
        """Return what a call takes, loaded or compiled; None if it is not kept."""
        key = self._key(leaves, tree)
        if key is None:
            return None
        with self._lock:  # threads that ask for the same form wait, and compile it once
            loaded = self._loaded.pop(key, None) or self._compiled_ahead(key)
            loaded = loaded or self._load(key, sum(map(_is_array, leaves)))
            loaded = loaded or self._compile(key, self._lower(leaves, tree))
            self._loaded[key] = loaded  # the last to go
            if len(self._loaded) > _MOST_LOADED:
                self._loaded.popitem(last=False)
        return loaded

    def _compiled_ahead(self, key: bytes) -> _Loaded | None:
        ahead = self._ahead.pop(key, None)
        if ahead is None:
            return None
        try:
            return ahead.result()
        except Exception:  # of whatever kind: the call meets it as well, and tells
            return None

    def _load(self, key: bytes, count: int) -> _Loaded | None:
        store = STORE.get()
        assert store is not None
        content = store.read(key)
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
        except Exception:  # of whatever kind: it is of no use
            store.remove(key)
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

        flat.__name__ = self.function.__name__  # which profiles show
        code = jax.jit(flat).lower(*filter(_is_array, leaves))
        return _Lowered(code, results[-1])

    def _compile(self, key: bytes, lowered: _Lowered) -> _Loaded:
        store = STORE.get()
        assert store is not None
        with _COMPILED_ANEW:
            run = lowered.code.compile(compiler_options=self._options)
        try:
            code, _, _ = serialize_executable.serialize(run)
            store.write(key, pickle.dumps((code, lowered.result)))
        except (AttributeError, NotImplementedError, TypeError, ValueError, pickle.PicklingError):
            pass  # it serves this process
        return _Loaded(run, *jax.tree.flatten(lowered.result))


def _is_array(leaf: Any) -> bool:
    return isinstance(leaf, (jax.Array, np.ndarray, np.generic))


def _is_placed(array: Any) -> bool:
    """Tell whether an array is traced, or bound to a device."""
    return isinstance(array, jax.core.Tracer) or getattr(array, "committed", False)


def _is_observed() -> bool:
    """Tell whether JAX is asked to look into what is run."""
    return any(map(setting, ("jax_disable_jit", "jax_debug_nans", "jax_debug_infs")))
