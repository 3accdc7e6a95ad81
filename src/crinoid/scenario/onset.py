"""Keys that every flow has: its kind, and when and how it sets in."""

from __future__ import annotations

from pydantic import Field

from crinoid.scenario.model import Model
from crinoid.scenario.quantity import Seconds

__all__ = ["Onset"]


class Onset(Model):
    """A flow that sets in at a time, at once or along a ramp."""

    kind: str
    start: Seconds = Field(default=0.0, ge=0, description="When it sets in.")
    ramp_time: Seconds = Field(
        default=0.0, ge=0, description="How long it takes to reach full strength."
    )
