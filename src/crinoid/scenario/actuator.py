"""Actuators beside the servos of the base: kinds that installed packages bring."""

from collections.abc import Iterator
from typing import Annotated, Any

from pydantic import Field

from crinoid.scenario.errors import Mistake, shown
from crinoid.scenario.kinds import KindOf
from crinoid.scenario.model import Model
from crinoid.scenario.quantity import NAME
from crinoid.space import CHANNELS

__all__ = ["Actuator", "ActuatorTable", "actuator_conflicts"]


class ActuatorTable(Model):
    """Keys that every actuator has."""

    kind: str = Field(description="Kind of actuator, of an installed package.")
    name: Annotated[str | None, NAME] = Field(
        default=None,
        pattern="^[a-z][a-z0-9_]*$",
        description="Name of its inputs; that of its kind if left out.",
    )

    @property
    def called(self) -> str:
        """The name of its inputs."""
        return self.name or self.kind

    def build(self, scenario: Any) -> Any:
        """Return the numbers of the actuator, `crinoid.ActuatorParameters`.

        ``scenario`` is the `crinoid.Scenario` that holds it.
        """
        raise NotImplementedError


Actuator = Annotated[ActuatorTable, KindOf("actuators", ActuatorTable)]


def actuator_conflicts(
    actuators: tuple[ActuatorTable, ...], taken: tuple[str, ...]
) -> Iterator[Mistake]:
    """Yield names that two actuators share, or that others have taken."""
    names = [each.called for each in actuators]
    taken = (*taken, *CHANNELS[3])
    for index, name in enumerate(names):
        if name in taken:
            text = f"got {shown(name)}, as a chamber, tendon or channel is called; takes another"
            yield Mistake(f"actuator.{index}.name", text)
        if name in names[:index]:
            text = f"got {shown(name)}, as actuator.{names.index(name)} is called; takes another"
            yield Mistake(f"actuator.{index}.name", text)
