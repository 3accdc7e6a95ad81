"""A target that is dragged about."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from crinoid.assembly.numbers import array
from crinoid.control.target import Pose, Target, Time

__all__ = ["Shifted", "shift_to"]


class Shifted(Target):
    """A target, or its whole path, beside where the scenario has it."""

    shift: Float[Array, " d"] | None = None
    """How far, in the target's own frame (m)."""

    @staticmethod
    def of(target: Target, axes: int) -> "Shifted":
        """Return a target that can be shifted, and is not yet."""
        none = array(np.zeros(axes))
        return Shifted(target.fixed, target.path, target.moving, target.carrier, none)

    def in_frame(self, time: Time) -> Pose:
        """Return the wanted pose at ``time`` (s), in the frame of the target."""
        assert self.shift is not None
        return super().in_frame(time).at[: self.shift.shape[0]].add(self.shift)


def shift_to(
    target: Shifted, place: Float[np.ndarray, " d"], time: float
) -> Float[np.ndarray, " d"]:
    """Return the shift by which a target is at a place in the world (m) at a time (s)."""
    assert target.shift is not None
    axes, now = target.shift.shape[0], jnp.asarray(time, float)
    there = target.seen(target(now).at[:axes].set(place), now)
    return np.asarray(target.shift + (there - target.in_frame(now))[:axes])
