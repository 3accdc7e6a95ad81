"""Rewards and success of a step: nearness of the tip to its target, and calm commands."""

from __future__ import annotations

import math
from dataclasses import dataclass

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from crinoid.scenario import Mistake, ScenarioError, got

NEAR, FAR = 0.02, 1.0
"""Errors, over the arm's length, at which half of each part of the reward is lost."""
CHANGES = 0.1  # weight of the changes of commands


class RewardInput(eqx.Module):
    """True values at the end of a step, from which a reward is computed."""

    time: Float[Array, ""]
    """Time (s)."""
    error: Float[Array, " pose"]
    """Target pose minus tip pose (`crinoid.foundation.axes.POSE`; m, rad or 1)."""
    deviation: Float[Array, ""]
    """Norm of the error in the coordinates of ``control.controlled``: lengths over the arm's
    length, angles in rad, components of directions as they are."""
    command: Float[Array, " driven"]
    """The command, in the units of the driven inputs."""
    change: Float[Array, " driven"]
    """Change from the command before, over the range of the input."""
    left: Float[Array, ""]
    """Number of steps that are left in the episode."""
    failed: Bool[Array, ""]
    """Whether the simulation failed."""
    success: Bool[Array, ""]
    """Whether the task is done."""


def closeness(moment: RewardInput) -> Float[Array, ""]:
    """Return the default reward, from -1.1 to 0.

    It is ``-(q(e / 0.02) + q(e)) / 2 - 0.1 mean(c^2)`` with ``q(x) = x^2 / (1 + x^2)``, ``e`` the
    deviation and ``c`` the changes of the commands: the first part distinguishes errors of about
    2 % of the arm's length, the second leads there from afar. A step that fails gets the least
    reward, also for each step that was left, so that failing never pays.
    """
    lost = 0.5 * (_share(moment.deviation / NEAR) + _share(moment.deviation / FAR))
    reward = -lost - CHANGES * jnp.mean(moment.change**2)
    return jnp.where(moment.failed, -(1.0 + CHANGES) * (1.0 + moment.left), reward)


def _share(ratio: Float[Array, ""]) -> Float[Array, ""]:
    return ratio**2 / (1 + ratio**2)


@dataclass(frozen=True)
class Success:
    """Condition of success: the tip stays at its target for some time.

    Parameters
    ----------
    time
        Time at the target (s), 0 or more.
    position
        Largest distance from the target, over the arm's length.
    angle_deg
        Largest angle from the target direction (degrees).

    Raises
    ------
    ScenarioError
        If a number is out of range, or neither a distance nor an angle is given.
    """

    time: float
    position: float | None = None
    angle_deg: float | None = None

    def __post_init__(self) -> None:
        mistakes = [
            Mistake(f"success.{name}", got(value, f"be {least}"))
            for name, value, least, fine in (
                ("time", self.time, "at least 0 s", self.time >= 0),
                ("position", self.position, "above 0", (self.position or 0) > 0),
                ("angle_deg", self.angle_deg, "above 0 degrees", (self.angle_deg or 0) > 0),
            )
            if value is not None and not (fine and math.isfinite(value))
        ]
        if self.position is None and self.angle_deg is None:
            mistakes.append(Mistake("success", "requires a position, an angle_deg or both"))
        if mistakes:
            raise ScenarioError(mistakes)

    def near(
        self, distance: Float[Array, ""], angle: Float[Array, ""], length: Float[Array, ""]
    ) -> Bool[Array, ""]:
        """Return whether errors (m, rad) of the tip are small enough for an arm's length."""
        near = jnp.asarray(True)
        if self.position is not None:
            near &= distance <= self.position * length
        if self.angle_deg is not None:
            near &= angle <= math.radians(self.angle_deg)
        return near
