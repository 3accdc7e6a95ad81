"""What a record is to be laid over: the time of a run, and the room that an arm takes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from crinoid.scenario.motion import FileMotion
from crinoid.space import ANGLES, CHANNELS

if TYPE_CHECKING:
    from crinoid.scenario.scenario import Scenario

_STRETCH = 1.1
"""More than an arm gets longer in a current."""


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
    """Lowest and highest place of the straight arm, at rest (m)."""
    bed: float | None
    """Height z of the bed (m), if it is known."""

    @staticmethod
    def of(scenario: Scenario) -> Stage:
        """Return the stage that a scenario sets."""
        base, depth = scenario.base, scenario.water.depth
        dimension = scenario.arm.dimension
        travel = dict.fromkeys(CHANNELS[dimension], 0.0)
        for name, channel in base.channels.present.items():
            travel[name] += max(-channel.limits.low, channel.limits.high)
        for index, motion in enumerate(base.motion):
            if isinstance(motion, FileMotion):
                series = scenario.series[f"base.motion.{index}"]
                travel[motion.channel] += float(np.abs(series.values).max())
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
