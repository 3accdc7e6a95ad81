"""Onset of loads and flows in time: a cosine ramp."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

_SLACK = 1e-9  # tolerance of times for round-off (s)


class Onset(eqx.Module):
    """Factor of time: 0 before ``start``, 1 after a further ``ramp_time``, 0 again from ``stop``.

    The ramp is half a cosine, with a continuous rate. Without a ramp time, and at the stop, it
    jumps. At the instant of a jump it is 1/2, so that the steps before and after it have the mean
    of their forces to order 2; an onset at 0 or before is 1 from 0 on.

    Parameters
    ----------
    start, ramp_time, stop : array
        Start, duration of the ramp, and end (s); one for each window, or scalars.

    Examples
    --------
    >>> onset = crinoid.Onset.of(start=1.0, ramp_time=2.0)
    >>> [round(float(onset(time)), 3) for time in (1.0, 2.0, 3.0)]
    [0.0, 0.5, 1.0]
    """

    start: Float[Array, "*count"]
    ramp_time: Float[Array, "*count"]
    stop: Float[Array, "*count"]

    @staticmethod
    def of(
        start: float | Array = 0.0,
        ramp_time: float | Array = 0.0,
        stop: float | Array = jnp.inf,
        *,
        shape: tuple[int, ...] = (),
    ) -> "Onset":
        """Build the common onset of some windows.

        Parameters
        ----------
        start, ramp_time, stop : float
            Start, duration of the ramp, and end (s).
        shape : tuple of int
            Shape of the windows; of one onset by default.

        Returns
        -------
        Onset
        """
        times = (start, ramp_time, stop)
        return Onset(*(jnp.broadcast_to(jnp.asarray(time, float), shape) for time in times))

    def __call__(self, time: Float[Array, ""] | float) -> Float[Array, "*count"]:
        """Return the factor at a time.

        Parameters
        ----------
        time : float
            Time (s).

        Returns
        -------
        array
            From 0 to 1, for each window.
        """
        return self.with_rate(time)[0]

    def with_rate(self, time: Float[Array, ""] | float) -> tuple[Array, Array]:
        """Return the factor and its rate (1/s); a jump has none."""
        since = time - self.start
        ramped = self.ramp_time > 0
        turning = jnp.pi / jnp.where(ramped, self.ramp_time, 1.0)
        phase = jnp.clip(turning * since, 0.0, jnp.pi)
        on = jnp.where(self.start > 0, _unit_step(since), since >= -_SLACK)
        factor = jnp.where(ramped, 0.5 - 0.5 * jnp.cos(phase), on)
        rate = jnp.where(ramped & (phase < jnp.pi), 0.5 * turning * jnp.sin(phase), 0.0)
        there = 1.0 - _unit_step(time - self.stop)
        return factor * there, rate * there

    def whole(self, time: Float[Array, ""] | float) -> Float[Array, "*count"]:
        """Return 1 from the start to the stop, else 0: for a body, which is never half."""
        there = (time >= self.start - _SLACK) & (time < self.stop - _SLACK)
        return jnp.where(there, 1.0, 0.0)

    def elapsed(self, time: Float[Array, ""] | float) -> Float[Array, "*count"]:
        """Return the integral of the factor up to ``time`` (s).

        Its first two derivatives are continuous for a ramp without a stop.
        """
        since = jnp.minimum(time, self.stop) - self.start
        # not `clip`, which has half the slope at its ends
        passed = jnp.where(
            since >= self.ramp_time, self.ramp_time, jnp.where(since > 0, since, 0.0)
        )
        swing = jnp.where(self.ramp_time > 0, self.ramp_time, 1.0) / jnp.pi
        ramped = 0.5 * (passed - swing * jnp.sin(passed / swing))
        return jnp.where(since >= self.ramp_time, since - 0.5 * self.ramp_time, ramped)


def _unit_step(since: Float[Array, "*count"]) -> Float[Array, "*count"]:
    """Return the unit step of the time since an instant (s), 1/2 at the instant."""
    return 0.5 + 0.5 * jnp.sign(jnp.where(jnp.abs(since) <= _SLACK, 0.0, since))
