"""The search for gains: several starts at once, over several draws of what is random."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_EXCEPTION, ThreadPoolExecutor, wait
from contextlib import suppress
from contextvars import copy_context
from dataclasses import replace
from typing import Any, NamedTuple

import jax
import numpy as np
import xarray as xr
from jaxtyping import Float
from scipy.optimize import minimize

from crinoid.dynamics import Reason, State
from crinoid.scenario import Mistake, Scenario, ScenarioError
from crinoid.simulation import Loop, closed_loop
from crinoid.simulation.batch import cores
from crinoid.status import Status
from crinoid.tuning.cost import GAINS, Cost, Weights, cost, gains_of

__all__ = ["Tuning", "check_tunable"]

STARTS = (1.0, 2.0, 16.0, 0.25)
"""Factors on the gains of the scenario that the search begins with."""
_MOST = 7.0
"""Largest change of the logarithm of a gain."""
_STEP = 0.2
"""Change of the logarithm of the gains by the first step of a search: farther out a loop may be
unstable."""
_FAILED = 5.0
"""By how much the logarithm of the cost of gains that cannot be run is above the best one."""
_LOOK = 0.1
"""Time between two looks at what the threads do (s)."""

Gains = Float[np.ndarray, "gain input"]
Report = Callable[[int, int, float], None]


def check_tunable(scenario: Scenario) -> None:
    """Refuse a scenario whose controller has no gains to tune.

    Raises
    ------
    ScenarioError
        If there are none.
    """
    if scenario.vary:
        text = "tuning is of one case; give its values with --set and leave out vary"
        raise ScenarioError([Mistake("vary", text)])
    kind = scenario.control.kind
    if kind != "pid":
        text = f'got "{kind}", which has no gains to tune, takes "pid"'
        raise ScenarioError([Mistake("control.kind", text)])
    if not _keys(scenario):
        text = "has no gains to tune, takes some that are not 0 to begin with"
        raise ScenarioError([Mistake("control.pid", text)])


class _Draw(NamedTuple):
    """A closed loop with one draw of what is random."""

    loop: Loop
    state: State


class Tuning:
    """A search for the gains of a PID, and what it has found so far.

    Each start is improved by a quasi-Newton method (L-BFGS-B, Byrd et al. 1995) on the logarithms
    of its gains, by the slope of the logarithm of its mean cost over the draws, all starts at once.
    Gains that cannot be run, as their cost is no number, are stepped back from; a start that cannot
    be run is left where it is.

    Parameters
    ----------
    scenario
        What to tune for; gains that are 0 stay 0, others keep their sign.
    seeds
        Number of draws: seeds from that of the scenario on. As many more are held out.
    iterations
        Largest number of gains that are tried from each start.

    Raises
    ------
    ScenarioError
        If there is nothing to tune.
    RuntimeError
        If a draw has no equilibrium to start from.
    """

    def __init__(self, scenario: Scenario, seeds: int, iterations: int) -> None:
        check_tunable(scenario)
        self.scenario, self.keys = scenario, _keys(scenario)
        first = scenario.seed
        self.draws = [self._draw(first + number) for number in range(min(seeds, 2))]
        self.random = len(self.draws) < 2 or not _equal(*self.draws)
        if self.random:
            self.draws += [self._draw(first + number) for number in range(2, seeds)]
        else:  # they are all the same
            self.draws = self.draws[:1]
        self.seeds = [first + number for number in range(len(self.draws))]
        loop = self.draws[0].loop
        self.given = gains_of(loop)
        self._weights = Weights.of(scenario, loop)
        names = [each.name for each in loop.system.inputs]
        self._at = [(GAINS.index(gain), names.index(name)) for name, gain in self.keys]
        shape = len(STARTS), iterations
        self.cost = np.full(shape, np.nan)
        self.gains = np.full((*shape, len(self.keys)), np.nan)
        self.best, self.least = self.given, np.inf
        self.tried = np.zeros(len(STARTS), int)
        self.failure = ""
        self._lock = threading.Lock()
        self.held_out: dict[str, Float[np.ndarray, " seed"]] = {}

    def _draw(self, seed: int) -> _Draw:
        return _Draw(*closed_loop(self.scenario.with_values({"seed": seed})))

    @property
    def done(self) -> int:
        """The largest number of gains that were tried from a start."""
        return int(self.tried.max())

    def run(self, report: Report, stop: Callable[[], bool]) -> None:
        """Search; `best` are the gains of the least cost that was found so far."""
        stopped = threading.Event()
        self._try(0, np.log(STARTS[0]) * np.ones(len(self.keys)), stopped)  # compiles for all
        with ThreadPoolExecutor(cores()) as pool:
            # a thread has a context of its own, in which programs would not be kept
            futures = {
                pool.submit(copy_context().run, self._improve, start, stopped)
                for start in range(len(STARTS))
            }
            while futures:
                done, futures = wait(futures, _LOOK, FIRST_EXCEPTION)
                report(int(self.tried.sum()), self.cost.size, self.least)
                if stop():
                    stopped.set()
                for future in done:
                    future.result()

    def _improve(self, start: int, stopped: threading.Event) -> None:
        """Search from one start."""
        begin = np.full(len(self.keys), np.log(STARTS[start])) / _STEP
        highest = np.nan

        def of(steps: Any) -> tuple[float, Any]:
            nonlocal highest
            if self.tried[start] == self.cost.shape[1]:
                raise StopIteration
            total, slope = self._try(start, _STEP * steps, stopped)
            if not np.isfinite(total):
                if np.isnan(highest):  # nothing to step back to
                    raise StopIteration
                return highest + _FAILED, np.zeros_like(slope)
            value = float(np.log(total))
            highest = max(highest, value) if np.isfinite(highest) else value
            return value, _STEP * slope / total

        bounds = [(-_MOST / _STEP, _MOST / _STEP)] * len(begin)
        with suppress(_StoppedError, StopIteration):
            minimize(of, begin, jac=True, method="L-BFGS-B", bounds=bounds)

    def _try(self, start: int, logs: Any, stopped: threading.Event) -> tuple[float, Any]:
        """Return cost and slope of gains, by their logarithms over those of the scenario."""
        runs = []
        for draw in self.draws:
            if stopped.is_set():
                raise _StoppedError
            runs.append(self._cost(self._full(logs), draw))
        total = float(np.mean([each.total for each in runs]))
        slope = np.mean([[each.slope[at] for at in self._at] for each in runs], axis=0)
        if not np.isfinite(slope).all():
            total = np.nan
        with self._lock:
            number = self.tried[start]
            self.tried[start] += 1
            gains = self._full(logs)
            self.gains[start, number] = [gains[at] for at in self._at]
            self.cost[start, number] = total
            if not np.isfinite(total):
                self._explain(runs)
            elif total < self.least:
                self.best, self.least = gains, total
        return total, slope

    def _full(self, logs: Any) -> Gains:
        """Return all gains, from the logarithms of those that are tuned over the given ones."""
        gains = self.given.copy()
        for at, log in zip(self._at, logs, strict=True):
            gains[at] *= np.exp(log)
        return gains

    def _cost(self, gains: Gains, draw: _Draw) -> Cost:
        steps = self.scenario.simulation.steps
        found = cost(jax.device_put(gains), draw.loop, draw.state, self._weights, steps)
        return jax.tree.map(np.asarray, found)

    def hold_out(self, stop: Callable[[], bool]) -> None:
        """Find what the gains before and after cost in draws that were not tuned for."""
        draws = self.draws
        if self.random:
            first = self.seeds[-1] + 1
            draws = [self._draw(first + number) for number in range(len(draws))]
        found = []
        for gains in (self.given, self.best):
            for draw in draws:
                if stop():
                    return
                found.append(self._cost(gains, draw))
        costs = np.array([float(each.total) for each in found]).reshape(2, -1)
        errors = np.sqrt([float(each.error) for each in found]).reshape(2, -1)
        self.held_out = {
            "before": costs[0],
            "after": costs[1],
            "before_error": errors[0],
            "after_error": errors[1],
        }

    def tuned(self) -> Scenario:
        """Return the scenario with the best gains."""
        values = {
            f"control.pid.{name}.{gain}": float(f"{self.best[at]:.6g}")
            for (name, gain), at in zip(self.keys, self._at, strict=True)
        }
        return self.scenario.with_values(values)

    def dataset(self) -> xr.Dataset:
        """Return how the search went."""
        names = [f"{name}.{gain}" for name, gain in self.keys]
        given, best = ([float(values[at]) for at in self._at] for values in (self.given, self.best))
        variables: dict[str, Any] = {
            "cost": (("start", "iteration"), self.cost[:, : self.done], {"units": "m2"}),
            "gains": (("start", "iteration", "gain"), self.gains[:, : self.done]),
            "given": (("gain",), given),
            "tuned": (("gain",), best),
        }
        units = {"before": "m2", "after": "m2", "before_error": "m", "after_error": "m"}
        for name, unit in units.items():
            row = self.held_out.get(name, np.full(len(self.draws), np.nan))
            variables[name] = (("held_out",), row, {"units": unit})
        status = self.failure if not np.isfinite(self.least) else Status.OK.value
        return xr.Dataset(
            variables,
            {"gain": names, "iteration": np.arange(1, self.done + 1)},
            {
                "title": self.scenario.title,
                "scenario": self.scenario.to_toml(),
                "status": status,
            },
        )

    def _explain(self, runs: Sequence[Cost]) -> None:
        step = self.scenario.simulation.time_step
        for each in runs:
            if not each.converged and not self.failure:
                reason = Reason(int(each.reason)).words
                self.failure = f"failed at t = {int(each.steps) * step:.6g} s: {reason}"


class _StoppedError(Exception):
    """The search was asked to stop."""


def _keys(scenario: Scenario) -> list[tuple[str, str]]:
    """Return input and name of each gain that is not 0."""
    present = scenario.control.pid.present
    return [
        (name, gain)
        for name in scenario.driven
        for gain in GAINS
        if getattr(present[name], gain) != 0
    ]


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
