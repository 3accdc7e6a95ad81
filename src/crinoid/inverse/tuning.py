"""Tuning of a controller by gradients, from several starts and over several random draws."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import replace
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jaxtyping import Float

from crinoid.analysis.linear_loop import LinearPlant
from crinoid.assembly.prepared import Prepared
from crinoid.dynamics import Reason, State
from crinoid.foundation.status import Status
from crinoid.inverse import StoppedError
from crinoid.inverse.constrained_search import constrain
from crinoid.inverse.gain_design import (
    Cost,
    CostWeights,
    GainDesign,
    GainPerturbations,
    Logs,
    cost,
    tunable_numbers,
)
from crinoid.inverse.gain_search import GainTrial, StabilityConstraint, bounds, descend, nearest
from crinoid.inverse.threads import results
from crinoid.results.dataset import describe, described
from crinoid.scenario import Scenario, ScenarioError
from crinoid.simulation import Loop, closed_loop
from crinoid.simulation.batch import cores
from crinoid.simulation.setup import set_up

__all__ = ["Tuning"]

STARTS = (1.0, 2.0, 16.0, 0.25)
"""Factors on the gains of the scenario, one for each start."""
_FIRST = 0.5
"""Share of the required margin in the first part of a search, and of its trials."""
MARGINS = {"modulus": "1", "gain": "1", "phase": "rad", "delay": "s"}
"""Margins of a loop (`crinoid.simulation.loop_margin.Margin`), and their units."""
HELD_OUT = ("before", "after", "uncontrolled")
"""Controllers that held-out draws compare."""

Report = Callable[[int, int, float], None]
_Found = tuple[float, Logs]


class _Draw(NamedTuple):
    """Closed loop with one draw of its random numbers."""

    loop: Loop
    state: State


class Tuning:
    """Search for the parameters of a controller, with its results so far.

    All starts are improved in parallel by a quasi-Newton method (L-BFGS-B, Byrd et al. 1995) on the
    logarithms of the parameters, by the gradient of the logarithm of the mean cost over the draws.
    If a margin is required (`crinoid.inverse.gain_search`), a penalty first enforces half of it.
    Then each start moves to the nearest parameters with all of it, and the best one continues with
    the margin as a constraint (SLSQP, Kraft 1988). Unstable loops are not run. A start that fails
    is given up; from other failures the search steps back. Gains that are 0 stay 0, others keep
    their sign.

    There are ``seeds`` draws, with seeds from that of the scenario on, and as many held out. Each
    start has at most ``iterations`` trials. ``margin`` is the required modulus margin; 0: none.
    """

    def __init__(
        self, scenario: Scenario, seeds: int, iterations: int, margin: float = 0.0
    ) -> None:
        tunable_numbers(scenario)
        self.scenario, self.iterations, self.margin = scenario, iterations, margin
        seed = scenario.seed
        self.draws = [self._draw(seed + number) for number in range(min(seeds, 2))]
        self.random = len(self.draws) < 2 or not _equal(*self.draws)
        if self.random:
            self.draws += [self._draw(seed + number) for number in range(2, seeds)]
        else:  # all draws are equal
            self.draws = self.draws[:1]
        self.seeds = [seed + number for number in range(len(self.draws))]
        setup = set_up(Prepared(scenario))
        self._design = GainDesign(setup.plan)
        self.initial = self._design.initial
        plant = LinearPlant.of(setup) if margin else None
        self._stability = None if plant is None else StabilityConstraint(plant, setup)
        self._weights = CostWeights.of(scenario, setup.loop)
        self.first = max(1, round(_FIRST * iterations)) if margin else iterations
        first, more = (self.first + 1, iterations) if margin else (self.first, 0)
        count, shape = len(self.initial), (len(STARTS), first + more)
        self.total = len(STARTS) * first + more
        self.cost, self.modulus = np.full(shape, np.nan), np.full(shape, np.nan)
        self.logs = np.full((*shape, count), np.nan)
        self.best, self.least, self._rank = np.zeros(count), np.inf, (True, np.inf)
        self.trials = np.zeros(len(STARTS), int)
        self.failure = ""
        self._limited, self._best_start = np.zeros(len(STARTS), bool), 0
        self._lock, self._stopped = threading.Lock(), threading.Event()
        self._pool = ThreadPoolExecutor(cores())
        self.held_out: dict[str, Float[np.ndarray, " seed"]] = {}

    def _draw(self, seed: int) -> _Draw:
        return _Draw(*closed_loop(self.scenario.with_values({"seed": seed})))

    @property
    def done(self) -> int:
        """The largest number of trials from a start."""
        return int(self.trials.max())

    @property
    def ended_at_limit(self) -> bool:
        """Whether the start with the best parameters used all its trials."""
        return bool(self._limited[self._best_start])

    @property
    def keeps_margin(self) -> bool:
        """Whether the best parameters have the required margin."""
        return not self._rank[0]

    def run(self, report: Report, stop: Callable[[], bool]) -> None:
        """Search for `best`, the logarithms of the best parameters over the initial ones."""
        # compiles for all, and is what an early interruption saves
        given = self._trial(0, self.best, _FIRST * self.margin)

        def poll() -> None:
            report(int(self.trials.sum()), self.total, self.least)
            if stop():
                self._stopped.set()

        with ThreadPoolExecutor(len(STARTS)) as pool:
            try:
                starts = range(len(STARTS))
                found = results([pool.submit(self._search, start, given) for start in starts], poll)
                best = min(starts, key=lambda start: found[start][0])
                if self._stability is not None and np.isfinite(found[best][0]):
                    results([pool.submit(self._refine, best, found[best][1])], poll)
            finally:
                self._stopped.set()

    def _search(self, start: int, given: GainTrial) -> _Found:
        """Search from one start; return the best value with the margin, and its logarithms.

        ``given`` is the trial of the given values, which is not run again.
        """
        best: _Found = np.inf, self.best

        def attempt(logs: Logs) -> GainTrial:
            nonlocal best
            found = given
            if logs.any():
                if self.trials[start] == self.first:
                    self._limited[start] = True
                    raise StopIteration
                found = self._trial(start, logs, _FIRST * self.margin)
            if found.stable and found.penalised < best[0]:
                best = found.penalised, logs.copy()
            return found

        with suppress(StoppedError, StopIteration):
            descend(attempt, np.full(len(self.initial), np.log(STARTS[start])))
        if self._stability is not None and np.isfinite(best[0]):
            with suppress(StoppedError, ScenarioError):
                close = nearest(self._excess, best[1])
                found = self._trial(start, close, self.margin)
                return found.penalised if found.stable else np.inf, close
        return best

    def _refine(self, start: int, begin: Logs) -> None:
        """Continue the search with the whole margin."""
        self._limited[start] = False

        def attempt(logs: Logs) -> GainTrial:
            if self.trials[start] == self.cost.shape[1]:
                self._limited[start] = True
                raise StopIteration
            return self._trial(start, logs, self.margin)

        with suppress(StoppedError, StopIteration):
            constrain(attempt, begin, bounds(begin))

    def _excess(self, logs: Logs) -> tuple[float, Logs]:
        if self._stopped.is_set():
            raise StoppedError
        assert self._stability is not None
        return self._stability.excess(self._design.perturbations(logs), self.margin)[1:]

    def _trial(self, start: int, logs: Logs, margin: float) -> GainTrial:
        """Run the draws, if the loop is stable."""
        if self._stopped.is_set():
            raise StoppedError
        none = np.zeros_like(logs)
        found, modulus, shortfall, runs = GainTrial(np.nan, none, 0.0, none), np.nan, 0.0, []
        try:
            controllers = self._design.perturbations(logs)
        except ScenarioError as error:  # such a controller does not exist
            self.failure = self.failure or "; ".join(error.lines)
        else:
            if self._stability is not None:
                loop, excess, gradient = self._stability.excess(controllers, margin)
                modulus = loop.modulus if loop.stable else 0.0
                shortfall = self._stability.shortfall(loop, self.margin)
                found = GainTrial(np.nan, none, excess, gradient)
            if found.stable:
                runs = self._costs(controllers, self.draws, self._stopped.is_set)
                mean = np.mean([each.total for each in runs])
                gradient = np.mean([each.gradient for each in runs], axis=0) / mean
                if np.isfinite(gradient).all():
                    found = found._replace(value=float(np.log(mean)), gradient=gradient)
            else:
                self.failure = self.failure or "the closed loop is unstable. Set other gains."
        total = float(np.exp(found.value))
        with self._lock:
            number = self.trials[start]
            self.trials[start] += 1
            self.logs[start, number] = logs
            self.cost[start, number], self.modulus[start, number] = total, modulus
            self._explain(runs)
            # any with the margin are better than any without, which rank by their shortfall
            misses = shortfall > 0
            rank = misses, shortfall if misses else total
            if np.isfinite(total) and rank < self._rank:
                self.best, self.least, self._rank = logs.copy(), total, rank
                self._best_start = start
        return found

    def _costs(
        self, controllers: GainPerturbations, draws: Sequence[_Draw], stop: Callable[[], bool]
    ) -> list[Cost]:
        """Run draws, as many at a time as there are cores."""
        slopes, steps = controllers.slopes, self.scenario.simulation.steps

        def run(draw: _Draw) -> Cost:
            nominal = controllers.nominal
            found = cost(nominal, slopes, draw.loop, draw.state, self._weights, steps)
            return jax.tree.map(np.asarray, found)

        futures = [self._pool.submit(run, draw) for draw in draws]

        def poll() -> None:
            if stop():
                for each in futures:
                    each.cancel()
                raise StoppedError

        return results(futures, poll)

    def hold_out(self, stop: Callable[[], bool]) -> None:
        """Compute the costs before and after tuning, and without control, in held-out draws."""
        draws = self.draws
        if self.random:
            first = self.seeds[-1] + 1
            draws = [self._draw(first + number) for number in range(len(draws))]
        before = self._design.perturbations(np.zeros_like(self.best))
        after = self._design.perturbations(self.best)
        off = [draw._replace(loop=replace(draw.loop, enabled=jnp.asarray(False))) for draw in draws]
        with suppress(StoppedError):
            for when, controllers, some in zip(
                HELD_OUT, (before, after, before), (draws, draws, off), strict=True
            ):
                runs = self._costs(controllers, some, stop)
                self.held_out[when] = np.array([float(each.total) for each in runs])
                self.held_out[f"{when}_error"] = np.sqrt([float(each.error) for each in runs])

    def tuned(self) -> dict[str, float]:
        """Return the best parameters by key."""
        return self._design.values(self.best, digits=6)

    def dataset(self) -> xr.Dataset:
        """Return the course of the search."""
        initial = np.array(list(self.initial.values()))
        tried = initial * np.exp(self.logs[:, : self.done])
        held_out = dict.fromkeys(HELD_OUT, "m2") | {f"{name}_error": "m" for name in HELD_OUT}
        none = np.full(len(self.draws), np.nan)
        rows = [
            ("cost", "start iteration", "m2", self.cost[:, : self.done], ""),
            ("modulus", "start iteration", "1", self.modulus[:, : self.done], ""),
            ("tried", "start iteration key", "", tried, ""),
            ("given", "key", "", initial, ""),
            ("tuned", "key", "", initial * np.exp(self.best), ""),
            *((name, "held_out", unit, self.held_out.get(name, none), "")
              for name, unit in held_out.items()),
        ]  # fmt: skip
        waters = {}
        for when, logs in (("before", np.zeros_like(self.best)), ("after", self.best)):
            if self._stability is None:
                continue
            loop = self._stability.closed(self._design.controller(logs))
            margin, waters[f"{when}_water"] = loop.open.margin(), loop.water
            for name, unit in MARGINS.items():
                value = getattr(margin, name) if margin.stable else np.nan
                rows.append((f"{when}_{name}_margin", "", unit, value, ""))
        status = self.failure if not np.isfinite(self.least) else Status.OK.value
        kind = self.scenario.control.kind
        pairs = zip(self.initial, self.best, bounds(self.best), strict=True)
        ends = [key for key, log, (_, high) in pairs if abs(log) > 0.99 * high]
        return xr.Dataset(
            described(rows),
            {
                "key": [key.removeprefix(f"control.{kind}.") for key in self.initial],
                "iteration": np.arange(1, self.done + 1),
            },
            describe(self.scenario)
            | {"status": status, "margin": self.margin, "at_end": ", ".join(ends)}
            | waters,
        )

    def _explain(self, runs: Sequence[Cost]) -> None:
        step = self.scenario.simulation.time_step
        for each in runs:
            if not each.converged and not self.failure:
                reason = Reason(int(each.reason)).words
                when = f"failed at t = {int(each.steps) * step:.6g} s"
                self.failure = f"{when}: {reason}; try a smaller simulation.time_step"


def _equal(one: _Draw, other: _Draw) -> bool:
    """Return whether two draws are equal, which a noisy sensor rules out."""
    if any(np.any(np.asarray(sensor.noise)) for sensor in one.loop.sensors):
        return False
    # random keys of absent noise may differ
    numbers = (
        jax.tree.leaves((replace(draw.loop, sensors=()), draw.state)) for draw in (one, other)
    )
    pairs = zip(*numbers, strict=True)
    return all(np.array_equal(np.asarray(a), np.asarray(b)) for a, b in pairs)
