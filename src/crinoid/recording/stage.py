"""The run that a record is played in: its duration, and the space that the arm takes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from crinoid.recording.series import Series
from crinoid.scenario import FileMotion, Scenario
from crinoid.space import ANGLES, CHANNELS

_STRETCH = 1.1
"""Factor on the length of an arm; none gets as long as that in a current."""


@dataclass(frozen=True)
class Stage:
    """A run, as far as a record is concerned."""

    duration: float
    """How long the run lasts (s)."""
    dimension: int
    """Number of axes in which the arm moves, 2 or 3."""
    reach: float
    """How far the arm gets from where its root is set (m)."""
    heights: tuple[float, float]
    """Lowest and highest position of the straight arm, at rest (m)."""
    bed: float | None
    """Height z of the bed (m), if it is known."""

    @staticmethod
    def of(scenario: Scenario, series: Mapping[str, Series]) -> Stage:
        """Return the stage that a scenario sets with the series from its files, by table."""
        base, depth = scenario.base, scenario.water.depth
        dimension = scenario.arm.dimension
        travel = dict.fromkeys(CHANNELS[dimension], 0.0)
        for name, channel in base.channels.present.items():
            travel[name] += max(-channel.limits.low, channel.limits.high)
        for index, motion in enumerate(base.motion):
            if isinstance(motion, FileMotion):
                values = series[f"base.motion.{index}"].values
                travel[motion.channel] += float(np.abs(values).max())
            else:
                travel[motion.channel] += motion.farthest(scenario.simulation.duration)
        root = base.position[-1]
        tip = root + scenario.arm.length * float(np.sin(np.deg2rad(base.tilt_deg)))
        return Stage(
            duration=scenario.simulation.duration,
            dimension=dimension,
            reach=_STRETCH * scenario.arm.length
            + float(np.hypot.reduce([way for name, way in travel.items() if name not in ANGLES])),
            heights=(min(root, tip), max(root, tip)),
            bed=None if depth is None else -depth,
        )
