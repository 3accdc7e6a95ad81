"""What a flow is, and how flows add up."""

from abc import abstractmethod

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.onset import Onset

Point = Float[Array, " b"]
Time = Float[Array, ""]


class Flow(eqx.Module):
    """A model of a current: a velocity field that can be differentiated in place and time."""

    onset: eqx.AbstractVar[Onset]

    @abstractmethod
    def fully_on(self, point: Point, time: Time) -> Point:
        """Return the velocity (m/s) at a point (m) and a time (s), its onset aside."""

    def velocity(self, point: Point, time: Time) -> Point:
        """Return the velocity (m/s) at a point (m) and a time (s)."""
        return self.onset(time) * self.fully_on(point, time)


class Water(eqx.Module):
    """All flows together: velocities add up; the acceleration is that of their sum.

    ``Du/Dt = du/dt + (u . grad) u`` is not the sum of the flows' own accelerations: each flow is
    carried along by the others.
    """

    flows: tuple[Flow, ...]
    frozen_at: Time | None = None
    """A time (s) at which the flow stands still, for statics: du/dt is then zero."""

    def velocity(self, point: Point, time: Time) -> Point:
        """Return the velocity (m/s)."""
        time = time if self.frozen_at is None else self.frozen_at
        return sum((flow.velocity(point, time) for flow in self.flows), jnp.zeros_like(point))

    def acceleration(self, point: Point, time: Time) -> Point:
        """Return the material acceleration Du/Dt (m/s2), exact by forward differentiation."""
        return self.velocity_and_acceleration(point, time)[1]

    def velocity_and_acceleration(self, point: Point, time: Time) -> tuple[Point, Point]:
        """Return velocity (m/s) and material acceleration (m/s2) in one pass."""
        time = jnp.asarray(time, float)
        velocity = self.velocity(point, time)
        return jax.jvp(self.velocity, (point, time), (velocity, jnp.ones_like(time)))
