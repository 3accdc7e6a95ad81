"""An observation: numbers that a controller of the arm would see, one behind the other."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from crinoid.actuation import Follower, Input, drives
from crinoid.assembly.plan import Plan
from crinoid.control import Seen, pose_error
from crinoid.scenario import Mistake, ScenarioError
from crinoid.simulation import Loop
from crinoid.space import AXES, POSE

AHEAD = 0.5
"""How far ahead the way of a target is told (s)."""


class Entry(NamedTuple):
    """One number of an observation or an action."""

    name: str
    unit: str
    lower: float
    upper: float


class Observer:
    """Which numbers an observation has, their limits, and how they follow from what is seen.

    Parameters
    ----------
    loop
        The closed loop.
    plan
        Plan that its controller would be built from.

    Raises
    ------
    ScenarioError
        If no input can move, or one that can has no limits.
    """

    def __init__(self, loop: Loop, plan: Plan) -> None:
        scenario = plan.scenario
        inputs = loop.system.inputs
        self.driven = [row for row, each in enumerate(inputs) if float(each.lower) < each.upper]
        if not self.driven:
            text = "none of them can move, takes a channel with a range, a chamber or a tendon"
            raise ScenarioError([Mistake("base.channels", text)])
        self.axes = scenario.arm.dimension
        self.moves = loop.target.path is not None
        self._channels = loop.system.base.servo.lower.size
        self._servos = [row for row in self.driven if row < self._channels]
        moved = {motion.channel for motion in scenario.base.motion}
        self._carried = [k for k, each in enumerate(inputs[: self._channels]) if each.name in moved]
        self.actions = tuple(_limited(inputs[row]) for row in self.driven)
        """Name, unit and limits of each number of an action."""
        self.entries = tuple(self._entries(loop))
        """Name, unit and limits of each number of an observation."""

    def _entries(self, loop: Loop) -> Iterator[Entry]:
        inputs, servo, axes = loop.system.inputs, loop.system.base.servo, self.axes
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
        for row in self._servos:
            each = inputs[row]
            yield Entry(f"{each.name}.position", each.unit, float(each.lower), float(each.upper))
        for row in self._servos:
            most = float(servo.max_speed[row])
            yield Entry(f"{inputs[row].name}.speed", f"{inputs[row].unit} s-1", -most, most)
        for column in self._carried:
            yield _free(f"{inputs[column].name}.pose", inputs[column].unit)
        for actuator in loop.system.actuators:
            for index, each in enumerate(actuator.inputs):
                limits = -np.inf, np.inf
                if isinstance(actuator, Follower):
                    limits = float(actuator.lower[index]), float(actuator.upper[index])
                yield Entry(f"{each.name}.state", each.unit, *limits)
        for name, unit, lower, upper in self.actions:
            # before the first one a command is 0
            yield Entry(f"{name}.command", unit, min(lower, 0.0), max(upper, 0.0))
        for name, unit in loop.readings[len(names) :]:
            yield _free(name, unit)
        if self.moves:
            for name in AXES[axes]:
                yield _free(f"ahead.{name}", "m")

    def __call__(
        self, loop: Loop, seen: Seen, before: Float[Array, " pose"]
    ) -> Float[Array, " entry"]:
        """Return the numbers.

        Parameters
        ----------
        loop
            The closed loop.
        seen
            What a controller sees of it.
        before
            Pose of the tip that it saw a control period before.
        """
        servo, *others = seen.actuators
        error = pose_error(seen.wanted, seen.measured)
        pointing = error[self.axes :]
        if self.axes == 2:
            pointing = jnp.concatenate([jnp.sin(pointing), jnp.cos(pointing)])
        rows = np.array(self._servos, int)
        parts = [
            error[: self.axes],
            pointing,
            pose_error(seen.measured, before) / loop.clock.period,
            servo.position[rows],
            servo.velocity[rows],
            seen.base[np.array(self._carried, int)],
            drives(loop.system.actuators, others),
            seen.command[np.array(self.driven)],
            *(reading.value for reading in seen.readings.values()),
        ]
        if self.moves:
            now, later = (seen.target.in_frame(seen.time + ahead) for ahead in (0.0, AHEAD))
            parts.append((later - now)[: self.axes])
        return jnp.concatenate([part for part in parts if part is not None])


def _free(name: str, unit: str) -> Entry:
    return Entry(name, unit.strip(), -np.inf, np.inf)


def _limited(given: Input) -> Entry:
    lower, upper = float(given.lower), float(given.upper)
    if not np.isfinite([lower, upper]).all():
        text = f"got commands from {lower:g} to {upper:g} {given.unit}, takes finite limits"
        raise ScenarioError([Mistake(given.name, text)])
    return Entry(given.name, given.unit, lower, upper)
