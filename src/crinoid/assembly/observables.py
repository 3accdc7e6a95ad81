"""Names, units and limits of what a learned controller observes and commands."""

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np

from crinoid.actuation import Follower, Input
from crinoid.assembly.numbers import array
from crinoid.assembly.plan import Plan
from crinoid.control import Observation
from crinoid.scenario import Mistake, ScenarioError
from crinoid.space import AXES, POSE


class Entry(NamedTuple):
    """One number of an observation or an action."""

    name: str
    unit: str
    lower: float
    upper: float


class Observables:
    """Which numbers an observation has, their limits, and how they follow from what is seen.

    Parameters
    ----------
    plan
        Plan that a controller would be built from.
    """

    def __init__(self, plan: Plan) -> None:
        scenario, system = plan.scenario, plan.system
        inputs, channels = system.inputs, system.base.servo.lower.size
        driven = [row for row, each in enumerate(inputs) if float(each.lower) < each.upper]
        if not driven:
            text = "none of them can move, takes a channel with a range, a chamber or a tendon"
            raise ScenarioError([Mistake("base.channels", text)])
        moved = {motion.channel for motion in scenario.base.motion}
        self.axes, self.driven = scenario.arm.dimension, driven
        self.observation = Observation(
            actuators=system.actuators,
            period=array(plan.period),
            axes=self.axes,
            driven=tuple(driven),
            servos=tuple(row for row in driven if row < channels),
            carried=tuple(k for k, each in enumerate(inputs[:channels]) if each.name in moved),
            ahead=plan.target is not None and plan.target.path is not None,
        )
        """Makes an observation of what is seen."""
        self.actions = tuple(_limited(inputs[row]) for row in driven)
        """Name, unit and limits of each number of an action."""
        self.entries = tuple(self._entries(plan))
        """Name, unit and limits of each number of an observation."""

    def _entries(self, plan: Plan) -> Iterator[Entry]:
        system, axes, chosen = plan.system, self.axes, self.observation
        inputs, servo = system.inputs, system.base.servo
        names = POSE[axes]
        for name in AXES[axes]:
            yield _free(f"error.{name}", "m")
        if axes == 2:
            yield Entry("error.sin_angle", "1", -1.0, 1.0)
            yield Entry("error.cos_angle", "1", -1.0, 1.0)
        else:
            for name in names[axes:]:
                yield _free(f"error.{name}", "1")
        for column, name in enumerate(names):
            yield _free(f"rate.{name}", ("m" if column < axes else "rad" * (axes == 2)) + " s-1")
        for row in chosen.servos:
            each = inputs[row]
            yield Entry(f"{each.name}.position", each.unit, float(each.lower), float(each.upper))
        for row in chosen.servos:
            most = float(servo.max_speed[row])
            yield Entry(f"{inputs[row].name}.speed", f"{inputs[row].unit} s-1", -most, most)
        for column in chosen.carried:
            yield _free(f"{inputs[column].name}.pose", inputs[column].unit)
        for actuator in system.actuators:
            for index, each in enumerate(actuator.inputs):
                limits = -np.inf, np.inf
                if isinstance(actuator, Follower):
                    limits = float(actuator.lower[index]), float(actuator.upper[index])
                yield Entry(f"{each.name}.state", each.unit, *limits)
        for name, unit, lower, upper in self.actions:
            # before the first one a command is 0
            yield Entry(f"{name}.command", unit, min(lower, 0.0), max(upper, 0.0))
        for sensor in plan.sensors[1:]:
            for name, unit in sensor.measurand.names(axes):
                yield _free(f"{sensor.name}.{name}", unit)
        if chosen.ahead:
            for name in AXES[axes]:
                yield _free(f"ahead.{name}", "m")


def named(entries: Iterable[Entry]) -> list[list[str]]:
    """Return name and unit of each of some entries."""
    return [[each.name, each.unit] for each in entries]


def _free(name: str, unit: str) -> Entry:
    return Entry(name, unit.strip(), -np.inf, np.inf)


def _limited(given: Input) -> Entry:
    lower, upper = float(given.lower), float(given.upper)
    if not np.isfinite([lower, upper]).all():
        text = f"got commands from {lower:g} to {upper:g} {given.unit}, takes finite limits"
        raise ScenarioError([Mistake(given.name, text)])
    return Entry(given.name, given.unit, lower, upper)
