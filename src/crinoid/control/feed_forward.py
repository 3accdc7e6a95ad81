"""Feed-forward: the commands that a target's path takes, as far as they are known beforehand."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.control.target import Target

Channels = Float[Array, " channel"]


class FeedForward(eqx.Module):
    """Commands that move the tip as its target moves, from where both were at the start.

    The path is known, so a channel aims at where the target will be once it has followed: ahead by
    the lag of its servo and half a period of the controller, for which a command is held. In a
    target's own frame, as the submarine carries the arm along with it.
    """

    mapping: Float[Array, "channel pose"]
    """Displacement of the channels per displacement of the tip."""
    lead: Channels
    """How far each channel looks ahead (s)."""
    begin: Float[Array, ""]
    """When the controller is switched on (s)."""

    def __call__(self, target: Target, time: Float[Array, ""]) -> Channels:
        """Return the displacement of the channels (m, rad) to command at ``time`` (s)."""
        ahead = jax.vmap(target.in_frame)(time + self.lead)
        return jnp.sum(self.mapping * (ahead - target.in_frame(self.begin)), axis=1)
