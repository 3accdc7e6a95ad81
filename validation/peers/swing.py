"""A run of an arm in another program, and the arm in the words of such programs."""

import time
from collections.abc import Callable

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from crinoid.scenario import Scenario
from crinoid.scenario.flow import UniformFlow

Tips = Float[np.ndarray, "sample axis"]
"""Tip at each sample from the clamp, x, z or x, y, z (m); NaN from where a program fails."""
Swing = Callable[[], tuple[Tips, float]]
"""A run from the start, without building and compiling; it returns tips and its time (s)."""


def clocked(swing: Callable[[], Tips]) -> Swing:
    """Return a run that measures its time."""

    def run() -> tuple[Tips, float]:
        start = time.perf_counter()
        tips = swing()
        return tips, time.perf_counter() - start

    return run


def radius_of(scenario: Scenario) -> float:
    """Return the radius (m) of an arm that has a single one."""
    assert isinstance(scenario.arm.radius, float)
    return scenario.arm.radius


def line_numbers(scenario: Scenario, time_step: float) -> dict[str, float]:
    """Return an arm in a uniform current by the words of the input file of a mooring line.

    Its root is 10 m deep. ``along_x`` and ``along_z`` are the direction of the clamp.
    """
    arm, water, flow = scenario.arm, scenario.water, scenario.flow[0]
    assert isinstance(flow, UniformFlow)
    radius, tilt = radius_of(scenario), np.deg2rad(scenario.base.tilt_deg)
    area = np.pi * radius**2
    vortices, tool = water.vortices, scenario.tool
    return {
        "length": arm.length,
        "edges": arm.nodes - 1,
        "diameter": 2 * radius,
        "mass": arm.density * area,
        "EA": arm.youngs_modulus * area,
        "EI": arm.youngs_modulus * area * radius**2 / 4,
        "drag": water.drag_normal,
        "added": water.added_mass_normal,
        "lift": (vortices and vortices.lift) or 0.0,
        "centre": (vortices and vortices.centre) or 0.18,
        "range": (vortices and vortices.range) or 0.08,
        "load": tool.mass if tool else 0.0,
        "volume": tool.volume if tool else 0.0,
        "z": -10.0,
        "along_x": float(np.round(np.cos(tilt), 12)),
        "along_z": float(np.round(np.sin(tilt), 12)),
        "gravity": water.gravity,
        "density": water.density,
        "current": flow.velocity[0],
        "time_step": time_step,
    }


def rod_at_rest(
    scenario: Scenario,
) -> tuple[float, Float[np.ndarray, "node axis=3"], Float[np.ndarray, "edge direction=3 axis=3"]]:
    """Return edge (m), vertices (m) and frames of an arm whose first edge has its middle at x = 0.

    Of a frame the rows are the tangent, m_1 and m_2. The programs hold the first edge, so that it
    begins half an edge behind the clamp.
    """
    arm = scenario.arm
    edge = arm.length / (arm.nodes - 1.5)
    strains = arm.rest_curvature
    one, two, twist = strains if isinstance(strains, tuple) else (0.0, strains, 0.0)
    # bending toward m_1 turns about m_2, bending toward m_2 about -m_1
    turns = np.outer(edge * np.arange(arm.nodes - 1), [twist, -two, one])
    frames = Rotation.from_rotvec(turns).as_matrix().transpose(0, 2, 1)
    places = np.concatenate([np.zeros((1, 3)), np.cumsum(edge * frames[:, 0], axis=0)])
    return edge, places - [edge / 2, 0.0, 0.0], frames
