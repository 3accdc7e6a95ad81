"""Controllers: their interface and input, feed-forward, playback, and no control."""

from abc import abstractmethod
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.control.estimate import Estimate
from crinoid.control.target import Pose, Target

Command = Float[Array, " input"]


class Reading(eqx.Module):
    """Newest known reading of a sensor."""

    value: Float[Array, " m"]
    """Its values, in the units of `crinoid.Measurand.names`."""
    measurement_time: Float[Array, ""]
    """Time of the measurement (s)."""


class ControllerInput(eqx.Module):
    """Input of a controller at one instant. SI units; poses are in the frame of the target.

    A pose is x, z (m) and the angle (rad) of the tip. In space it is x, y, z and the tip's
    direction, a unit vector (`crinoid.foundation.axes.POSE`). Commands have a number for each of
    `crinoid.System.inputs`, in its unit.

    Attributes
    ----------
    time
        Time (s).
    measured
        Newest known pose of the tip.
    measurement_time
        Time of its measurement (s), ``age`` seconds ago.
    reference
        The target's pose; where the target moves as the submarine does, or its motion is
        fed forward, that of the time at which ``measured`` was measured.
    feedforward
        Feed-forward of the target's motion (`crinoid.control.FeedForward`). Zero where the
        target does not move or nothing is fed forward.
    target
        The whole target, to look ahead: ``seen.target.in_frame(seen.time + 0.5)``.
    base
        Displacement of the base's channels, prescribed motion included (m, rad).
    command
        Last command.
    actuators
        States of the actuators: the base's servos (`crinoid.base.ServoState`), then the
        others.
    lower
        Smallest commands that the actuators follow.
    upper
        Largest commands that the actuators follow.
    readings
        Readings of the other sensors, by name.

    Examples
    --------
    >>> session = crinoid.Session(crinoid.load("still-water", ["arm.nodes=5"]))
    >>> seen = session.reset()
    >>> (seen.reference - seen.measured).shape
    (3,)
    """

    time: Float[Array, ""]
    measured: Pose
    measurement_time: Float[Array, ""]
    reference: Pose
    feedforward: Command
    target: Target
    base: Float[Array, " channel"]
    command: Command
    actuators: tuple[Any, ...]
    lower: Command
    upper: Command
    readings: dict[str, Reading]

    @property
    def age(self) -> Float[Array, ""]:
        """Age of the tip's pose (s)."""
        return self.time - self.measurement_time


class Controller(eqx.Module):
    """Law that turns measurements into commands for the inputs (`crinoid.System.inputs`).

    Called once per control period; its command is held until the next call, and clipped to the
    limits of each input.

    Examples
    --------
    A controller without memory that slides the base against the error in x:

    >>> class Slide(crinoid.Controller):
    ...     gain: float
    ...
    ...     def start(self, seen):
    ...         return None
    ...
    ...     def command(self, memory, seen):
    ...         error = seen.reference[0] - seen.measured[0]
    ...         return jnp.zeros_like(seen.command).at[0].set(self.gain * error), None
    >>> scenario = crinoid.load("still-water", ["arm.nodes=5"])
    >>> loop, state = crinoid.closed_loop(scenario, controller=Slide(0.5))
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
