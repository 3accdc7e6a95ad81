"""One instant, as it is shown."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from crinoid.record import Record
from crinoid.space import AXES

__all__ = ["Frame", "in_three"]

Point = Float[np.ndarray, "axis=3"]
Points = Float[np.ndarray, "point axis=3"]


class Frame(NamedTuple):
    """One instant: SI units, three axes, positions relative to where the base is set."""

    time: float
    nodes: Points
    """Positions of the nodes, the root first."""
    flow: Points
    """Velocity of the water at them."""
    target: Point
    error: float
    """Distance of the tip from the target."""
    obstacles: Points
    """Positions of the obstacles, the debris last."""
    touching: bool
    """Whether one of them touches the arm."""
    touched: float
    """How long they have, all together, since the start (s)."""
    holding: bool
    """Whether the tip has its tool."""
    pull: Point
    """Force that pulls at the tip."""
    servo: Float[np.ndarray, " channel"]
    """Positions of the base's servos (m, rad)."""

    @staticmethod
    def of(now: Record, origin: Float[np.ndarray, " d"], pull: Any) -> Frame:
        """Take what is shown from a record, of an arm whose base is set at ``origin`` (m)."""
        axes = len(origin)
        apart = np.asarray(now.tip)[:axes] - np.asarray(now.wanted)[:axes]
        places, touch = now.obstacle_position, now.touch
        return Frame(
            time=float(now.time),
            nodes=in_three(now.position),
            flow=in_three(now.flow_velocity),
            target=in_three(np.asarray(now.wanted)[:axes] - origin),
            error=float(np.linalg.norm(apart)),
            obstacles=np.zeros((0, 3)) if places is None else in_three(places),
            touching=touch is not None and bool(np.any(np.asarray(touch.in_contact))),
            touched=0.0 if touch is None else float(np.sum(np.asarray(touch.duration))),
            holding=now.held is not None and bool(now.held),
            pull=in_three(pull) if len(pull) else np.zeros(3),
            servo=np.asarray(now.servo),
        )


def in_three(vectors: Any) -> Any:
    """Return vectors along all three axes; those of a planar arm have none along y."""
    given = np.asarray(vectors, float)
    whole = np.zeros((*given.shape[:-1], 3))
    whole[..., [AXES[3].index(axis) for axis in AXES[given.shape[-1]]]] = given
    return whole
