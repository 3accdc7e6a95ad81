"""Everything that a controller sees when it is to give a command."""

from typing import Any

import equinox as eqx
from jaxtyping import Array, Float

from crinoid.control.target import Target

Pose = Float[Array, " pose"]
Command = Float[Array, " input"]


class Reading(eqx.Module):
    """The newest reading of a sensor that is known."""

    value: Float[Array, " m"]
    """Its values, in the units of `crinoid.Measurand.names`."""
    taken: Float[Array, ""]
    """When it was taken (s)."""


class Seen(eqx.Module):
    """Everything known at one instant. SI units; poses are in the frame of the target."""

    time: Float[Array, ""]
    """Time (s)."""
    measured: Pose
    """Newest known pose of the tip (`crinoid.space.POSE`)."""
    taken: Float[Array, ""]
    """When it was measured (s)."""
    wanted: Pose
    """The target's pose; where the target moves as the submarine does, or its motion is fed
    forward, that of the time at which ``measured`` was measured."""
    forward: Command
    """Command that is known beforehand (`crinoid.control.FeedForward`): the motion of the target.
    Zero where the target stands still or nothing is fed forward."""
    target: Target
    """The whole target, to look ahead: ``seen.target.in_frame(seen.time + 0.5)``."""
    base: Float[Array, " channel"]
    """Displacement of the base's channels, prescribed motion included (m, rad)."""
    command: Command
    """The last command."""
    actuators: tuple[Any, ...]
    """States of the actuators: the base's servos (`crinoid.base.ServoState`), then the others."""
    lower: Command
    """Smallest commands that the actuators follow, in the units of the inputs."""
    upper: Command
    """Largest commands that the actuators follow."""
    readings: dict[str, Reading]
    """Readings of the sensors beside that of the tip, by name."""

    @property
    def age(self) -> Float[Array, ""]:
        """Age of the tip's pose (s)."""
        return self.time - self.taken
