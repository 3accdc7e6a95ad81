"""Actuators of an arm besides its servos: their numbers, and how they are assembled."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable

import equinox as eqx

from crinoid.actuation import Actuator
from crinoid.assembly.door import build_part, check_actuator, expect
from crinoid.dynamics import LengthControlledThreads
from crinoid.elements import Element
from crinoid.rod import Rod


class ActuatorParameters(eqx.Module):
    """The numbers of an actuator: a pytree of arrays (`crinoid.parameters`).

    Examples
    --------
    >>> chambers = crinoid.parameters("reach").actuator[0]
    >>> isinstance(chambers, crinoid.ActuatorParameters)
    True
    >>> (1e6 * chambers.area).round(1).tolist()  # mm2
    [300.0, 200.0]
    """

    def lines(self, rod: Rod, first: int) -> LengthControlledThreads | None:
        """Return which of the threads are lines, if there are any; arguments as of `assemble`."""
        return None

    @abstractmethod
    def assemble(self, rod: Rod, first: int) -> tuple[Actuator, tuple[Element, ...]]:
        """Return the actuator, and the elements through which it acts; traceable.

        Parameters
        ----------
        rod : Rod
            The arm: its reference shape and its sections.
        first : int
            Index at which its drive begins in `crinoid.Motion.drive`.

        Returns
        -------
        tuple of Actuator and tuple of Element
        """


def assemble_actuators(
    parameters: Iterable[ActuatorParameters], rod: Rod
) -> tuple[tuple[Actuator, ...], tuple[Element, ...], LengthControlledThreads | None]:
    """Return the actuators of an arm, all elements through which they act, and the lines."""
    actuators: list[Actuator] = []
    elements: list[Element] = []
    first, lines = 0, None
    for each in parameters:
        lines = lines or expect(each, ActuatorParameters, "actuators").lines(rod, first)
        actuator, through = build_part("actuator", 2, each.assemble, rod, first)
        check_actuator(actuator)
        actuators.append(actuator)
        elements.extend(through)
        first += actuator.drive(actuator.at_rest()).shape[0]
    return tuple(actuators), tuple(elements), lines
