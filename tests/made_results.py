"""Results without a simulation: what the command line does with them needs no physics."""

from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from crinoid.assembly.prepared import Prepared
from crinoid.dataset import describe
from crinoid.result import Result
from crinoid.scenario import Scenario
from crinoid.simulation import Progress


def case_rows(folder: Path) -> list[dict[str, str]]:
    """Return the rows of the table of cases in a folder."""
    with (folder / "cases.csv").open() as file:
        return list(csv.DictReader(file))


def made_result(scenario: Scenario, end: float | None = None, status: str = "ok") -> Result:
    """Return a result of a planar scenario up to a time, of an arm that hardly moves."""
    duration = scenario.simulation.duration if end is None else end
    time = np.linspace(0.0, duration, 5)
    nodes, edges = scenario.arm.nodes, scenario.arm.nodes - 1
    position = np.zeros((5, nodes, 2))
    position[..., 0] = np.linspace(0.0, scenario.arm.length, nodes)
    tip = position[:, -1] + 1e-3 * time[:, None]
    shapes: dict[str, tuple[tuple[str, ...], Any]] = {
        "position": (("time", "node", "axis"), position),
        "velocity": (("time", "node", "axis"), 0 * position),
        "acceleration": (("time", "node", "axis"), 0 * position),
        "tip_position": (("time", "axis"), tip),
        "tip_target": (("time", "axis"), position[:, -1]),
        "tip_error": (("time",), np.linalg.norm(tip - position[:, -1], axis=1)),
        "tip_angle": (("time",), 0 * time),
        "tension": (("time", "edge"), np.zeros((5, edges))),
        "curvature": (("time", "node"), np.zeros((5, nodes))),
        "base_command": (("time", "channel"), np.zeros((5, 3))),
        "base_servo": (("time", "channel"), np.zeros((5, 3))),
        "base_force": (("time", "axis"), np.zeros((5, 2))),
        "base_moment": (("time",), 0 * time),
        "energy": (("time", "kind"), np.ones((5, 9))),
        "steps": (("time",), np.full(5, 10)),
        "newton_iterations": (("time",), np.full(5, 20)),
        "residual": (("time",), 0 * time),
    }
    dataset = xr.Dataset(
        {name: (dims, values, {"units": "1"}) for name, (dims, values) in shapes.items()},
        coords={
            "time": time,
            "axis": ["x", "z"],
            "channel": ["slide", "heave", "tilt"],
            "kind": list("abcdefghi"),
        },
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
