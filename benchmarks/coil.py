"""The arm of `space.py`, curved at rest like a piece of a coil, and how each engine runs it."""

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

import accuracy
import crinoid
from accuracy import Case, crinoid_tips, distance
from rest_shape import rest_shape

Run = Callable[[], np.ndarray]  # as in a Case

MISSING = []
try:
    import mujoco

    import mujoco_rod
except ImportError as error:
    mujoco_rod = None
    MISSING.append(f"without MuJoCo ({error}): pip install '.[bench]'")
try:
    import elastica_rod
except ImportError as error:
    elastica_rod = None
    MISSING.append(f"without PyElastica ({error}): pip install '.[bench]'")

INTERVAL = 0.1
"""Between samples (s)."""
SAMPLES = round(accuracy.DURATION / INTERVAL)

COIL = (3.0, 1.0, 3.0)
"""Curvatures (1/m) and twist (rad/m) at rest; the planar arm has the second."""
GRAVITY, FAINT = 1.0, 0.005
"""In m/s2; the faint one bends a straight arm as little as the theory of beams asks for."""


def in_air(
    nodes: int, time_step: float, axes: int, rest_curvature: Any, gravity: float
) -> crinoid.Scenario:
    """Return the arm of `accuracy.py` in air and without damping."""
    settings = {
        "arm.dimension": axes,
        "arm.rest_curvature": rest_curvature,
        "arm.damping_time": 0.0,
        "base.position": [0.0] * axes,
        "water.density": 0.0,
        "water.gravity": gravity,
    }
    return accuracy.scenario(nodes, time_step).with_values(settings)


def coil(nodes: int, time_step: float, axes: int = 3) -> crinoid.Scenario:
    """Return the arm that bends both ways and twists, or in the plane its like."""
    return in_air(nodes, time_step, axes, list(COIL) if axes == 3 else COIL[1], GRAVITY)


def straight(nodes: int, time_step: float) -> crinoid.Scenario:
    """Return an arm that hardly bends."""
    return in_air(nodes, time_step, 3, [0.0, 0.0, 0.0], FAINT)


def crinoid_run(scenario: crinoid.Scenario) -> Run:
    """Return a run of crinoid, compiled."""
    return crinoid_tips(scenario, INTERVAL)


def mujoco_run(scenario: crinoid.Scenario) -> Run:
    """Return a run of MuJoCo's rod at its best: hard edges, clamp in its right place."""
    time_step = scenario.simulation.time_step
    model = mujoco_rod.rod(scenario, time_step, centred=True)
    data = mujoco.MjData(model)
    return lambda: mujoco_rod.tips(model, data, SAMPLES, round(INTERVAL / time_step))


def elastica_run(scenario: crinoid.Scenario) -> Run:
    """Return a run of PyElastica's rod, clamp in its right place."""
    time_step = scenario.simulation.time_step
    rod = elastica_rod.ElasticaRod(scenario)
    return lambda: rod.tips(time_step, SAMPLES, round(INTERVAL / time_step))


def runs() -> dict[str, Callable[[crinoid.Scenario], Run]]:
    """Return how each engine that is there runs the arm of a scenario."""
    every = {"crinoid": crinoid_run}
    if mujoco_rod is not None:
        every["MuJoCo"] = mujoco_run
    if elastica_rod is not None:
        every["PyElastica"] = elastica_run
    return every


def case(engine: str, scenario: crinoid.Scenario) -> Case:
    """Return a run of an engine, ready to be timed."""
    nodes, time_step = scenario.arm.nodes, scenario.simulation.time_step
    return Case(engine, nodes, time_step, runs()[engine](scenario))


@cache
def tip_at_rest() -> np.ndarray:
    """Return where the tip starts, `(3,)` in m."""
    arm = coil(1001, 0.01).arm
    edge = arm.length / (arm.nodes - 1.5)
    return rest_shape(arm, edge)[0][-1] - [edge / 2, 0.0, 0.0]


def off(tips: np.ndarray, truth: np.ndarray) -> float:
    """Return the largest distance over the samples, relative to the largest displacement."""
    return distance(tips, truth, tip_at_rest())
