"""The arms that a policy is trained on, each in an episode of its own."""

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

_BACK, _TRIES = 3, 10
"""Stretches by which an arm that goes astray is put back, and how often until it is given up; as
many draws in a row may have no equilibrium."""
_COUNTS = ("numbers", "tries", "ends")


class Arm(NamedTuple):
    """An arm where it is."""

    loop: Loop
    now: LoopState


class Stage:
    """Arms, each of which goes on from where it was, or begins the next episode where it is over.

    Episodes are numbered in the order in which they begin; the number is the seed of its draw, so
    that training again is the same again. An arm that goes astray is put back to where it was some
    stretches before, until the policy holds it: what fails is rare, and would be met seldom.

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
        self.numbers, self.tries = np.zeros((2, count), int)
        """The number of the episode of each arm, and how often it was put back."""
        # the first episodes end one after the other, so that not all begin anew at once
        self.ends = self.steps * (1 + np.arange(count)) // count
        """The time step at which the episode of each arm is over."""
        self.arms: list[Arm] = [self._next(arm) for arm in range(count)]
        self.earlier = [[arm.now] * _BACK for arm in self.arms]
        """Where each was some stretches before, the oldest first."""

    def _next(self, arm: int) -> Arm:
        for _ in range(_TRIES):
            self.numbers[arm], self.tries[arm] = self.begun, 0
            self.begun += 1
            try:
                return self.drawn(self._first + int(self.numbers[arm]))
            except RuntimeError as error:  # no equilibrium to start from: the next one
                trouble = error
        raise trouble

    def episode(self, seed: int) -> Drawn:
        """Draw an episode by the arcsine law: its ends, where a policy fails, are met often."""
        random = np.random.default_rng(seed)
        values = {
            key: low + (high - low) * random.beta(0.5, 0.5)
            for key, (low, high) in self._draws.ranges.items()
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
            Arms that cannot go on, or are far off.
        """
        for arm, now in enumerate(nows):
            if astray[arm] and self.tries[arm] < _TRIES:
                self.tries[arm] += 1
                self._set(arm, self.earlier[arm][0], [self.earlier[arm][0]] * _BACK)
            elif astray[arm] or int(now.steps) + steps > self.ends[arm]:
                self.arms[arm], self.ends[arm] = self._next(arm), self.steps
                self.earlier[arm] = [self.arms[arm].now] * _BACK
            else:
                self._set(arm, now, [*self.earlier[arm][1:], self.arms[arm].now])

    def _set(self, arm: int, now: LoopState, earlier: list[LoopState]) -> None:
        self.arms[arm], self.earlier[arm] = self.arms[arm]._replace(now=now), earlier

    def saved(self) -> dict[str, np.ndarray]:
        """Return what it takes to go on later."""
        nows = [
            numbers_of(now)
            for arm, earlier in zip(self.arms, self.earlier, strict=True)
            for now in (*earlier, arm.now)
        ]
        kept = {f"now_{k}": np.stack(each) for k, each in enumerate(zip(*nows, strict=True))}
        counts = {name: getattr(self, name) for name in _COUNTS}
        return kept | counts | {"begun": np.array(self.begun)}

    def restore(self, saved: Mapping[str, np.ndarray]) -> None:
        """Go on from what was saved."""
        self.begun = int(saved["begun"])
        for name in _COUNTS:
            setattr(self, name, saved[name].copy())
        form = Form(self.arms[0].now)
        rows = [jnp.asarray(saved[f"now_{k}"]) for k in range(len(form.shapes))]
        nows = [form.tree([row[k] for row in rows]) for k in range(len(rows[0]))]
        for arm, number in enumerate(self.numbers):
            *earlier, now = nows[arm * (_BACK + 1) :][: _BACK + 1]
            self.arms[arm] = self.drawn(self._first + int(number))
            self._set(arm, now, earlier)


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
