"""The search for a controller's numbers: several starts at once, over draws of what is random."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_EXCEPTION, Future, ThreadPoolExecutor, wait
from contextlib import suppress
from contextvars import copy_context
from dataclasses import replace
from typing import Any, NamedTuple, TypeVar

import jax
import numpy as np
import xarray as xr
from jaxtyping import Float

from crinoid.assembly.prepared import Prepared
from crinoid.dataset import describe
from crinoid.dynamics import Reason, State
from crinoid.scenario import Scenario, ScenarioError
from crinoid.simulation import Loop, closed_loop
from crinoid.simulation.batch import cores
from crinoid.simulation.linear_loop import LinearPlant
from crinoid.simulation.setup import set_up
from crinoid.status import Status
from crinoid.tuning.cost import Cost, Weights, cost
from crinoid.tuning.design import Around, Design, Logs, tuned_numbers
from crinoid.tuning.search import Trial, constrain, descend, nearest
from crinoid.tuning.stability import Stability

__all__ = ["Tuning"]

STARTS = (1.0, 2.0, 16.0, 0.25)
"""Factors on the gains of the scenario that the search begins with."""
_FIRST = 0.5
"""Share of the margin asked for that a search keeps to at first, and of the trials it has then."""
MARGINS = {"modulus": "1", "gain": "1", "phase": "rad", "delay": "s"}
"""Margins of a loop (`crinoid.simulation.margin.Margin`), and their units."""
_LOOK = 0.1
"""Time between two looks at what the threads do (s)."""

Report = Callable[[int, int, float], None]
T = TypeVar("T")
_Found = tuple[float, Logs]


class _Draw(NamedTuple):
    """A closed loop with one draw of what is random."""

    loop: Loop
    state: State


class Tuning:
    """A search for the numbers of a controller, and what it has found so far.

    Each start is improved by a quasi-Newton method (L-BFGS-B, Byrd et al. 1995) on the logarithms
    of its numbers, by the slope of the logarithm of its mean cost over the draws, all starts at
    once. Where a margin is asked for (`crinoid.tuning.stability`) half of it is held by a penalty
    first. Then numbers close by that keep all of it are looked for from each; the best of these go
    on with the margin as a constraint (SLSQP, Kraft 1988). An unstable loop is not run. A start
    that cannot be run is left where it is, other numbers are stepped back from.

    Parameters
    ----------
    scenario
        What to tune for; gains that are 0 stay 0, others keep their sign.
    seeds
        Number of draws: seeds from that of the scenario on. As many more are held out.
    iterations
        Largest number of trials from each start.
    asked
        Modulus margin that is asked for; 0: none.
    """

    def __init__(self, scenario: Scenario, seeds: int, iterations: int, asked: float = 0.0) -> None:
        tuned_numbers(scenario)
        self.scenario, self.asked = scenario, asked
        first = scenario.seed
        self.draws = [self._draw(first + number) for number in range(min(seeds, 2))]
        self.random = len(self.draws) < 2 or not _equal(*self.draws)
        if self.random:
            self.draws += [self._draw(first + number) for number in range(2, seeds)]
        else:  # they are all the same
            self.draws = self.draws[:1]
        self.seeds = [first + number for number in range(len(self.draws))]
        prepared = Prepared(scenario)
        setup = set_up(prepared)
        self._design = Design(setup.plan)
        self.given = self._design.given
        self._stability = Stability(LinearPlant.of(prepared, setup), setup) if asked else None
        self._weights = Weights.of(scenario, setup.loop)
        self.first = max(1, round(_FIRST * iterations)) if asked else iterations
        begun, more = (self.first + 1, iterations) if asked else (self.first, 0)
        count, shape = len(self.given), (len(STARTS), begun + more)
        self.total = len(STARTS) * begun + more
        self.cost, self.modulus = np.full(shape, np.nan), np.full(shape, np.nan)
        self.logs = np.full((*shape, count), np.nan)
        self.best, self.least, self._rank = np.zeros(count), np.inf, (True, np.inf)
        self.tried = np.zeros(len(STARTS), int)
        self.failure = ""
        self._lock, self._pool = threading.Lock(), ThreadPoolExecutor(cores())
        self.held_out: dict[str, Float[np.ndarray, " seed"]] = {}

    def _draw(self, seed: int) -> _Draw:
        return _Draw(*closed_loop(self.scenario.with_values({"seed": seed})))

    @property
    def done(self) -> int:
        """The largest number of trials from a start."""
        return int(self.tried.max())

    @property
    def keeps_margin(self) -> bool:
        """Whether the best ones keep the margin that is asked for."""
        return not self._rank[0]

    def run(self, report: Report, stop: Callable[[], bool]) -> None:
        """Search; `best` are the logarithms of the best numbers so far, over those given."""
        around = self._design.around(self.best)
        if self._stability is not None:
            self._stability.nearness(around, self.asked)
        self._costs(around, self.draws[:1], lambda: False)  # compiles for all
        stopped = threading.Event()
        with ThreadPoolExecutor(len(STARTS)) as pool:

            def together(improve: Callable[..., T], *each: tuple[Any, ...]) -> list[T]:
                futures = [_submit(pool, improve, stopped, *given) for given in each]
                waiting = set(futures)
                while waiting:
                    done, waiting = wait(waiting, _LOOK, FIRST_EXCEPTION)
                    report(int(self.tried.sum()), self.total, self.least)
                    if stop():
                        stopped.set()
                    for future in done:
                        future.result()
                return [future.result() for future in futures]

            try:
                found = together(self._begin, *((start,) for start in range(len(STARTS))))
                best = min(range(len(STARTS)), key=lambda start: found[start][0])
                if self._stability is not None and np.isfinite(found[best][0]):
                    together(self._go_on, (best, found[best][1]))
            finally:
                stopped.set()

    def _begin(self, stopped: threading.Event, start: int) -> _Found:
        """Search from one start; return the best value that keeps the margin, and where it is."""
        best: _Found = np.inf, self.best

        def attempt(logs: Logs) -> Trial:
            nonlocal best
            if self.tried[start] == self.first:
                raise StopIteration
            found = self._try(start, logs, _FIRST * self.asked, stopped)
            if found.stable and found.penalised < best[0]:
                best = found.penalised, logs.copy()
            return found

        with suppress(_StoppedError, StopIteration):
            descend(attempt, np.full(len(self.given), np.log(STARTS[start])))
        if self._stability is not None and np.isfinite(best[0]):
            with suppress(_StoppedError, ScenarioError):
                close = self._close(stopped, self._stability, best[1])
                found = self._try(start, close, self.asked, stopped)
                return found.penalised if found.stable else np.inf, close
        return best

    def _go_on(self, stopped: threading.Event, start: int, begin: Logs) -> None:
        """Search on with the whole margin."""

        def attempt(logs: Logs) -> Trial:
            if self.tried[start] == self.cost.shape[1]:
                raise StopIteration
            return self._try(start, logs, self.asked, stopped)

        with suppress(_StoppedError, StopIteration):
            constrain(attempt, begin)

    def _close(self, stopped: threading.Event, stability: Stability, begin: Logs) -> Logs:
        """Return numbers close by that keep all of the margin, if there are such."""

        def excess(logs: Logs) -> tuple[float, Logs]:
            if stopped.is_set():
                raise _StoppedError
            found = stability.nearness(self._design.around(logs), self.asked)
            return found.excess, found.slope

        return nearest(excess, begin)

    def _try(self, start: int, logs: Logs, asked: float, stopped: threading.Event) -> Trial:
        """Run the draws, if the loop is stable."""
        if stopped.is_set():
            raise _StoppedError
        none = np.zeros_like(logs)
        found, modulus, lack, runs = Trial(np.nan, none, 0.0, none), np.nan, 0.0, []
        try:
            around = self._design.around(logs)
        except ScenarioError as error:  # there is no such controller
            self.failure = self.failure or "; ".join(error.lines)
        else:
            if self._stability is not None:
                margin, excess, by = self._stability.nearness(around, asked)
                modulus = margin.modulus if margin.stable else 0.0
                lack = self._stability.lack(margin, self.asked)
                found = Trial(np.nan, none, excess, by)
            if found.stable:
                runs = self._costs(around, self.draws, stopped.is_set)
                mean = np.mean([each.total for each in runs])
                slope = np.mean([each.slope for each in runs], axis=0) / mean
                if np.isfinite(slope).all():
                    found = found._replace(value=float(np.log(mean)), slope=slope)
            else:
                self.failure = self.failure or "the closed loop is unstable, take other numbers"
        total = float(np.exp(found.value))
        with self._lock:
            number = self.tried[start]
            self.tried[start] += 1
            self.logs[start, number] = logs
            self.cost[start, number], self.modulus[start, number] = total, modulus
            self._explain(runs)
            # what keeps the margin comes before what does not, and that before what is farther off
            misses = lack > 0
            rank = misses, lack if misses else total
            if np.isfinite(total) and rank < self._rank:
                self.best, self.least, self._rank = logs.copy(), total, rank
        return found

    def _costs(
        self, around: Around, draws: Sequence[_Draw], stop: Callable[[], bool]
    ) -> list[Cost]:
        """Run draws, as many at a time as there are cores."""
        slopes, steps = around.slopes, self.scenario.simulation.steps

        def run(draw: _Draw) -> Cost:
            found = cost(around.here, slopes, draw.loop, draw.state, self._weights, steps)
            return jax.tree.map(np.asarray, found)

        futures = [_submit(self._pool, run, draw) for draw in draws]
        waiting = set(futures)
        while waiting:
            _, waiting = wait(waiting, _LOOK)
            if stop():
                for each in waiting:
                    each.cancel()
                raise _StoppedError
        return [future.result() for future in futures]

    def hold_out(self, stop: Callable[[], bool]) -> None:
        """Find what the numbers before and after cost in draws that were not tuned for."""
        draws = self.draws
        if self.random:
            first = self.seeds[-1] + 1
            draws = [self._draw(first + number) for number in range(len(draws))]
        found = []
        for logs in (np.zeros_like(self.best), self.best):
            with suppress(_StoppedError):
                found.append(self._costs(self._design.around(logs), draws, stop))
        if len(found) < 2:
            return
        costs = np.array([[float(each.total) for each in runs] for runs in found])
        errors = np.sqrt([[float(each.error) for each in runs] for runs in found])
        self.held_out = {
            "before": costs[0],
            "after": costs[1],
            "before_error": errors[0],
            "after_error": errors[1],
        }

    def tuned(self) -> Scenario:
        """Return the scenario with the best numbers."""
        found = self._values(self.best)
        rounded = {key: float(f"{value:.6g}") for key, value in found.items()}
        return self.scenario.with_values(rounded)

    def _values(self, logs: Logs) -> dict[str, float]:
        factors = np.exp(logs)
        return {key: given * f for (key, given), f in zip(self.given.items(), factors, strict=True)}

    def dataset(self) -> xr.Dataset:
        """Return how the search went."""
        given = np.array(list(self.given.values()))
        tried = given * np.exp(self.logs[:, : self.done])
        variables: dict[str, Any] = {
            "cost": (("start", "iteration"), self.cost[:, : self.done], {"units": "m2"}),
            "modulus": (("start", "iteration"), self.modulus[:, : self.done], {"units": "1"}),
            "tried": (("start", "iteration", "key"), tried),
            "given": (("key",), given),
            "tuned": (("key",), given * np.exp(self.best)),
        }
        units = {"before": "m2", "after": "m2", "before_error": "m", "after_error": "m"}
        for name, unit in units.items():
            row = self.held_out.get(name, np.full(len(self.draws), np.nan))
            variables[name] = (("held_out",), row, {"units": unit})
        waters = {}
        for when, logs in (("before", np.zeros_like(self.best)), ("after", self.best)):
            if self._stability is None:
                continue
            loop = self._stability.closed(self._design.controller(logs))
            margin, waters[f"{when}_water"] = loop.open.margin(), loop.water
            for name, unit in MARGINS.items():
                value = getattr(margin, name) if margin.stable else np.nan
                variables[f"{when}_{name}_margin"] = ((), value, {"units": unit})
        status = self.failure if not np.isfinite(self.least) else Status.OK.value
        kind = self.scenario.control.kind
        return xr.Dataset(
            variables,
            {
                "key": [key.removeprefix(f"control.{kind}.") for key in self.given],
                "iteration": np.arange(1, self.done + 1),
            },
            describe(self.scenario) | {"status": status, "margin": self.asked} | waters,
        )

    def _explain(self, runs: Sequence[Cost]) -> None:
        step = self.scenario.simulation.time_step
        for each in runs:
            if not each.converged and not self.failure:
                reason = Reason(int(each.reason)).words
                when = f"failed at t = {int(each.steps) * step:.6g} s"
                self.failure = f"{when}: {reason}; try a smaller simulation.time_step"


def _submit(pool: ThreadPoolExecutor, call: Callable[..., T], *given: Any) -> Future[T]:
    # a thread has a context of its own, in which programs would not be kept
    return pool.submit(copy_context().run, call, *given)


class _StoppedError(Exception):
    """The search was asked to stop."""


def _equal(one: _Draw, other: _Draw) -> bool:
    """Tell whether two draws are the same, which a noisy sensor rules out."""
    if any(np.any(np.asarray(sensor.noise)) for sensor in one.loop.sensors):
        return False
    # keys of noise that is not there differ
    numbers = (
        jax.tree.leaves((replace(draw.loop, sensors=()), draw.state)) for draw in (one, other)
    )
    pairs = zip(*numbers, strict=True)
    return all(np.array_equal(np.asarray(a), np.asarray(b)) for a, b in pairs)
