"""Commands that were recorded, played again."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.control.controller import Controller
from crinoid.control.seen import Command, Seen

_SLACK = 1e-6
"""A command that is this much later (s) than a tick still counts: sums of time steps round."""


class Playback(Controller):
    """Gives the commands of a record, each from its time until that of the next."""

    time: Float[Array, " row"]
    """When each command is given (s), increasing."""
    values: Float[Array, "row input"]
    """Commands, in the units of the inputs; 0 before the first."""

    def start(self, seen: Seen) -> None:
        return None

    def command(self, memory: None, seen: Seen) -> tuple[Command, None]:
        row = jnp.searchsorted(self.time, seen.time + _SLACK, side="right") - 1
        return jnp.where(row >= 0, self.values[jnp.maximum(row, 0)], 0.0), None
