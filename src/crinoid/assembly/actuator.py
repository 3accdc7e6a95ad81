"""Actuators beside the servos of the base: their numbers, and what they make of an arm."""

from abc import abstractmethod
from collections.abc import Iterable

import equinox as eqx

from crinoid.actuation import Actuator
from crinoid.assembly.door import check_actuator, expect, made
from crinoid.dynamics import Lines
from crinoid.elements import Element
from crinoid.rod import Rod


class ActuatorParameters(eqx.Module):
    """The numbers of an actuator: a pytree of arrays, as `crinoid.parameters` holds it."""

    def lines(self, rod: Rod, first: int) -> Lines | None:
        """Return which of the threads are lines, if there are any; arguments as of `assemble`."""
        return None

    @abstractmethod
    def assemble(self, rod: Rod, first: int) -> tuple[Actuator, tuple[Element, ...]]:
        """Return the actuator, and the elements through which it acts; traceable.

        Parameters
        ----------
        rod
            The arm: its reference shape and its sections.
        first
            Where its drive begins in `crinoid.Motion.drive`.
        """


def assemble_actuators(
    parameters: Iterable[ActuatorParameters], rod: Rod
) -> tuple[tuple[Actuator, ...], tuple[Element, ...], Lines | None]:
    """Return the actuators of an arm, all elements through which they act, and the lines."""
    actuators: list[Actuator] = []
    elements: list[Element] = []
    first, lines = 0, None
    for each in parameters:
        lines = lines or expect(each, ActuatorParameters, "actuators").lines(rod, first)
        actuator, through = made("actuator", 2, each.assemble, rod, first)
        check_actuator(actuator)
        actuators.append(actuator)
        elements.extend(through)
        first += actuator.drive(actuator.at_rest()).shape[0]
    return tuple(actuators), tuple(elements), lines
