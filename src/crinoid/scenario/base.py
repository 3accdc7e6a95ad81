"""The base: where the submarine holds the arm, and what moves it there."""

import math
from typing import Annotated, Literal

from pydantic import Field

from crinoid.scenario.channel import Channels
from crinoid.scenario.dimension import InSpace, Only
from crinoid.scenario.model import Model
from crinoid.scenario.motion import Motion
from crinoid.scenario.quantity import AsTuple, Degrees, Position

__all__ = ["Base"]


class Base(Model):
    """Where the arm is held, and what moves it there."""

    position: Annotated[Position, InSpace((0.0, 0.0, -10.0))] = Field(
        default=(0.0, -10.0), description="Where the arm is held; z is up."
    )
    tilt_deg: Degrees = Field(default=0.0, description="Turn of the arm's root from x towards z.")
    pan_deg: Annotated[Degrees, Only(3)] = Field(
        default=0.0, description="Turn of the arm's root from x towards y."
    )
    roll_deg: Annotated[Degrees, Only(3)] = Field(
        default=0.0, description="Turn of the arm's root about itself, from y towards z."
    )
    mount: Literal["clamped", "pinned"] = Field(
        default="clamped",
        description="clamped: the root points along tilt and pan; pinned: it turns freely, in "
        "space on a joint that bends both ways but hands on twist.",
    )
    channels: Channels = Field(default=Channels(), description="Channels a controller may drive.")
    motion: Annotated[tuple[Motion, ...], AsTuple] = Field(
        default=(), description="Prescribed motions of the submarine, added to the channels."
    )

    @property
    def angles(self) -> tuple[float, float, float]:
        """Pan, tilt and roll of the set pose, in rad."""
        pan, tilt, roll = map(math.radians, (self.pan_deg, self.tilt_deg, self.roll_deg))
        return (pan, tilt, roll)
