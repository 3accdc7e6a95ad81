"""The base: where the submarine holds the arm, and what moves it there."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field

from crinoid.scenario.channel import Channels
from crinoid.scenario.errors import Mistake
from crinoid.scenario.model import Model
from crinoid.scenario.motion import Motion
from crinoid.scenario.quantity import AsTuple, Degrees, Position

__all__ = ["Base"]


class Base(Model):
    """Where the arm is held, and what moves it there."""

    position: Position = Field(default=(0.0, -10.0), description="Where the arm is held; z is up.")
    tilt_deg: Degrees = Field(default=0.0, description="Turn of the arm's root from x towards z.")
    mount: Literal["clamped", "pinned"] = Field(
        default="clamped",
        description="clamped: the root points along the tilt; pinned: it turns freely.",
    )
    channels: Channels = Field(default=Channels(), description="Channels a controller may drive.")
    motion: Annotated[tuple[Motion, ...], AsTuple] = Field(
        default=(), description="Prescribed motions of the submarine, added to the channels."
    )

    def _conflicts(self) -> Iterator[Mistake]:
        if self.mount == "clamped":
            return
        text = 'moves nothing: with base.mount = "pinned" the root turns freely'
        if self.channels.tilt:
            yield Mistake("channels.tilt", text)
        for index, motion in enumerate(self.motion):
            if motion.channel == "tilt":
                yield Mistake(f"motion.{index}.channel", f'"tilt" {text}')
