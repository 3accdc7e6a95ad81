"""A run that advances on request."""

import threading
from collections.abc import Callable
from functools import wraps
from typing import Any, NoReturn, TypeVar, cast

import jax
import jax.numpy as jnp
from jaxtyping import Array

from crinoid.compilation import OFTEN, compiled, require_own_process
from crinoid.dynamics import Outcome
from crinoid.results.record import Record
from crinoid.simulation.chunk import chunk_program, record
from crinoid.simulation.loop import Loop, LoopState


class SteppedRun:
    """A closed loop that advances on request, by the program of a run.

    ``stride`` time steps are between two instants to save, of which one call returns at most
    ``capacity``. Who starts it sets the loop and its state, and may replace them later.
    """

    loop: Loop  # the closed loop with the present numbers
    state: LoopState  # state of the closed loop
    failed: Outcome | None = None  # outcome of the time step that failed, if one did

    def __init__(self, stride: int, capacity: int) -> None:
        self._stride, self._capacity, self._lock = stride, capacity, threading.RLock()

    def __reduce_ex__(self, protocol: Any) -> NoReturn:
        raise TypeError(f"{type(self).__name__}: cannot be copied or pickled. Make another one.")

    @property
    def time(self) -> float:
        """Simulated time (s)."""
        return float(self.state.state.time)

    @property
    def steps(self) -> int:
        """Number of time steps since the start."""
        return int(self.state.steps)

    def advance_to(self, end: int) -> Record | None:
        """Advance to a time step, or until one fails; return the instants to save, if any."""
        begin = self.steps
        end = min(end, (begin // self._stride + self._capacity) * self._stride)
        self.state, kept, new, outcome = self._chunk(end)
        if end > begin and not outcome.converged:
            self.failed = outcome
        count = int(new)
        return kept.first(count) if count else None

    def compile(self) -> None:
        """Compile the program, so that a later call is fast."""
        jax.block_until_ready(self._chunk(self.steps))

    def record(self) -> Record:
        """Return the record of the present instant: all quantities of a saved one."""
        return _look(self.loop, self.state)

    def _chunk(self, end: int) -> tuple[LoopState, Record, Array, Outcome]:
        last, stride = jnp.asarray(end, int), jnp.asarray(self._stride, int)
        return chunk_program(0)(self.loop, self.state, last, stride, self._capacity)


F = TypeVar("F", bound=Callable[..., Any])


def alone(method: F) -> F:
    """Let a method wait for other threads that use the same run, and refuse a fork."""

    @wraps(method)
    def locked(self: SteppedRun, *args: Any, **kwargs: Any) -> Any:
        require_own_process()  # first: nobody releases a lock that was held at a fork
        with self._lock:
            return method(self, *args, **kwargs)

    return cast(F, locked)


_look = compiled(**OFTEN)(record)
