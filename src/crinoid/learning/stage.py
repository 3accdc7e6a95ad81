"""The arms that a policy is trained on, each in an episode of its own."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
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
from crinoid.environment.draws import Drawn, Draws
from crinoid.environment.program import Form, numbers_of
from crinoid.programs import ONCE, Program, compiled
from crinoid.simulation import Loop, LoopState
from crinoid.simulation.batch import cores

T = TypeVar("T")


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
        # the first episodes end one after the other, so that not all begin anew at once
        self.ends = self.steps * (1 + np.arange(count)) // count
        """The time step at which the episode of each arm is over."""
        self.arms = [self._next(arm) for arm in range(count)]

    def _next(self, arm: int) -> Arm:
        self.numbers[arm] = self.begun
        self.begun += 1
        return self.drawn(self._first + int(self.numbers[arm]))

    def episode(self, seed: int) -> Drawn:
        """Draw an episode by the arcsine law: its ends, where a policy fails, are met often."""
        random, ranges = np.random.default_rng(seed), self._draws.ranges
        values = {
            key: low + (high - low) * random.beta(0.5, 0.5) for key, (low, high) in ranges.items()
        }
        return self._draws.draw(seed, random, {"set": values})

    def drawn(self, seed: int) -> Arm:
        """Draw an episode, and return its arm at the start."""
        case = self.episode(seed).case
        loop = replace(case.loop, controller=self._controller)
        return Arm(loop, _begun(loop, case.state))

    def go_on(self, nows: Sequence[LoopState], steps: int, astray: np.ndarray) -> None:
        """Take over where the arms are, and begin anew where an episode is over.

        Parameters
        ----------
        nows
            Where they are.
        steps
            Time steps that the next stretch has: an episode that would end within is over.
        astray
            Arms that cannot go on, or from which nothing more is to be learned.
        """
        for arm, now in enumerate(nows):
            if astray[arm] or int(now.steps) + steps > self.ends[arm]:
                self.arms[arm], self.ends[arm] = self._next(arm), self.steps
            else:
                self.arms[arm] = self.arms[arm]._replace(now=now)

    def saved(self) -> dict[str, np.ndarray]:
        """Return what it takes to go on later."""
        nows = [numbers_of(arm.now) for arm in self.arms]
        kept = {f"now_{k}": np.stack(each) for k, each in enumerate(zip(*nows, strict=True))}
        return kept | {"begun": np.array(self.begun), "numbers": self.numbers, "ends": self.ends}

    def restore(self, saved: Mapping[str, np.ndarray]) -> None:
        """Go on from what was saved."""
        self.begun = int(saved["begun"])
        self.numbers, self.ends = saved["numbers"].copy(), saved["ends"].copy()
        form = Form(self.arms[0].now)
        for arm, number in enumerate(self.numbers):
            arrays = [jnp.asarray(saved[f"now_{k}"][arm]) for k in range(len(form.shapes))]
            start = self.drawn(self._first + int(number))
            self.arms[arm] = start._replace(now=form.tree(arrays))


@compiled(**ONCE)
def _begun(loop: Loop, state: State) -> LoopState:
    return replace(loop.start(state), books=None)


class Crew:
    """Runs a program for each of many arms: in threads on a processor, else all arms together."""

    def __init__(self) -> None:
        self._pool = ThreadPoolExecutor(cores()) if jax.default_backend() == "cpu" else None

    def each(self, program: Program[[Any, Any], T], shared: Any, arms: Sequence[Any]) -> list[T]:
        """Return ``program(shared, arm)`` for each arm."""
        if self._pool is None:
            stacked = jax.tree.map(lambda *same: jnp.stack(same), *arms)
            found = _together(program.function, shared, stacked)
            return [jax.tree.map(lambda x, row=row: x[row], found) for row in range(len(arms))]
        # a thread has a context of its own, in which programs would not be kept
        futures = [self._pool.submit(copy_context().run, program, shared, arm) for arm in arms]
        return [future.result() for future in futures]


@eqx.filter_jit
def _together(program: Callable[[Any, Any], Any], shared: Any, arms: Any) -> Any:
    return jax.vmap(lambda arm: program(shared, arm))(arms)
