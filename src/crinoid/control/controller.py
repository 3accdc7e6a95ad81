"""The interface of all controllers, and the one that does nothing."""

from abc import abstractmethod
from typing import Any

import equinox as eqx
import jax.numpy as jnp

from crinoid.control.seen import Command, Seen


class Controller(eqx.Module):
    """Turns what is seen of the arm into commands for its inputs (`crinoid.System.inputs`).

    Called once per control period; its command is held until the next call. What goes beyond the
    limits of an input is cut off.
    """

    @abstractmethod
    def start(self, seen: Seen) -> Any:
        """Return the memory at the first call: a pytree of arrays."""

    @abstractmethod
    def command(self, memory: Any, seen: Seen) -> tuple[Command, Any]:
        """Return the command, a number for each input in its unit, and the memory for the next."""


class Idle(Controller):
    """Commands nothing: the base stays where it is."""

    def start(self, seen: Seen) -> None:
        return None

    def command(self, memory: None, seen: Seen) -> tuple[Command, None]:
        return jnp.zeros_like(seen.command), None
