"""The design of many runs: every combination of what varies, and their names and coordinates."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from math import prod
from typing import Any

import numpy as np

from crinoid.scenario import Scenario
from crinoid.scenario.kinds import unit_at
from crinoid.scenario.scenario import scenario_schema
from crinoid.scenario.variation import Levels, combination

SEED = "seed"  # key of everything random


@dataclass(frozen=True)
class Design:
    """Runs of a scenario: every combination of the levels of its axes.

    Runs are numbered from 1; the last axis changes fastest. A case is built when it is asked for.
    """

    scenario: Scenario  # one case
    axes: Mapping[str, Levels]  # by name, the values at each level of one key or of several

    @staticmethod
    def of_vary(scenario: Scenario) -> Design:
        """Return the cases of a scenario with ``vary``."""
        axes = {key: Levels.of(key, values) for key, values in scenario.vary.items()}
        return Design(scenario.with_values({}), axes)

    @cached_property
    def runs(self) -> int:
        """Number of runs."""
        return prod(levels.count for levels in self.axes.values())

    @property
    def keys(self) -> list[str]:
        """Keys that differ between runs."""
        return [key for levels in self.axes.values() for key in levels.at(0)]

    def values(self, run: int) -> dict[str, Any]:
        """Return the values of a run by key."""
        return combination(list(self.axes.values()), run - 1)

    def case(self, run: int) -> Scenario:
        """Return the scenario of a run; a `ScenarioError` if its values exclude each other."""
        return self.scenario.with_values(self.values(run))

    def name(self, run: int) -> str:
        """Return the name of a run, which is that of its folder."""
        return f"case-{run:0{max(2, len(str(self.runs)))}d}"

    def row(
        self, run: int, measures: Mapping[str, float | None], status: str, directory: str
    ) -> dict[str, Any]:
        """Return the row of a run in ``cases.csv``; a measure that is not known is empty."""
        numbers = {name: "" if value is None else value for name, value in measures.items()}
        ends = {"status": status, "directory": directory}
        return {"case": self.name(run), **self.values(run), **numbers, **ends}

    def coordinates(self) -> dict[str, tuple[Any, ...]]:
        """Return the keys that vary and the seed of all runs, along ``run``, for xarray."""
        varied = [self.values(run) for run in range(1, self.runs + 1)]
        seeds = [values.get(SEED, self.scenario.seed) for values in varied]
        columns = {key: [values[key] for values in varied] for key in self.keys} | {SEED: seeds}
        return {key: _coordinate(key, values) for key, values in columns.items()}


def _coordinate(key: str, values: list[Any]) -> tuple[Any, ...]:
    """Return a key's values along ``run``; tables and lists of other lengths as JSON."""
    unit = unit_at(scenario_schema(), key)
    about = {"long_name": "seed of everything random" if key == SEED else key}
    about |= {"units": unit} if unit else {}
    try:
        found = np.array(values)
    except ValueError:  # lists of several lengths
        found = np.array(None)
    if found.dtype.kind not in "biufU":
        found = np.array([json.dumps(value) for value in values])
    if found.dtype.kind == "U":
        found = found.astype(object)
    return ("run", *(f"{key}.{axis}" for axis in range(found.ndim - 1))), found, about
