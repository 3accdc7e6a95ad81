"""Controllers: their interface and input, feed-forward, playback, and no control."""

from abc import abstractmethod
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.control.estimate import Estimate
from crinoid.control.target import Target
from crinoid.foundation.moved import renamed

Pose = Float[Array, " pose"]
Command = Float[Array, " input"]


class Reading(eqx.Module):
    """Newest known reading of a sensor."""

    value: Float[Array, " m"]
    """Its values, in the units of `crinoid.Measurand.names`."""
    measurement_time: Float[Array, ""]
    """Time of the measurement (s)."""
    taken = renamed("measurement_time")


class ControllerInput(eqx.Module):
    """Input of a controller at one instant. SI units; poses are in the frame of the target.

    Poses are ``measured`` and ``reference``: x, z (m) and the angle (rad) of the tip, in space x,
    y, z and the tip's direction, a unit vector (`crinoid.foundation.axes.POSE`). ``measured`` is
    the newest known pose, measured at ``measurement_time``, ``age`` seconds ago.

    ``command``, ``lower``, ``upper`` and ``feedforward`` have a number for each input, in the order
    of `crinoid.System.inputs`: first the channels of the base (m, rad), then chambers and tendons,
    each in the unit of its input. ``base`` has a number for each channel of the base (m, rad).

    ``actuators`` has the state of each servo and actuator, ``readings`` those of the other sensors
    by their names. ``target`` gives the pose at any time (s).
    """

    time: Float[Array, ""]
    """Time (s)."""
    measured: Pose
    """Newest known pose of the tip (`crinoid.foundation.axes.POSE`)."""
    measurement_time: Float[Array, ""]
    """Time of its measurement (s)."""
    reference: Pose
    """The target's pose; where the target moves as the submarine does, or its motion is fed
    forward, that of the time at which ``measured`` was measured."""
    feedforward: Command
    """Feed-forward of the target's motion (`crinoid.control.FeedForward`).
    Zero where the target does not move or nothing is fed forward."""
    target: Target
    """The whole target, to look ahead: ``seen.target.in_frame(seen.time + 0.5)``."""
    base: Float[Array, " channel"]
    """Displacement of the base's channels, prescribed motion included (m, rad)."""
    command: Command
    """Last command."""
    actuators: tuple[Any, ...]
    """States of the actuators: the base's servos (`crinoid.base.ServoState`), then the others."""
    lower: Command
    """Smallest commands that the actuators follow, in the units of the inputs."""
    upper: Command
    """Largest commands that the actuators follow."""
    readings: dict[str, Reading]
    """Readings of the other sensors, by name."""
    taken = renamed("measurement_time")
    wanted = renamed("reference")
    forward = renamed("feedforward")

    @property
    def age(self) -> Float[Array, ""]:
        """Age of the tip's pose (s)."""
        return self.time - self.measurement_time


class Controller(eqx.Module):
    """Law that turns measurements into commands for the inputs (`crinoid.System.inputs`).

    Called once per control period; its command is held until the next call, and clipped to the
    limits of each input.
    """

    @abstractmethod
    def start(self, seen: ControllerInput) -> Any:
        """Return the memory at the first call: a pytree of arrays."""

    @abstractmethod
    def command(self, memory: Any, seen: ControllerInput) -> tuple[Command, Any]:
        """Return the command, a number for each input in its unit, and the memory for the next."""

    def estimate(self, memory: Any) -> Estimate | None:
        """Return the estimate that the memory after a command contains; None without an observer.

        Results then have its variables.
        """
        return None


class Idle(Controller):
    """No control: the base stays where it is."""

    def start(self, seen: ControllerInput) -> None:
        return None

    def command(self, memory: None, seen: ControllerInput) -> tuple[Command, None]:
        return jnp.zeros_like(seen.command), None


Channels = Float[Array, " channel"]


class FeedForward(eqx.Module):
    """Feed-forward: commands that move the tip as its target moves, from the start of both.

    The path is known, so a channel aims at where the target will be once it has followed: ahead by
    the lag of its servo and half a period of the controller, for which a command is held. In a
    target's own frame, as the submarine carries the arm along with it.
    """

    mapping: Float[Array, "channel pose"]
    """Displacement of the channels per displacement of the tip."""
    lead: Channels
    """Preview of each channel (s)."""
    begin: Float[Array, ""]
    """Time at which the controller is switched on (s)."""

    def __call__(self, target: Target, time: Float[Array, ""]) -> Channels:
        """Return the displacement of the channels (m, rad) to command at ``time`` (s)."""
        ahead = jax.vmap(target.in_frame)(time + self.lead)
        return jnp.sum(self.mapping * (ahead - target.in_frame(self.begin)), axis=1)


SLACK = 1e-6
"""A command that is this much later (s) than a tick still counts: sums of time steps round."""


class Playback(Controller):
    """Playback of recorded commands, each from its time until that of the next."""

    time: Float[Array, " row"]
    """Times of the commands (s), increasing."""
    values: Float[Array, "row input"]
    """Commands, in the units of the inputs; 0 before the first."""

    def start(self, seen: ControllerInput) -> None:
        return None

    def command(self, memory: None, seen: ControllerInput) -> tuple[Command, None]:
        return self.at(seen.time), None

    def at(self, time: Float[Array, ""]) -> Command:
        """Return the command at ``time`` (s)."""
        row = jnp.searchsorted(self.time, time + SLACK, side="right") - 1
        return jnp.where(row >= 0, self.values[jnp.maximum(row, 0)], 0.0)
