"""Loads: forces on the arm that are not the water's.

A new kind is one class here and one entry in `Load`; or a table of an installed package
(`crinoid.scenario.kinds`).
"""

from collections.abc import Callable, Iterator
from typing import Annotated, Any, Literal

from pydantic import Field

from crinoid.scenario.dimension import Count, InSpace
from crinoid.scenario.errors import Mistake
from crinoid.scenario.kinds import KindOf
from crinoid.scenario.model import Model
from crinoid.scenario.quantity import (
    PER_AXIS,
    Components,
    Force,
    Quantity,
    Seconds,
    Triple,
    direction_conflicts,
)

__all__ = ["DistributedLoad", "Load", "LoadTable", "TipLoad"]

Direction = Annotated[
    Literal["tangential", "normal"] | Components,
    Quantity(
        takes='"tangential", "normal" or [x, z]', in_space='"tangential", "normal" or [x, y, z]'
    ),
    PER_AXIS,
]
Moment = Annotated[
    float | Triple,
    Quantity("N m", "a number", "[x, y, z]"),
    Count(plane=(1,), space=(3,)),
    InSpace((0.0, 0.0, 0.0)),
]


class LoadTable(Model):
    """Keys that every load has: its kind, when and how it sets in, when it is taken off."""

    kind: str
    start: Seconds = Field(default=0.0, ge=0, description="When it sets in.")
    ramp_time: Seconds = Field(
        default=0.0, ge=0, description="How long it takes to reach full strength."
    )
    stop: Seconds | None = Field(
        default=None, gt=0, description="When it is taken off; never if left out."
    )

    def _conflicts(self) -> Iterator[Mistake]:
        if self.stop is not None and self.stop <= self.start:
            yield Mistake("stop", f"got {self.stop}, takes a time after start = {self.start} (s)")

    def build(self, scenario: Any) -> tuple[Callable[..., Any], dict[str, Any]]:
        """Return a function that builds the element, and what it takes beside the rod.

        For tables of installed packages; ``scenario`` is the `crinoid.Scenario` that holds it. The
        second are arrays by name, on which gradients act; `crinoid.load_onset` gives that of
        ``start``, ``ramp_time`` and ``stop``.
        """
        raise NotImplementedError


class DistributedLoad(LoadTable):
    """A force along the whole arm."""

    kind: Literal["distributed"] = Field(
        default="distributed", description="A force along the arm."
    )
    direction: Direction = Field(
        description="tangential and normal (in space along m_2) follow the arm; a vector is "
        "fixed, its length is ignored."
    )
    magnitude: Annotated[float, Quantity("N/m")] = Field(description="Force on a metre of arm.")

    def _conflicts(self) -> Iterator[Mistake]:
        yield from super()._conflicts()
        if isinstance(self.direction, tuple):
            yield from direction_conflicts("direction", self.direction)


class TipLoad(LoadTable):
    """A force and a moment at the tip."""

    kind: Literal["tip"] = Field(default="tip", description="A force and a moment at the tip.")
    force: Annotated[Force, InSpace((0.0, 0.0, 0.0))] = Field(
        default=(0.0, 0.0), description="Force; of a follower, as it is on a straight arm along x."
    )
    moment: Moment = Field(
        default=0.0,
        description="Moment, positive the way tilt is; in space right-handed about each axis, so "
        "that [0, -1, 0] is 1 of a planar arm.",
    )
    follower: bool = Field(
        default=False,
        description="Whether the force turns with the tip, in space the moment as well.",
    )

    def _conflicts(self) -> Iterator[Mistake]:
        yield from super()._conflicts()
        if not self.model_fields_set & {"force", "moment"}:
            yield Mistake("force", "missing, a tip load takes force, moment or both")


Load = Annotated[DistributedLoad | TipLoad, Field(discriminator="kind"), KindOf("loads", LoadTable)]
