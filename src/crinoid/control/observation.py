"""The numbers that a learned controller observes, one behind the other."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from crinoid.actuation import Actuator, drives
from crinoid.control.seen import Seen
from crinoid.control.target import pose_error

AHEAD = 0.5
"""How far ahead the way of a target is told (s)."""


class Observation(eqx.Module):
    """Makes a flat array of what a controller sees; ``crinoid.assembly.observables`` names it."""

    actuators: tuple[Actuator, ...]
    """The actuators beside the servos of the base."""
    period: Float[Array, ""]
    """Time between two commands (s)."""
    axes: int = eqx.field(static=True)
    driven: tuple[int, ...] = eqx.field(static=True)
    """Which inputs can move."""
    servos: tuple[int, ...] = eqx.field(static=True)
    """Which of them are channels of the base."""
    carried: tuple[int, ...] = eqx.field(static=True)
    """Channels of the base that a prescribed motion moves."""
    ahead: bool = eqx.field(static=True)
    """Whether the target moves."""

    def __call__(self, seen: Seen, before: Float[Array, " pose"]) -> Float[Array, " entry"]:
        """Return the numbers.

        Parameters
        ----------
        seen
            What a controller sees of the closed loop.
        before
            Pose of the tip that it saw a control period before.
        """
        servo, *others = seen.actuators
        error = pose_error(seen.wanted, seen.measured)
        pointing = error[self.axes :]
        if self.axes == 2:
            pointing = jnp.concatenate([jnp.sin(pointing), jnp.cos(pointing)])
        rows = np.array(self.servos, int)
        parts = [
            error[: self.axes],
            pointing,
            pose_error(seen.measured, before) / self.period,
            servo.position[rows],
            servo.velocity[rows],
            seen.base[np.array(self.carried, int)],
            drives(self.actuators, others),
            seen.command[np.array(self.driven)],
            *(reading.value for reading in seen.readings.values()),
        ]
        if self.ahead:
            now, later = (seen.target.in_frame(seen.time + after) for after in (0.0, AHEAD))
            parts.append((later - now)[: self.axes])
        return jnp.concatenate([part for part in parts if part is not None])
