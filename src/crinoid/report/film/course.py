"""A run at any time: between saved instants it glides, as on the page."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from crinoid.report.charts.space import Moving

Point = Float[np.ndarray, "axis=3"]


@dataclass(frozen=True)
class Now:
    """One run at one time."""

    at: int
    """The saved instant before."""
    share: float
    """How far it is to the next one."""
    position: Float[np.ndarray, "node axis=3"]
    target: Point
    anchor: Point
    ahead: Point
    frame: Float[np.ndarray, "axis=3 axis=3"]
    bodies: tuple[Point, ...]
    held: bool


class Course:
    """One run as it goes on."""

    def __init__(self, moving: Moving) -> None:
        self.moving = moving

    def at(self, time: float) -> Now:
        """Return the run at a time (s); before its begin and after its end it stands."""
        moving, (i, share) = self.moving, self.locate(time)
        mount = moving.mount
        ahead = between(mount.ahead, i, share)
        return Now(
            i,
            share,
            between(moving.position, i, share),
            between(moving.target, i, share),
            between(mount.anchor, i, share),
            ahead / (np.linalg.norm(ahead) or 1.0),
            between(mount.frame, i, share),
            tuple(between(body.path, i, share) for body in moving.bodies),
            bool(moving.held[i]),
        )

    def locate(self, time: float) -> tuple[int, float]:
        """Return the instant before a time, and how far it is to the next one."""
        times = self.moving.time
        i = int(np.clip(np.searchsorted(times, time, "right") - 1, 0, max(0, times.size - 2)))
        if times.size < 2:
            return 0, 0.0
        return i, float(np.clip((time - times[i]) / (times[i + 1] - times[i]), 0.0, 1.0))


def between(
    values: Float[np.ndarray, " time *shape"], i: int, share: float
) -> Float[np.ndarray, "*shape"]:
    """Values between an instant and the next."""
    if share == 0.0:
        return np.asarray(values[i])
    return np.asarray((1.0 - share) * values[i] + share * values[i + 1])
