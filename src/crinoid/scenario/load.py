"""Loads: forces on the arm besides those of the water.

A new kind is one class here and one entry in `Load`; or a table of an installed package
(`crinoid.scenario.kinds`).
"""
# ruff: noqa: D102  # the base class documents its methods

from collections.abc import Callable, Iterator
from pkgutil import resolve_name
from typing import Annotated, Any, Literal

from pydantic import Field

from crinoid.scenario.errors import Mistake, missing
from crinoid.scenario.kinds import KindOf
from crinoid.scenario.model import Model, entry
from crinoid.scenario.quantity import (
    PER_AXIS,
    Components,
    Count,
    Force,
    InSpace,
    Quantity,
    Seconds,
    Triple,
    direction_conflicts,
    unit_vector,
)

Direction = Annotated[
    Literal["tangential", "normal"] | Components,
    Quantity(
        expects='"tangential", "normal" or [x, z]', in_space='"tangential", "normal" or [x, y, z]'
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
    """Keys of every load: its kind, start, ramp and stop."""

    kind: str
    start: Seconds = entry(0.0, "Start time.", ge=0)
    ramp_time: Seconds = entry(0.0, "Time to reach full strength.", ge=0)
    stop: Seconds | None = entry(None, "Time when it ends; never by default.", gt=0)

    def _conflicts(self) -> Iterator[Mistake]:
        if self.stop is not None and self.stop <= self.start:
            yield self.mistake("stop", f"be after start = {self.start} (s)")

    def build(self, scenario: Any) -> tuple[Callable[..., Any], dict[str, Any]]:
        """Return a function that builds the element from a rod, and its other arguments by name.

        Numbers and tuples of numbers become arrays, on which gradients act. ``scenario`` is the
        `crinoid.Scenario` with this table.
        """
        raise NotImplementedError

    @property
    def onset(self) -> Any:
        """When it sets in and is taken off, as a `crinoid.Onset`."""
        return resolve_name("crinoid.assembly.arrays:onset")(self)


class DistributedLoad(LoadTable):
    """A force along the whole arm."""

    kind: Literal["distributed"] = entry("distributed", "A force along the arm.")
    direction: Direction = Field(
        description="tangential and normal (in space along m_2) follow the arm; a vector is "
        "fixed, and its length is ignored."
    )
    magnitude: Annotated[float, Quantity("N/m")] = Field(description="Force on a metre of arm.")

    def _conflicts(self) -> Iterator[Mistake]:
        yield from super()._conflicts()
        if isinstance(self.direction, tuple):
            yield from direction_conflicts("direction", self.direction)

    def build(self, scenario: Any) -> tuple[Callable[..., Any], dict[str, Any]]:
        fixed, direction = (0.0,) * scenario.arm.dimension, self.direction
        if isinstance(direction, tuple):
            fixed = unit_vector(direction)
        return resolve_name("crinoid.elements:DistributedLoad.of"), {
            "onset": self.onset,
            "tangential": self.magnitude * (direction == "tangential"),
            "normal": self.magnitude * (direction == "normal"),
            "fixed": tuple(self.magnitude * each for each in fixed),
        }


class TipLoad(LoadTable):
    """A force and a moment at the tip."""

    kind: Literal["tip"] = entry("tip", "A force and a moment at the tip.")
    force: Annotated[Force, InSpace((0.0, 0.0, 0.0))] = entry(
        (0.0, 0.0), "Force; of a follower, as on a straight arm along x."
    )
    moment: Moment = entry(
        0.0,
        "Moment, positive like tilt; in space right-handed about each axis, so that [0, -1, 0] "
        "is 1 of a planar arm.",
    )
    follower: bool = entry(False, "Whether the force turns with the tip, in space also the moment.")

    def _conflicts(self) -> Iterator[Mistake]:
        yield from super()._conflicts()
        if not self.model_fields_set & {"force", "moment"}:
            yield Mistake("force", missing("be given without moment"))

    def build(self, scenario: Any) -> tuple[Callable[..., Any], dict[str, Any]]:
        names = ("follower_force", "follower_moment") if self.follower else ("dead_force", "moment")
        numbers = dict(zip(names, (self.force, self.moment), strict=True))
        return resolve_name("crinoid.elements:TipLoad.of"), {"onset": self.onset} | numbers


Load = Annotated[DistributedLoad | TipLoad, Field(discriminator="kind"), KindOf("loads", LoadTable)]
