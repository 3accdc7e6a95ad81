"""The tool at the tip of the arm."""

from collections.abc import Iterator
from typing import Annotated

from pydantic import Field

from crinoid.scenario.errors import Mistake, got
from crinoid.scenario.model import Model, entry
from crinoid.scenario.quantity import (
    Count,
    CubicMetres,
    Kilograms,
    Metres,
    Pair,
    Quantity,
    Seconds,
    SquareMetres,
    Triple,
    span_conflicts,
)

_TIP = (0.9, 1.0)  # part of the arm that counts as its tip

Index = Annotated[int, Quantity(expects="the index of an obstacle, 0 for the first")]

Inertia = Annotated[
    float | Triple,
    Quantity(
        "kg m2", "a number of 0 or more", "a number of 0 or more, or three: about t, m_1 and m_2"
    ),
    Count(plane=(1,), space=(1, 3)),
]


class Tool(Model):
    """A rigid body at the tip: a gripper, a camera, a sample.

    It is fixed to the last edge and turns with it. With a radius it touches obstacles.
    """

    mass: Kilograms = Field(gt=0, description="Its mass.")
    volume: CubicMetres = entry(0.0, "Volume of displaced water.", ge=0)
    drag_area: SquareMetres = entry(0.0, "Its area times its drag coefficient.", ge=0)
    added_mass: Kilograms = entry(0.0, "Mass of the water that moves with it.", ge=0)
    inertia: Inertia = entry(
        0.0,
        "Moment of inertia about its centre of mass, across the plane; in space also three: "
        "about the arm's direction t and its directors m_1 and m_2.",
    )
    offset: Metres = entry(0.0, "Distance of its centre of mass beyond the tip.", ge=0)
    radius: Metres | None = entry(
        None,
        "Radius of a ball about its centre of mass, by which it touches obstacles and is drawn; "
        "it touches nothing by default.",
        gt=0,
    )
    from_: Seconds = entry(
        0.0, "Time when the tip picks it up; it moves like the tip then.", ge=0, alias="from"
    )
    until: Seconds | None = entry(None, "Time when the tip drops it; never by default.", gt=0)
    take_at_touch: Index | None = entry(
        None,
        "Obstacle, from 0, at whose first touch at or after from the tip picks it up; before, "
        "the arm has no tool.",
        ge=0,
    )
    drop_at_touch: Index | None = entry(
        None, "Obstacle at whose touch the tip drops it, before until.", ge=0
    )
    touch_span: Pair | None = entry(
        None,
        "Part of the arm whose touches count, over its length; by default its last tenth. An "
        "edge of the mesh counts whole.",
    )

    @property
    def touches(self) -> bool:
        """Whether touches attach or detach it."""
        return self.take_at_touch is not None or self.drop_at_touch is not None

    @property
    def touched(self) -> tuple[float, float]:
        """The part of the arm whose touches count, over its length."""
        return self.touch_span or _TIP

    def _conflicts(self) -> Iterator[Mistake]:
        moments = self.inertia if isinstance(self.inertia, tuple) else (self.inertia,)
        if min(moments) < 0:
            yield self.mistake("inertia")
        if self.until is not None and self.until <= self.from_:
            yield self.mistake("until", f"be after from = {self.from_} (s)")
        if self.radius and (self.from_ or self.until is not None or self.touches):
            hint = "A tool that touches is held all the time."
            yield self.mistake("radius", "be left out with from, until and touches", hint)
        if self.take_at_touch is not None and self.take_at_touch == self.drop_at_touch:
            hint = "The arm still touches that obstacle when it has the tool."
            yield self.mistake("drop_at_touch", "differ from take_at_touch", hint)
        if self.touch_span is not None:
            yield from span_conflicts("touch_span", self.touch_span)
            if not self.touches:
                hint = "Set take_at_touch or drop_at_touch to use it."
                yield self.mistake("touch_span", "be left out without touches", hint)


def tool_conflicts(tool: Tool | None, obstacles: int) -> Iterator[Mistake]:
    """Yield touches of obstacles that do not exist, from the number of obstacles."""
    for name in ("take_at_touch", "drop_at_touch"):
        index = getattr(tool, name, None)
        if index is not None and index >= obstacles:
            must = f"be at most {obstacles - 1}, the index of the last [[obstacle]]"
            must = must if obstacles else "be left out without an [[obstacle]]"
            yield Mistake(f"tool.{name}", got(index, must))
