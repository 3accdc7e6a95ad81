"""Chambers and tendons as lines along the arm."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Int

from crinoid.results.drives import actuator_drives, drive_unit
from crinoid.results.scene.data import arc_length
from crinoid.scenario import Chamber

if TYPE_CHECKING:
    from crinoid.results.result import Result

_BENDS = 0.5  # distance from the axis of a chamber that only bends, of the arm's radius


@dataclass(frozen=True)
class ThreadLine:
    """A chamber or a tendon: a line at an offset from the nodes along the directors."""

    kind: str  # `"chamber"` or `"tendon"`
    first: int  # first of the drawn nodes along it
    offset: Float[np.ndarray, "node 2"]
    """Offset along the directors m_1 and m_2, in the plane along its normal (m)."""
    pair: bool  # whether it has a partner on the other side, which shares below 0 drive
    share: Float[np.ndarray, " time"]
    largest: str  # drive at a share of 1, with its unit


def find_threads(result: "Result", nodes: Int[np.ndarray, " node"]) -> Iterator[ThreadLine]:
    """Yield the chambers and tendons of a result whose scenario is known, at some of its nodes."""
    data = result.dataset
    place = arc_length(data)[nodes]
    place = place / (place[-1] or 1.0)
    radius = data["diameter"].values[nodes] / 2 if "diameter" in data else np.zeros(len(nodes))
    for drive in actuator_drives(result):
        thread = drive.thread
        if thread is None:
            continue
        begin, end = thread.span
        first = max(0, int(np.searchsorted(place, begin + 1e-9)) - 1)
        last = min(len(nodes) - 1, int(np.searchsorted(place, end - 1e-9)))
        along = np.clip((place[first : last + 1] - begin) / (end - begin), 0.0, 1.0)
        if thread.offset is None:
            away = _BENDS * radius[first : last + 1]
        else:
            away = np.interp(along, (0.0, 1.0), np.broadcast_to(thread.offset, 2))
        angle = np.deg2rad(thread.angle_deg + along * getattr(thread, "twist_deg", 0.0))
        offset = np.stack([away * np.cos(angle), away * np.sin(angle)], axis=1)
        kind = "chamber" if isinstance(thread, Chamber) else "tendon"
        largest = drive_unit(drive.unit, thread.largest).text(thread.largest)
        share = drive.state / thread.largest
        yield ThreadLine(kind, first, offset, thread.pair, share, largest)
