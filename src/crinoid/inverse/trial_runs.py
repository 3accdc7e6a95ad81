"""Runs of the trials of a search, or their equilibria, and the measures of each."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from crinoid.assembly.prepared import Prepared, at_rest
from crinoid.inverse import StoppedError
from crinoid.inverse.goal import Goal
from crinoid.inverse.stability import StabilityMargin
from crinoid.results.result import Result
from crinoid.scenario import Scenario, ScenarioError
from crinoid.simulation.batch import run_batch
from crinoid.simulation.equilibrium import settle
from crinoid.simulation.run import SimulationError


class TrialRuns:
    """Measures of runs with each of several seeds, or of equilibria where they are at ``rest``.

    Between them ``stop`` is asked whether to end, with a `StoppedError`. The last measure is the
    ``margin`` of the loop, if there is one.
    """

    def __init__(
        self,
        goal: Goal,
        seeds: Sequence[int],
        stop: Callable[[], bool],
        *,
        rest: bool,
        margin: StabilityMargin | None = None,
    ) -> None:
        self._goal, self._seeds, self._stop, self._rest = goal, seeds, stop, rest
        self._margin = margin
        self.settings: dict[str, Any] = {"output.variables": None}  # a measure may need any
        """Values of keys that all runs have."""
        self.failure = ""  # why the first run that failed did so

    def __call__(
        self, scenarios: Sequence[Scenario | None], seeds: Sequence[int] | None = None
    ) -> Float[np.ndarray, "point measure draw"]:
        """Return the measures; NaN of a run that failed, and without a scenario."""
        seeds = self._seeds if seeds is None else seeds
        found = np.full((len(scenarios), len(seeds), len(self._goal.names)), np.nan)
        runs = {
            (point, draw): scenario.with_values(self.settings | {"seed": seed})
            for point, scenario in enumerate(scenarios)
            for draw, seed in enumerate(seeds)
            if scenario is not None
        }
        if self._rest:
            for place, scenario in runs.items():
                try:
                    found[place] = self._measure(settle(Prepared(at_rest(scenario)), notes=False))
                except (SimulationError, ScenarioError) as error:
                    self.failure = self.failure or " ".join(str(error).split())
                if self._stop():
                    raise StoppedError
            return found.swapaxes(1, 2)
        stopped = False

        def stop() -> bool:
            nonlocal stopped
            stopped = stopped or self._stop()
            return stopped

        arms = run_batch([*runs.values()], self._measure, stop=stop, notes=False)
        if stopped:
            raise StoppedError
        for place, arm in zip(runs, arms, strict=True):
            if arm.taken is not None:
                found[place] = arm.taken
            else:
                self.failure = self.failure or arm.status
        if self._margin is not None:
            for point, each in enumerate(scenarios):
                if each is not None and np.isfinite(found[point, :, 0]).any():
                    found[point, :, -1] = self._margin.kept(self._margin.closed(each))
        return found.swapaxes(1, 2)

    def _measure(self, result: Result) -> list[float]:
        values = [measure.of(result) for measure in self._goal.measures]
        return [np.nan if value is None else value for value in values]
