"""The tool: a rigid body that the tip of the arm carries."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated

from pydantic import Field

from crinoid.scenario.dimension import Count
from crinoid.scenario.errors import Mistake
from crinoid.scenario.model import Model
from crinoid.scenario.quantity import Kilograms, Metres, Quantity, Seconds, SquareMetres, Triple

__all__ = ["Tool"]

Inertia = Annotated[
    float | Triple,
    Quantity(
        "kg m2", "a number of 0 or more", "a number of 0 or more, or three: about t, m_1 and m_2"
    ),
    Count(plane=(1,), space=(1, 3)),
]


class Tool(Model):
    """A rigid body that the tip carries: a gripper, a camera, a sample.

    It is fixed to the last edge and turns with it. It does not touch obstacles.
    """

    mass: Kilograms = Field(gt=0, description="Its mass.")
    volume: Annotated[float, Quantity("m3")] = Field(
        default=0.0, ge=0, description="Volume of the water that it displaces."
    )
    drag_area: SquareMetres = Field(
        default=0.0, ge=0, description="Its area times its drag coefficient."
    )
    added_mass: Kilograms = Field(
        default=0.0, ge=0, description="Mass of the water that moves along with it."
    )
    inertia: Inertia = Field(
        default=0.0,
        description="Moment of inertia about its centre of mass, across the plane; in space also "
        "three: about the arm's direction t and its directors m_1 and m_2.",
    )
    offset: Metres = Field(
        default=0.0, ge=0, description="Distance of its centre of mass beyond the tip."
    )
    from_: Seconds = Field(
        default=0.0,
        ge=0,
        alias="from",
        description="When it is taken up; it comes moving as the tip does then.",
    )
    until: Seconds | None = Field(
        default=None, gt=0, description="When it is let go; never if left out."
    )

    def _conflicts(self) -> Iterator[Mistake]:
        moments = self.inertia if isinstance(self.inertia, tuple) else (self.inertia,)
        if min(moments) < 0:
            yield self.refused("inertia")
        if self.until is not None and self.until <= self.from_:
            yield Mistake("until", f"got {self.until}, takes a time after from = {self.from_} (s)")
