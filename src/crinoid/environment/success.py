"""When a task is done."""

from __future__ import annotations

import math
from dataclasses import dataclass

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from crinoid.scenario import Mistake, ScenarioError


@dataclass(frozen=True)
class Success:
    """The tip stays at its target for some time.

    Parameters
    ----------
    time
        For how long (s), 0 or more.
    position
        How far from the target it may be, as a share of the arm's length.
    angle_deg
        How far from where it should point it may point (degrees).

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
            Mistake(f"success.{name}", f"got {value!r}, takes {least}")
            for name, value, least, fine in (
                ("time", self.time, "seconds of 0 or more", self.time >= 0),
                ("position", self.position, "a share above 0", (self.position or 0) > 0),
                ("angle_deg", self.angle_deg, "degrees above 0", (self.angle_deg or 0) > 0),
            )
            if value is not None and not (fine and math.isfinite(value))
        ]
        if self.position is None and self.angle_deg is None:
            mistakes.append(Mistake("success", "takes a position, an angle_deg or both"))
        if mistakes:
            raise ScenarioError(mistakes)

    def near(
        self, distance: Float[Array, ""], angle: Float[Array, ""], length: Float[Array, ""]
    ) -> Bool[Array, ""]:
        """Return whether the tip is near enough, by its errors (m, rad) and the arm's length."""
        near = jnp.asarray(True)
        if self.position is not None:
            near &= distance <= self.position * length
        if self.angle_deg is not None:
            near &= angle <= math.radians(self.angle_deg)
        return near
