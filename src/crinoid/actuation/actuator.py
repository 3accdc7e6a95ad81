"""The interface of all actuators: they follow commands in their own time."""

from abc import abstractmethod
from collections.abc import Sequence
from itertools import accumulate, pairwise
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from crinoid.actuation.input import Input

Command = Float[Array, " input"]
Drive = Float[Array, " drive"]


class Actuator(eqx.Module):
    """Turns commands into what drives the arm: a pressure, a tension, a displacement.

    Its state is a pytree of arrays. The time step asks for the drive at its end, where the forces
    are balanced.
    """

    @property
    @abstractmethod
    def inputs(self) -> tuple[Input, ...]:
        """The inputs that it follows, in the order of its part of a command."""

    @abstractmethod
    def at_rest(self) -> Any:
        """Return its state before the first command."""

    @abstractmethod
    def advance(self, state: Any, command: Command, step: Float[Array, ""]) -> Any:
        """Return the state after following ``command``, held for ``step`` seconds."""

    def response(self, frequency: Float[np.ndarray, " f"]) -> Complex[np.ndarray, "f input"]:
        """Return drive over command at frequencies (Hz), as long as no limit is met.

        What is known of the loop before a run, and by how much a feed-forward looks ahead, come
        from it. The drive follows at once if it is not told otherwise.
        """
        return np.ones((frequency.size, len(self.inputs)), complex)

    @abstractmethod
    def drive(self, state: Any) -> Drive:
        """Return what it drives the arm with, a number for each input in its unit.

        Elements find it in `crinoid.Motion.drive`, where the drives of all actuators but the base's
        servos stand one behind the other.
        """


def followed(
    actuators: Sequence[Actuator], states: Sequence[Any], command: Command, step: Float[Array, ""]
) -> list[Any]:
    """Return the states of actuators after each has followed its part of a command."""
    ends = accumulate((len(actuator.inputs) for actuator in actuators), initial=0)
    parts = [command[first:last] for first, last in pairwise(ends)]
    every = zip(actuators, states, parts, strict=True)
    return [one.advance(state, part, step) for one, state, part in every]


def drives(actuators: Sequence[Actuator], states: Sequence[Any]) -> Drive | None:
    """Return the drives of all actuators, one behind the other; None where there are none."""
    if not actuators:
        return None
    found = [one.drive(state) for one, state in zip(actuators, states, strict=True)]
    return jnp.concatenate(found)
