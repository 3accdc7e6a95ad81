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
        noisy = values + _errors(self.noise, self.key, before.ticks)
        coarse = self.resolution > 0
        grain = jnp.where(coarse, self.resolution, 1.0)
        noisy = jnp.where(coarse, grain * jnp.round(noisy / grain), noisy)
        samples = jnp.concatenate([before.samples[1:], noisy[None]])
        times = jnp.append(before.times[1:], time)
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


@jax.custom_jvp
def _errors(noise: Values, key: PRNGKeyArray, sample: Int[Array, ""]) -> Values:
    """Return the errors of a sample; drawing them takes long, and most sensors have none."""
    return jax.lax.cond(
        jnp.any(noise != 0),
        lambda: noise * _drawn(noise, key, sample),
        lambda: jnp.zeros_like(noise),
    )


# they follow the noise where there is none, too
_errors.defjvps(lambda change, _, *given: change * _drawn(*given), None, None)


def _drawn(noise: Values, key: PRNGKeyArray, sample: Int[Array, ""]) -> Values:
    return jax.random.normal(jax.random.fold_in(key, sample), noise.shape)
