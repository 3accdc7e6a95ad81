"""A sensor: samples a measurand at a rate, with delay, noise and quantisation."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, PRNGKeyArray

from crinoid.control.clock import Clock
from crinoid.control.measurand import Measurand
from crinoid.control.seen import Reading

Values = Float[Array, " m"]


class SensorState(eqx.Module):
    """Samples taken so far, and the latest of them."""

    ticks: Int[Array, ""]
    """Number of samples taken."""
    times: Float[Array, " kept"]
    """When each kept sample was taken (s), newest last; minus infinity where there is none."""
    samples: Float[Array, "kept m"]
    """Values of the kept samples, with their errors."""


class Sensor(eqx.Module):
    """Measures at its own rate; a sample is known ``delay`` after it was taken.

    Noise is white and Gaussian, drawn anew for each sample from ``key`` and the sample's number, so
    that it depends on neither the time step nor where a run was interrupted.
    """

    name: str = eqx.field(static=True)
    """Its name in `crinoid.Seen.readings` and in results."""
    measurand: Measurand
    """Quantity that it measures."""
    clock: Clock
    """When samples are taken."""
    delay: Float[Array, ""]
    """Age of a sample when it is known (s)."""
    noise: Values
    """Standard deviation of each value, in its unit."""
    resolution: Values
    """Each value is rounded to a multiple of this; 0: it is not."""
    key: PRNGKeyArray
    """From which the noise is drawn."""
    kept: int = eqx.field(static=True)
    """How many samples can be under way at once."""

    def start(self, values: Values) -> SensorState:
        """Begin with the true values known."""
        times = jnp.full(self.kept, -jnp.inf)
        return SensorState(
            jnp.asarray(0), times, jnp.broadcast_to(values, (self.kept, values.size))
        )

    def sample(self, before: SensorState, values: Values, time: Float[Array, ""]) -> SensorState:
        """Take a sample of the true values if one is due."""
        due = self.clock.due(before.ticks, time)
        noise = jax.random.normal(jax.random.fold_in(self.key, before.ticks), values.shape)
        noisy, coarse = values + self.noise * noise, self.resolution > 0
        grain = jnp.where(coarse, self.resolution, 1.0)
        noisy = jnp.where(coarse, grain * jnp.round(noisy / grain), noisy)
        samples = jnp.roll(before.samples, -1, axis=0).at[-1].set(noisy)
        times = jnp.roll(before.times, -1).at[-1].set(time)
        return SensorState(
            before.ticks + due,
            jnp.where(due, times, before.times),
            jnp.where(due, samples, before.samples),
        )

    def reading(self, state: SensorState, time: Float[Array, ""]) -> Reading:
        """Return the newest sample that is known at ``time``; that of the start counts as new."""
        newest = self._newest(state, time)
        taken = state.times[newest]
        return Reading(state.samples[newest], jnp.where(taken >= 0, taken, time))

    def _newest(self, state: SensorState, time: Float[Array, ""]) -> Int[Array, ""]:
        slack = 1e-6 * self.clock.period
        known = jnp.sum(state.times <= time - self.delay + slack)
        # samples come in order, those of before the start count as known
        return jnp.maximum(known - 1, 0)
