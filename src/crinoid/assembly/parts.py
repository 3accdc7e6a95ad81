"""Parts of a user's own, which no scenario describes."""

from collections.abc import Callable
from dataclasses import dataclass, replace

from crinoid.assembly.actuator import ActuatorParameters
from crinoid.assembly.door import check_element, check_flow
from crinoid.assembly.plan import Plan
from crinoid.control import Controller, Sensor
from crinoid.dynamics import System
from crinoid.elements import Element
from crinoid.flow import Flow


@dataclass(frozen=True)
class Parts:
    """Parts that are added to those of a scenario."""

    controller: Controller | Callable[[Plan], Controller] | None = None
    """In place of the scenario's; a function builds it when the start is known."""
    elements: tuple[Element, ...] = ()
    flows: tuple[Flow, ...] = ()
    sensors: tuple[Sensor, ...] = ()
    actuators: tuple[ActuatorParameters, ...] = ()

    def added(self, system: System) -> System:
        """Return a system with the elements and flows, if they pass the door."""
        forces = system.forces
        for index, flow in enumerate(self.flows, len(forces.water.flows)):
            check_flow(flow, f"flow {index}", forces.axes)
        for index, element in enumerate(self.elements, len(forces.elements)):
            check_element(element, f"element {index}", system)
        water = replace(forces.water, flows=(*forces.water.flows, *self.flows))
        elements = (*forces.elements, *self.elements)
        return replace(system, forces=replace(forces, elements=elements, water=water))
