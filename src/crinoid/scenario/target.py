"""The target: where the tip is wanted."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field

from crinoid.scenario.errors import Mistake
from crinoid.scenario.model import Model
from crinoid.scenario.quantity import (
    AsTuple,
    Pair,
    Quantity,
    Times,
    length_conflicts,
    time_conflicts,
)

__all__ = ["Target"]

TipTarget = Annotated[
    Literal["initial"] | Pair | Annotated[tuple[Pair, ...], AsTuple],
    Quantity("m", '"initial", [x, z] or, with time, a list of [x, z]'),
]
AngleTarget = Annotated[
    Literal["initial"] | float | Annotated[tuple[float, ...], AsTuple],
    Quantity("degrees", '"initial", a number or, with time, a list of numbers'),
]


class Target(Model):
    """Where the tip is wanted: a place, or a path through points in time."""

    tip: TipTarget = Field(
        default="initial", description="Place of the tip; initial: where it is at t = 0."
    )
    angle_deg: AngleTarget = Field(
        default="initial", description="Direction of the tip; initial: as it is at t = 0."
    )
    time: Times | None = Field(
        default=None, description="Times of a path, increasing; its ends are held before and after."
    )

    @property
    def tip_path(self) -> tuple[tuple[float, float], ...] | None:
        """The points of a path of the tip, in m; None if the tip is to stay in one place."""
        match self.tip:
            case (tuple(), *_):
                return self.tip
        return None

    @property
    def angle_path_deg(self) -> tuple[float, ...] | None:
        """The angles of a path, in degrees; None if there is one angle to keep."""
        return self.angle_deg if isinstance(self.angle_deg, tuple) else None

    def _conflicts(self) -> Iterator[Mistake]:
        paths = {"tip": self.tip_path, "angle_deg": self.angle_path_deg}
        given = {key: path for key, path in paths.items() if path is not None}
        if self.time is None:
            if given:
                yield Mistake("time", f"missing, a path ({' and '.join(given)}) takes it (s)")
            return
        if not given:
            yield Mistake("time", "goes with a path; takes tip or angle_deg as a list as long")
        for key, path in given.items():
            yield from length_conflicts(key, path, self.time)
        yield from time_conflicts(self.time)
        if self.time and self.time[0] < 0:
            yield Mistake("time.0", f"got {self.time[0]}, takes a number of 0 or more (s)")
