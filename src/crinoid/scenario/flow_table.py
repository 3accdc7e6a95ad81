"""Keys that every flow has: its kind, and when and how it sets in."""

from typing import Any

from pydantic import Field

from crinoid.scenario.model import Model
from crinoid.scenario.quantity import Seconds

__all__ = ["FlowTable"]


class FlowTable(Model):
    """A flow that sets in at a time, at once or along a ramp."""

    kind: str
    start: Seconds = Field(default=0.0, ge=0, description="When it sets in.")
    ramp_time: Seconds = Field(
        default=0.0, ge=0, description="How long it takes to reach full strength."
    )

    def build(self, scenario: Any, generator: Any) -> Any:
        """Return the `crinoid.Flow`.

        For tables of installed packages; ``scenario`` is the `crinoid.Scenario` that holds it,
        ``generator`` a `numpy.random.Generator` for what is random.
        """
        raise NotImplementedError
