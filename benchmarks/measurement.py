"""Measured values of a benchmark, and repeats of several runs in turn."""

import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Float

from benchmarks.engines import Engine
from crinoid.results.result import Result
from crinoid.scenario import Scenario
from crinoid.simulation.batch import run_batch


class Scope(NamedTuple):
    """How much a benchmark does, and next to which peers."""

    peers: tuple[Engine, ...] = ()
    repeats: int = 5
    """Repeats of a time."""
    nodes: tuple[int, ...] = (21, 101)
    """Nodes of the arms whose steps are measured."""
    duration: float | None = None
    """Simulated time (s); None: that of the scenario or the release."""
    arms: int = 64
    """Arms of a batch."""
    seeds: int = 10
    """Draws of the water."""
    most: int | None = None
    """Most cases and meshes of each kind; None: all."""

    def shortened(self, scenario: Scenario, values: Mapping[str, Any] | None = None) -> Scenario:
        """Return a scenario with other values, of the wanted duration, without comparison."""
        own = {"control.compare": False, **(values or {})}
        if self.duration is not None:
            own["simulation.duration"] = self.duration
        return scenario.with_values(own)


class Row(NamedTuple):
    """One quantity of one engine: median and range over repeats or over seeds."""

    name: str
    quantity: str
    unit: str
    median: float
    least: float
    most: float
    engine: str = "crinoid"
    at: dict[str, float] = {}  # noqa: RUF012  # never changed
    """Where it was measured: number of nodes, time step (s), number of arms."""


Rows = Iterator[Row | str]
"""Measured values in the order of their measurement, and remarks on them."""


def row(
    name: str, quantity: str, unit: str, values: Iterable[float], engine: str = "crinoid", **at: Any
) -> Row:
    """Return the median and the range of some values."""
    found = np.array(list(values), dtype=float)
    middle, least, most = float(np.median(found)), float(found.min()), float(found.max())
    return Row(name, quantity, unit, middle, least, most, engine, at)


def seconds_of(run: Callable[[], Any]) -> float:
    """Return how long a call lasts (s)."""
    start = time.perf_counter()
    jax.block_until_ready(run())
    return time.perf_counter() - start


def in_turn(runs: Sequence[Callable[[], Any]], repeats: int) -> Float[np.ndarray, "run repeat"]:
    """Return the times of all runs (s), in turn: a busy machine slows all of them alike.

    A first call of each, which may compile, does not count.
    """
    for run in runs:
        run()
    return np.array([[seconds_of(run) for run in runs] for _ in range(repeats)]).T


def over_seeds(scenario: Scenario, seeds: int, take: Callable[[Result], Any]) -> list[Any]:
    """Return a measure of the run with each seed; raise `RuntimeError` if one fails."""
    arms = run_batch([scenario.with_values({"seed": seed}) for seed in range(seeds)], take)
    found = [arm.taken for arm in arms if arm.taken is not None]
    if len(found) < seeds:
        status = next(arm.status for arm in arms if arm.taken is None)
        raise RuntimeError(f"{scenario.title}: {status}")
    return found
