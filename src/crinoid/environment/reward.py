"""A number for each step: how near the tip is to its target, and how calm the commands are."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

NEAR, FAR = 0.02, 1.0
"""Errors, over the arm's length, at which half of each part of the reward is lost."""
CHANGES = 0.1
"""Weight of the changes of commands."""


class Moment(eqx.Module):
    """A step of an environment at its end, for a reward. True values, not those of sensors."""

    time: Float[Array, ""]
    """Time (s)."""
    error: Float[Array, " pose"]
    """Wanted pose of the tip less its pose (`crinoid.space.POSE`; m, rad or 1)."""
    deviation: Float[Array, ""]
    """Size of the error in the coordinates of ``control.controlled`` over the arm's length, angles
    in rad and directions as they are."""
    command: Float[Array, " driven"]
    """The command, in the units of the inputs that are driven."""
    change: Float[Array, " driven"]
    """Change from the command before, over the range of the input."""
    left: Float[Array, ""]
    """Steps that the episode would go on for."""
    failed: Bool[Array, ""]
    """Whether the simulation failed."""
    success: Bool[Array, ""]
    """Whether the task is done."""


def closeness(moment: Moment) -> Float[Array, ""]:
    """Return the reward where no other is given, from -1.1 to 0.

    It is ``-(q(e / 0.02) + q(e)) / 2 - 0.1 mean(c^2)`` with ``q(x) = x^2 / (1 + x^2)``, ``e`` the
    deviation and ``c`` the changes of the commands: the first part tells errors of about 2 % of the
    arm's length apart, the second leads there from afar. A step that fails gets the least reward,
    and that of each step that was left, so that it never pays to fail.
    """
    lost = 0.5 * (_share(moment.deviation / NEAR) + _share(moment.deviation / FAR))
    reward = -lost - CHANGES * jnp.mean(moment.change**2)
    return jnp.where(moment.failed, -(1.0 + CHANGES) * (1.0 + moment.left), reward)


def _share(ratio: Float[Array, ""]) -> Float[Array, ""]:
    return ratio**2 / (1 + ratio**2)
