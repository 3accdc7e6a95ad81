"""Results without a simulation: what the command line does with them needs no physics."""

from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path

import numpy as np
import xarray as xr

from crinoid.assembly.prepared import Prepared
from crinoid.dataset import coordinates, describe
from crinoid.elements import ENERGIES, WORKS
from crinoid.result import Result
from crinoid.scenario import Scenario
from crinoid.simulation import Progress
from crinoid.variables import quantity


def case_rows(folder: Path) -> list[dict[str, str]]:
    """Return the rows of the table of cases in a folder."""
    with (folder / "cases.csv").open() as file:
        return list(csv.DictReader(file))


def of_values(
    dimension: int,
    time: np.ndarray,
    arc_length: np.ndarray,
    diameter: np.ndarray,
    **values: np.ndarray,
) -> xr.Dataset:
    """Return the values of variables with the dimensions and units that they have in results."""
    return xr.Dataset(
        {name: quantity(name, value, dimension) for name, value in values.items()},
        coordinates(dimension, time, arc_length, diameter),
    )


def made_result(scenario: Scenario, end: float | None = None, status: str = "ok") -> Result:
    """Return a result of a planar scenario up to a time, of an arm that hardly moves."""
    duration = scenario.simulation.duration if end is None else end
    time = np.linspace(0.0, duration, 5)
    nodes, edges = scenario.arm.nodes, scenario.arm.nodes - 1
    arc_length = np.linspace(0.0, scenario.arm.length, nodes)
    position = np.zeros((5, nodes, 2))
    position[..., 0] = arc_length
    tip = position[:, -1] + 1e-3 * time[:, None]
    dataset = of_values(
        2,
        time,
        arc_length,
        np.full(nodes, 0.04),
        position=position,
        velocity=0 * position,
        acceleration=0 * position,
        tip_position=tip,
        tip_target=position[:, -1],
        tip_error=np.linalg.norm(tip - position[:, -1], axis=1),
        tip_angle=0 * time,
        tension=np.zeros((5, edges)),
        curvature=np.zeros((5, nodes)),
        base_command=np.zeros((5, 3)),
        base_servo=np.zeros((5, 3)),
        base_force=np.zeros((5, 2)),
        base_moment=0 * time,
        energy=np.ones((5, len(ENERGIES) + len(WORKS))),
        steps=np.full(5, 10),
        newton_iterations=np.full(5, 20),
        residual=0 * time,
    )
    dataset.attrs = describe(scenario) | {"status": status, "wall_time": 1.0, "notes": ""}
    return Result(dataset, {"state": np.ones(3)})


class Player:
    """Stands for `crinoid.simulation.play`: counts, and does what a test asks in between."""

    def __init__(self, between: Callable[[int], None] = lambda case: None) -> None:
        self.played: list[Scenario] = []
        self.into: list[Path | None] = []
        """The folder in which each run was to be written while it lasted."""
        self.between = between
        """Called where a chunk of a run would be computed, with the number of the run."""

    def __call__(
        self,
        prepared: Prepared,
        *,
        report: Callable[[Progress], None],
        resume: Result | None,
        stop: Callable[[], bool],
        tell: Callable[[list[str]], None] | None = None,
        into: Path | None = None,
    ) -> Result:
        scenario = prepared.scenario
        self.played.append(scenario)
        self.into.append(into)
        duration = scenario.simulation.duration
        stop()
        self.between(len(self.played))
        report(Progress("simulated", duration / 2, duration, 0.1))
        if stop():
            end = duration / 2
            return made_result(scenario, end, f"interrupted at t = {end:.6g} s")
        return made_result(scenario)
