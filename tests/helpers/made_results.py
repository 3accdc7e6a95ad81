"""Results without a simulation: what the command line does with them needs no physics."""

from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path

import numpy as np
import xarray as xr

from crinoid.assembly.prepared import Prepared
from crinoid.elements import WORKS
from crinoid.foundation.axes import CHANNELS
from crinoid.foundation.result_variables import quantity
from crinoid.results.dataset import coordinates, describe
from crinoid.results.result import Result
from crinoid.scenario import Scenario
from crinoid.simulation import Progress

LIMITS = {"lower": -1.0, "upper": 1.0, "max_speed": 9.0, "max_acceleration": 99.0}
"""Ends of the travel of each channel, its greatest speed and acceleration."""


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


def moving_run(
    time: np.ndarray,
    arc_length: np.ndarray,
    position: np.ndarray,
    works: dict[int, np.ndarray],
    *,
    tip_target: np.ndarray,
    attrs: dict[str, object],
    **values: np.ndarray,
) -> xr.Dataset:
    """Return a run of an arm that moves so, with what follows from where its nodes are."""
    records, nodes, dimension = position.shape

    def rate(values: np.ndarray) -> np.ndarray:
        return np.gradient(values, time, axis=0) if records > 1 else np.zeros_like(values)

    velocity, tip, edge = rate(position), position[:, -1], arc_length[1]
    count = len(CHANNELS[dimension])
    values |= {f"channel_{key}": np.full(count, each) for key, each in LIMITS.items()}
    values.setdefault("base_servo", values.get("base_pose", values["base_command"]).copy())
    bent = sum((values[name] ** 2).reshape(records, -1).sum(1) for name in BENT & set(values))
    parts = [
        0.5 * 1.3 * edge * (velocity**2).sum(axis=(1, 2)),
        0.5 * 0.0126 * edge * bent,
        0.6 * edge * (position[..., -1] + 10.0).sum(axis=1),
    ]
    total, work = sum(parts), np.zeros((records, len(WORKS)))
    for place, done in works.items():
        work[:, place] = done
    work[:, 0] = total - total[0] - work.sum(axis=1) - 1e-6 * time
    return of_values(
        dimension,
        time,
        arc_length,
        np.linspace(0.04, 0.03, nodes),
        position=position,
        velocity=velocity,
        acceleration=rate(velocity),
        tension=np.zeros((records, nodes - 1)),
        tip_position=tip,
        tip_target=tip_target,
        tip_error=np.linalg.norm(tip - tip_target, axis=-1),
        energy=np.column_stack([*parts, work]),
        newton_iterations=np.full(records, 2),
        steps=np.arange(records),
        residual=np.full(records, 1e-10),
        **values,
    ).assign_attrs({"crinoid_version": "0.1.0", "wall_time": 1.0} | attrs)


BENT = {"curvature", "twist"}


def with_obstacles(
    run: xr.Dataset, start: np.ndarray, velocity: np.ndarray, force: np.ndarray
) -> xr.Dataset:
    """Add obstacles that move steadily from their start, and what they feel of the arm."""
    time, dimension = run["time"].values, force.shape[2]
    touching = np.any(force != 0, axis=2)
    step = time[1] - time[0] if time.size > 1 else 0.0
    gap = np.where(touching, 5e-4, 0.1)
    found = {
        "obstacle_position": start + velocity * time[:, None, None],
        "obstacle_velocity": np.broadcast_to(velocity, force.shape),
        "contact_force": force,
        "contact_impulse": step * np.cumsum(force, axis=0),
        "contact_time": step * np.cumsum(touching, axis=0),
        "contact_gap": gap,
        "contact_closest": np.minimum.accumulate(gap, axis=0),
    }
    return run.assign({name: quantity(name, value, dimension) for name, value in found.items()})


PID = """[base.channels.slide]
[control]
kind = "pid"
[control.pid.slide]
kp = 1.0
"""
"""Tables of a controller, which a log of ROS needs for commands."""


def of_runs(data: xr.Dataset, other: xr.Dataset | None = None) -> Result:
    """Return the result of a run, and of one without control."""
    return Result(data, uncontrolled=None if other is None else Result(other))


def made_result(scenario: Scenario, end: float | None = None, status: str = "ok") -> Result:
    """Return a result of a planar scenario up to a time, of an arm that hardly moves."""
    duration = scenario.simulation.duration if end is None else end
    time, nodes = np.linspace(0.0, duration, 5), scenario.arm.nodes
    arc_length = np.linspace(0.0, scenario.arm.length, nodes)
    moved = 1e-3 * np.outer(time, arc_length)
    still = np.zeros((5, nodes))
    dataset = moving_run(
        time,
        arc_length,
        np.stack([arc_length + moved, still], axis=-1),
        {},
        tip_target=np.tile([arc_length[-1], 0.0], (5, 1)),
        tip_angle=0 * time,
        curvature=still,
        base_command=np.zeros((5, 3)),
        base_servo=np.zeros((5, 3)),
        base_force=np.zeros((5, 2)),
        base_moment=0 * time,
        attrs=describe(scenario) | {"status": status, "notes": ""},
    )
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
