"""The sensor of the tip: samples at a rate, with delay and noise."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, PRNGKeyArray

from crinoid.control.clock import Clock

Pose = Float[Array, " pose"]


class SensorState(eqx.Module):
    """Samples taken so far, and the latest of them."""

    ticks: Int[Array, ""]
    times: Float[Array, " kept"]
    """When each kept sample was taken (s), newest last; minus infinity where there is none."""
    samples: Float[Array, "kept pose"]


class Sensor(eqx.Module):
    """Measures the tip's pose at its own rate; a sample is known ``delay`` after it was taken.

    Noise is white and Gaussian, drawn anew for each sample from ``key`` and the sample's number, so
    that it depends on neither the time step nor where a run was interrupted.
    """

    clock: Clock
    delay: Float[Array, ""]
    noise: Pose
    """Standard deviation of each coordinate (m, and rad in the plane)."""
    key: PRNGKeyArray
    kept: int = eqx.field(static=True)
    """How many samples can be under way at once."""

    def start(self, pose: Pose) -> SensorState:
        """Begin with the tip known to be where it is."""
        times = jnp.full(self.kept, -jnp.inf)
        return SensorState(jnp.asarray(0), times, jnp.broadcast_to(pose, (self.kept, pose.size)))

    def sample(self, state: SensorState, pose: Pose, time: Float[Array, ""]) -> SensorState:
        """Take a sample if one is due."""
        due = self.clock.due(state.ticks, time)
        noise = jax.random.normal(jax.random.fold_in(self.key, state.ticks), pose.shape)
        samples = jnp.roll(state.samples, -1, axis=0).at[-1].set(pose + self.noise * noise)
        times = jnp.roll(state.times, -1).at[-1].set(time)
        return SensorState(
            state.ticks + due,
            jnp.where(due, times, state.times),
            jnp.where(due, samples, state.samples),
        )

    def reading(self, state: SensorState, time: Float[Array, ""]) -> Pose:
        """Return the newest sample that is known at ``time``."""
        return state.samples[self._newest(state, time)]

    def taken(self, state: SensorState, time: Float[Array, ""]) -> Float[Array, ""]:
        """Return when the reading at ``time`` was taken; ``time`` where it is that of the start."""
        taken = state.times[self._newest(state, time)]
        return jnp.where(taken >= 0, taken, time)

    def _newest(self, state: SensorState, time: Float[Array, ""]) -> Int[Array, ""]:
        slack = 1e-6 * self.clock.period
        known = jnp.sum(state.times <= time - self.delay + slack)
        # samples come in order, those of before the start count as known
        return jnp.maximum(known - 1, 0)
