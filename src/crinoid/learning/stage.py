"""The arms that a policy is trained on, each in an episode of its own."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextvars import copy_context
from dataclasses import replace
from typing import Any, NamedTuple, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from crinoid.control import Controller
from crinoid.dynamics import State
from crinoid.environment.draws import Draws
from crinoid.environment.program import numbers_of
from crinoid.programs import ONCE, compiled
from crinoid.simulation import Loop, LoopState
from crinoid.simulation.batch import cores

T = TypeVar("T")


class Episode(NamedTuple):
    """A draw of the arm, its water and its sensors."""

    loop: Loop
    state: State
    """The arm at the start."""


class Arm(NamedTuple):
    """An arm where it is."""

    loop: Loop
    now: LoopState


class Stage:
    """Arms, each of which goes on from where it was, or begins the next episode where it is over.

    Episodes are numbered in the order in which they begin; the number is the seed of its draw, so
    that training again is the same again.

    Parameters
    ----------
    draws
        What episodes are drawn from.
    count
        Number of arms.
    controller
        A controller of the kind that will be trained: the memory of a loop is that of its kind.
    first
        Seed of the first episode.
    """

    def __init__(self, draws: Draws, count: int, controller: Controller, first: int) -> None:
        self._draws, self._controller, self._first = draws, controller, first
        self.steps = draws.scenario.simulation.steps
        self.begun = 0
        """Episodes that have begun."""
        self.numbers = np.zeros(count, int)
        """The number of the episode of each arm."""
        self.loops: list[Loop] = []
        self.nows: list[LoopState] = []
        # the first episodes end one after the other, so that not all begin anew at once
        self.ends = self.steps * (1 + np.arange(count)) // count
        """The time step at which the episode of each arm is over."""
        for _ in range(count):
            episode = self._next(len(self.loops))
            self.loops.append(episode.loop)
            self.nows.append(begun(episode.loop, episode.state))

    def _next(self, arm: int) -> Episode:
        self.numbers[arm] = self.begun
        self.begun += 1
        return self.episode(self._first + int(self.numbers[arm]))

    def episode(self, seed: int) -> Episode:
        """Draw an episode."""
        case = self._draws.draw(seed, np.random.default_rng(seed), None).case
        return Episode(replace(case.loop, controller=self._controller), case.state)

    @property
    def arms(self) -> list[Arm]:
        """The arms where they are."""
        return [Arm(*each) for each in zip(self.loops, self.nows, strict=True)]

    def go_on(self, nows: Sequence[LoopState], steps: int, lost: np.ndarray) -> None:
        """Take over where the arms are, and begin anew where an episode is over.

        Parameters
        ----------
        nows
            Where they are.
        steps
            Time steps that the next stretch has: an episode that would end within is over.
        lost
            Arms that could not go on.
        """
        self.nows = list(nows)
        for arm, now in enumerate(nows):
            if lost[arm] or int(now.steps) + steps > self.ends[arm]:
                episode = self._next(arm)
                self.loops[arm] = episode.loop
                self.nows[arm] = begun(episode.loop, episode.state)
                self.ends[arm] = self.steps

    def saved(self) -> dict[str, np.ndarray]:
        """Return what it takes to go on later."""
        numbers = [np.stack(each) for each in zip(*map(_arrays, self.nows), strict=True)]
        kept = {f"now_{row}": each for row, each in enumerate(numbers)}
        return kept | {"begun": np.array(self.begun), "numbers": self.numbers, "ends": self.ends}

    def restore(self, saved: dict[str, np.ndarray]) -> None:
        """Go on from what was saved."""
        self.begun = int(saved["begun"])
        self.numbers, self.ends = saved["numbers"].copy(), saved["ends"].copy()
        for arm, number in enumerate(self.numbers):
            episode = self.episode(self._first + int(number))
            self.loops[arm] = episode.loop
            now = begun(episode.loop, episode.state)
            arrays = [np.asarray(saved[f"now_{row}"][arm]) for row in range(len(_arrays(now)))]
            self.nows[arm] = _like(now, arrays)


@compiled(**ONCE)
def begun(loop: Loop, state: State) -> LoopState:
    """Return a loop at its start."""
    return replace(loop.start(state), books=None)


def _arrays(tree: Any) -> list[np.ndarray]:
    return [np.asarray(each) for each in numbers_of(tree)]


def _like(tree: Any, arrays: Sequence[np.ndarray]) -> Any:
    leaves, form = jax.tree.flatten(tree)
    found = [jnp.asarray(x, leaf.dtype) for leaf, x in zip(leaves, arrays, strict=True)]
    return jax.tree.unflatten(form, found)


class Crew:
    """Runs a program for each of many arms: in threads on a processor, else all arms together."""

    def __init__(self) -> None:
        self._pool = ThreadPoolExecutor(cores()) if jax.default_backend() == "cpu" else None

    def each(self, program: Callable[[Any, Any], T], shared: Any, arms: Sequence[Any]) -> list[T]:
        """Return ``program(shared, arm)`` for each arm."""
        if self._pool is None:
            stacked = jax.tree.map(lambda *same: jnp.stack(same), *arms)
            found = _together(program, shared, stacked)
            return [jax.tree.map(lambda x, row=row: x[row], found) for row in range(len(arms))]
        # a thread has a context of its own, in which programs would not be kept
        futures = [self._pool.submit(copy_context().run, program, shared, arm) for arm in arms]
        return [future.result() for future in futures]


@eqx.filter_jit
def _together(program: Callable[[Any, Any], Any], shared: Any, arms: Any) -> Any:
    return jax.vmap(lambda arm: program(shared, arm))(arms)
