"""Parts of a user's own, which no scenario describes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import jax

from crinoid.assembly.actuator import ActuatorParameters
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
        """Return a system with the elements and flows.

        Raises
        ------
        ValueError
            If an element has windows that the arm has no nodes for.
        """
        rows = system.reference.nodes + 1
        for element in self.elements:
            count = jax.tree.leaves(element)[0].shape[0]
            last = element.first + count - 1 + element.stencil
            if element.first < 0 or last > rows:
                raise ValueError(
                    f"{type(element).__name__} has {count} windows of {element.stencil} nodes from "
                    f"node {element.first} on; the arm's nodes go from 0, the ghost, to {rows - 1}"
                )
        forces = system.forces
        water = replace(forces.water, flows=(*forces.water.flows, *self.flows))
        elements = (*forces.elements, *self.elements)
        return replace(system, forces=replace(forces, elements=elements, water=water))
