"""Keys that every flow has."""

from __future__ import annotations

from pkgutil import resolve_name
from typing import Any, ClassVar

from crinoid.scenario.model import Model, entry
from crinoid.scenario.quantity import Seconds


class FlowTable(Model):
    """A flow with a start time and a ramp."""

    drawn: ClassVar[bool] = False
    """Whether the seed of the scenario decides its velocity at each instant."""
    kind: str
    start: Seconds = entry(0.0, "Start time.", ge=0)
    ramp_time: Seconds = entry(0.0, "Time to reach full strength.", ge=0)

    def build(self, scenario: Any, generator: Any) -> Any:
        """Return the `crinoid.Flow`.

        ``scenario`` is the `crinoid.Scenario` with this table, ``generator`` a
        `numpy.random.Generator` of this flow alone.
        """
        raise NotImplementedError

    @property
    def uniform_mean(self) -> tuple[float, ...] | None:
        """Its mean velocity (m/s) if that is the same everywhere; surface waves ride on it."""
        return None

    @property
    def onset(self) -> Any:
        """When and how it sets in, as a `crinoid.Onset`."""
        return resolve_name("crinoid.assembly.arrays:onset")(self)

    def _made(self, name: str, *keys: str, **others: Any) -> Any:
        """Return the flow that a function of `crinoid.flow` builds from the onset and values."""
        given = {key: getattr(self, key) for key in keys}
        return resolve_name(f"crinoid.flow:{name}")(self.onset, **given, **others)
