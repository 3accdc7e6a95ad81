"""The time that a controller takes for one command."""

from __future__ import annotations

import time
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from crinoid.control import Reading
from crinoid.dynamics import State
from crinoid.programs import OFTEN, compiled
from crinoid.simulation.loop import Loop

__all__ = ["tick_time"]

_LASTS = 0.05
"""CPU time that a measurement takes at least (s): the call of the program is no part of it then."""
_REPEATS = 5
_MOST_CALLS = 1 << 20
_SHAKE = 1e-3
"""By how much readings differ from one call to the next, in their units."""


def tick_time(loop: Loop, state: State) -> float:
    """Return the CPU time that a controller takes for one command (s).

    The compiled controller alone, called many times in a row inside one program, which runs on one
    core: each call has the memory of the one before, the next time, and readings that differ a
    little. The median of five measurements of at least 0.05 s each; what other programs do at the
    same time does not count. Building what is seen (`crinoid.Seen`) is not part of it.
    """
    calls = 16
    _run(loop, state, calls)  # compiles
    while (took := _run(loop, state, calls)) < _LASTS and calls < _MOST_CALLS:
        calls = min(_MOST_CALLS, int(calls * min(16.0, 1.5 * _LASTS / max(took, 1e-6)) + 1))
    return float(np.median([_run(loop, state, calls) for _ in range(_REPEATS)])) / calls


def _run(loop: Loop, state: State, calls: int) -> float:
    begun = time.process_time()
    jax.block_until_ready(_commands(loop, state, jnp.asarray(calls)))
    return time.process_time() - begun


@compiled(**OFTEN)
def _commands(loop: Loop, state: State, calls: Int[Array, ""]) -> Float[Array, " input"]:
    """Give commands in a row, and return the sum of them."""
    begin = loop.start(state)
    first = loop.seen(state, begin.sensors, begin.command)

    def call(index: Int[Array, ""], carry: tuple[Any, Array, Array]) -> tuple[Any, Array, Array]:
        memory, command, total = carry
        late = index * loop.clock.period
        shake = _SHAKE * jnp.sin(0.7 * index)
        seen = eqx.tree_at(
            lambda s: (s.time, s.taken, s.measured, s.command, s.readings),
            first,
            (
                first.time + late,
                first.taken + late,
                first.measured + shake,
                command,
                {
                    name: Reading(reading.value + shake, reading.taken + late)
                    for name, reading in first.readings.items()
                },
            ),
        )
        command, memory = loop.controller.command(memory, seen)
        command = jnp.clip(command, seen.lower, seen.upper)
        return memory, command, total + command

    zero = jnp.zeros_like(begin.command)
    carry = (loop.controller.start(first), zero, zero)
    carry = jax.tree.map(lambda x: jax.lax.convert_element_type(x, x.dtype), carry)
    return jax.lax.fori_loop(0, calls, call, carry)[2]
