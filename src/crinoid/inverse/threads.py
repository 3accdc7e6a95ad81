"""Threads of a search: calls in a pool, and their results while progress is reported."""

from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_EXCEPTION, Future, ThreadPoolExecutor, wait
from contextvars import copy_context
from typing import Any, TypeVar

_POLL = 0.1
"""Time between two checks of the threads (s)."""

T = TypeVar("T")


def submit(pool: ThreadPoolExecutor, call: Callable[..., T], *arguments: Any) -> Future[T]:
    """Call a function in a thread of a pool."""
    # a thread has its own context, in which compiled programs would not be cached
    return pool.submit(copy_context().run, call, *arguments)


def results(futures: Sequence[Future[T]], poll: Callable[[], None]) -> list[T]:
    """Wait for futures, polling meanwhile."""
    waiting = set(futures)
    while waiting:
        done, waiting = wait(waiting, _POLL, FIRST_EXCEPTION)
        poll()
        for future in done:
            future.result()
    return [future.result() for future in futures]
