"""How loads and flows come on."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

_SLACK = 1e-9
"""Time by which round-off may make a time step late (s)."""


class Onset(eqx.Module):
    """A factor of time: 0 before ``start``, 1 once ``ramp_time`` has passed, 0 again from ``stop``.

    In between it follows half a cosine, so that what is ramped keeps a continuous rate. With no
    ramp time, and when it stops, it jumps. At the instant of a jump it is half, so that a step
    which ends there and one which begins there have the mean of their forces to order 2; what
    starts at 0 or before is whole from 0 on.
    """

    start: Float[Array, "*count"]
    """When it begins (s)."""
    ramp_time: Float[Array, "*count"]
    """How long it takes to reach 1 (s)."""
    stop: Float[Array, "*count"]
    """When it ends (s); infinite for what stays."""

    @staticmethod
    def of(
        start: float | Array = 0.0,
        ramp_time: float | Array = 0.0,
        stop: float | Array = jnp.inf,
        *,
        shape: tuple[int, ...] = (),
    ) -> "Onset":
        """Build the onset of ``shape`` windows that come on together; times in s."""
        times = (start, ramp_time, stop)
        return Onset(*(jnp.broadcast_to(jnp.asarray(time, float), shape) for time in times))

    def __call__(self, time: Float[Array, ""] | float) -> Float[Array, "*count"]:
        """Return the factor at ``time`` (s)."""
        since = time - self.start
        ramped = self.ramp_time > 0
        progress = jnp.clip(since / jnp.where(ramped, self.ramp_time, 1.0), 0.0, 1.0)
        on = jnp.where(self.start > 0, _passed(since), since >= -_SLACK)
        factor = jnp.where(ramped, 0.5 - 0.5 * jnp.cos(jnp.pi * progress), on)
        return factor * (1.0 - _passed(time - self.stop))

    def whole(self, time: Float[Array, ""] | float) -> Float[Array, "*count"]:
        """Return 1 from the start on and 0 from the stop on, for a body, which is never half."""
        there = (time >= self.start - _SLACK) & (time < self.stop - _SLACK)
        return jnp.where(there, 1.0, 0.0)

    def elapsed(self, time: Float[Array, ""] | float) -> Float[Array, "*count"]:
        """Return the integral of the factor up to ``time`` (s): how far a clock gets that it runs.

        Its first two derivatives are continuous where there is a ramp and no stop.
        """
        since = jnp.minimum(time, self.stop) - self.start
        # not `clip`, which has half the slope at its ends
        passed = jnp.where(
            since >= self.ramp_time, self.ramp_time, jnp.where(since > 0, since, 0.0)
        )
        swing = jnp.where(self.ramp_time > 0, self.ramp_time, 1.0) / jnp.pi
        ramped = 0.5 * (passed - swing * jnp.sin(passed / swing))
        return jnp.where(since >= self.ramp_time, since - 0.5 * self.ramp_time, ramped)


def _passed(since: Float[Array, "*count"]) -> Float[Array, "*count"]:
    """Return 0 before an instant, 1 after it, and half at it, by the time since then (s)."""
    return 0.5 + 0.5 * jnp.sign(jnp.where(jnp.abs(since) <= _SLACK, 0.0, since))
