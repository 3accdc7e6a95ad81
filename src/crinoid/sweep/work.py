"""Work of a sweep: the runs of one batch, and what is kept of each."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from crinoid.batch.measures import measured
from crinoid.programs import keep_programs, make_room
from crinoid.result import Result
from crinoid.scenario import Scenario, ScenarioError
from crinoid.simulation.batch import run_batch
from crinoid.version import __version__

__all__ = ["OtherVersionError", "Row", "Work", "perform"]


class OtherVersionError(RuntimeError):
    """A worker has another version of crinoid than the sweep."""


@dataclass(frozen=True)
class Row:
    """Outcome of one run."""

    status: str
    """``ok``, or what went wrong and when."""
    measures: dict[str, float]
    """By name; empty where the run did not reach its end, NaN where it does not tell."""
    effort: dict[str, float]
    """RMS speed of each input that can move."""
    unit: dict[str, str]
    """Units of the speeds."""

    @staticmethod
    def without(status: str) -> Row:
        """Return the row of a run of which there is nothing but a status."""
        return Row(status, {}, {}, {})


@dataclass(frozen=True)
class Work:
    """One batch, as it is sent to a worker."""

    scenario: str
    """TOML."""
    values: Sequence[dict[str, Any]]
    """Values that each run has in place of the scenario's values."""
    threads: int = 1
    version: str = __version__


def perform(work: Work) -> list[Row]:
    """Run a batch, and return a row for each of its runs, in order."""
    if work.version != __version__:
        raise OtherVersionError(f"a worker has crinoid {__version__}, the sweep is {work.version}")
    keep_programs()
    scenario = _read(work.scenario)
    rows: list[Row | None] = [None] * len(work.values)
    cases = {}
    for index, values in enumerate(work.values):
        try:
            cases[index] = scenario.with_values(values)
        except ScenarioError as error:
            rows[index] = Row.without(f"refused: {'; '.join(error.lines)}")
    arms = run_batch(list(cases.values()), _row, threads=work.threads)
    for index, arm in zip(cases, arms, strict=True):
        rows[index] = arm.taken or Row.without(arm.status)
    make_room()
    return [row for row in rows if row is not None]


def _row(result: Result) -> Row:
    found = measured(result)
    return Row(result.status, found.numbers, found.speed, found.unit)


@lru_cache(maxsize=2)
def _read(text: str) -> Scenario:
    return Scenario.from_dict(tomllib.loads(text))
