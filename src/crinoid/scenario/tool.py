"""The tool: a rigid body that the tip of the arm carries."""

from collections.abc import Iterator
from typing import Annotated

from pydantic import Field

from crinoid.scenario.dimension import Count
from crinoid.scenario.errors import Mistake, shown
from crinoid.scenario.model import Model
from crinoid.scenario.quantity import (
    Kilograms,
    Metres,
    Pair,
    Quantity,
    Seconds,
    SquareMetres,
    Triple,
    span_conflicts,
)

__all__ = ["Tool", "tool_conflicts"]

_TIP = (0.9, 1.0)
"""Part of the arm that counts as its tip."""

Index = Annotated[int, Quantity(takes="the index of an obstacle, 0 for the first")]

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
    take_at_touch: Index | None = Field(
        default=None,
        ge=0,
        description="Obstacle, counted from 0, at whose first touch at or after from the tip takes "
        "it up; before, the arm has no tool.",
    )
    drop_at_touch: Index | None = Field(
        default=None,
        ge=0,
        description="Obstacle at whose touch the tip lets it go, if until has not come before.",
    )
    touch_span: Pair | None = Field(
        default=None,
        description="Part of the arm whose touches count, over its length; its last tenth if left "
        "out. An edge of the mesh counts whole where any of it does.",
    )

    @property
    def touches(self) -> bool:
        """Whether touches decide when it is held."""
        return self.take_at_touch is not None or self.drop_at_touch is not None

    @property
    def touched(self) -> tuple[float, float]:
        """The part of the arm whose touches count, over its length."""
        return self.touch_span or _TIP

    def _conflicts(self) -> Iterator[Mistake]:
        moments = self.inertia if isinstance(self.inertia, tuple) else (self.inertia,)
        if min(moments) < 0:
            yield self.refused("inertia")
        if self.until is not None and self.until <= self.from_:
            yield Mistake("until", f"got {self.until}, takes a time after from = {self.from_} (s)")
        if self.take_at_touch is not None and self.take_at_touch == self.drop_at_touch:
            text = f"got {self.drop_at_touch}, as take_at_touch; takes another obstacle: the arm "
            yield Mistake("drop_at_touch", text + "still touches that one when it has the tool")
        if self.touch_span is not None:
            yield from span_conflicts("touch_span", self.touch_span)
            if not self.touches:
                text = f"got {shown(self.touch_span)}, goes with take_at_touch or drop_at_touch"
                yield Mistake("touch_span", text)


def tool_conflicts(tool: Tool | None, obstacles: int) -> Iterator[Mistake]:
    """Yield touches of obstacles that are not there; of these the number is given."""
    for name in ("take_at_touch", "drop_at_touch"):
        index = getattr(tool, name, None)
        if index is None or index < obstacles:
            continue
        there = f"{obstacles - 1}" if obstacles == 1 else f"0 to {obstacles - 1}"
        takes = f"takes {there}, the {'index' if obstacles == 1 else 'indices'} of [[obstacle]]"
        takes = takes if obstacles else "takes an [[obstacle]] with it, and there is none"
        yield Mistake(f"tool.{name}", f"got {index}, {takes}")
