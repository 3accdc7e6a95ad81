"""An observer: what the arm and the water do, as far as sensors and a linear model tell."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from crinoid.control.seen import Seen
from crinoid.control.target import pose_error
from crinoid.dynamics import numbers_of
from crinoid.products import product

Estimate = Float[Array, " z"]
Following = Float[Array, " s"]


class ObserverState(eqx.Module):
    """Estimate, and what it was made from."""

    estimate: Estimate
    """Arm, water and readings under way, all as differences."""
    actuators: Following
    """States of the actuators, less those at rest."""
    taken: Float[Array, " sensor"]
    """When the newest reading of each sensor was taken (s)."""


class Observer(eqx.Module):
    """A Kalman filter on the linear model of an arm in fluctuating water (Kalman 1960).

    What the actuators do is known from their own states, limits of speed and acceleration included,
    and not from the commands: so an input that lags behind at its limit does not mislead it. A
    reading that arrives late is compared with what was expected when it was taken. Each sensor
    counts at those calls only at which it has a new reading; for every set of sensors
    that do so at once there is a gain.
    """

    move: Float[Array, "z z"]
    """Estimate after a period, by that before."""
    held: Float[Array, "z s"]
    """And by the actuators before."""
    driven: Float[Array, "z s"]
    """And by the actuators after it."""
    expect: Float[Array, "y z"]
    """Expected readings by the estimate."""
    follow: Float[Array, "y s"]
    """And by the actuators."""
    gains: Float[Array, "set z y"]
    """Gain for each set of sensors with new readings."""
    fresh: Int[Array, "set sensor"]
    """Which sensors are in a set (0, 1)."""
    values: Float[Array, " y"]
    """Readings where the model is linear about."""
    at_rest: Following
    """States of the actuators there."""
    kept: tuple[int, ...] = eqx.field(static=True)
    """Which of the numbers in the states of all actuators count."""
    sensors: tuple[str, ...] = eqx.field(static=True)
    """Names of the sensors beside that of the tip."""

    def start(self, seen: Seen) -> ObserverState:
        """Begin with the arm that the model is linear about."""
        none = jnp.full(len(self.sensors) + 1, -jnp.inf)
        return ObserverState(jnp.zeros(self.move.shape[0]), self._actuators(seen), none)

    def update(
        self, before: ObserverState, seen: Seen, pushed: Estimate | None = None
    ) -> ObserverState:
        """Return the estimate at the next call, a period later.

        ``pushed`` is what else is known to have changed it meanwhile.
        """
        actuators = self._actuators(seen)
        first = jnp.all(before.taken == -jnp.inf)
        moved = (
            product(self.move, before.estimate)
            + product(self.held, before.actuators)
            + product(self.driven, actuators)
        )
        if pushed is not None:
            moved += pushed
        estimate = jnp.where(first, before.estimate, moved)
        others = [seen.readings[name] for name in self.sensors]
        taken = jnp.stack([seen.taken, *(each.taken for each in others)])
        fresh = (taken > before.taken).astype(int)
        chosen = jnp.all(self.fresh == fresh, axis=1)
        read = jnp.concatenate(
            [
                pose_error(seen.measured, self.values[: seen.measured.size]),
                *(each.value for each in others),
            ]
        )
        read = read.at[seen.measured.size :].add(-self.values[seen.measured.size :])
        surprise = read - product(self.expect, estimate) - product(self.follow, actuators)
        gain = jnp.sum(jnp.where(chosen[:, None, None], self.gains, 0.0), axis=0)
        return ObserverState(estimate + product(gain, surprise), actuators, taken)

    def _actuators(self, seen: Seen) -> Following:
        numbers, _ = numbers_of(seen.actuators)
        return numbers[jnp.asarray(self.kept, int)] - self.at_rest
