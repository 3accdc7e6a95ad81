"""What a flow is, and how flows add up."""

from abc import abstractmethod

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.flow.current import Current
from crinoid.flow.jet import Jet
from crinoid.onset import Onset

Point = Float[Array, " b"]
Time = Float[Array, ""]


class Flow(eqx.Module):
    """A model of a current: a velocity field that can be differentiated twice."""

    onset: eqx.AbstractVar[Onset]

    @abstractmethod
    def fully_on(self, point: Point, time: Time) -> Point:
        """Return the velocity (m/s) at a point (m) and a time (s), its onset aside."""

    def fully_on_jet(self, point: Point, time: Time) -> Jet:
        """Return the same with its derivatives; a flow may know them in a cheaper form."""
        return Jet.of(self.fully_on, point, time)

    def velocity(self, point: Point, time: Time) -> Point:
        """Return the velocity (m/s) at a point (m) and a time (s)."""
        return self.onset(time) * self.fully_on(point, time)

    def jet(self, point: Point, time: Time) -> Jet:
        """Return the velocity at a point (m) and a time (s) with its derivatives."""
        onset = jax.jvp(self.onset, (time,), (jnp.ones_like(time),))
        return self.fully_on_jet(point, time).times(*onset)


class Everywhere(Flow):
    """A flow that is the same everywhere: a velocity of time alone."""

    @abstractmethod
    def at(self, time: Time) -> Point:
        """Return the velocity (m/s) at a time (s), its onset aside."""

    def fully_on(self, point: Point, time: Time) -> Point:
        return self.at(time)

    def jet(self, point: Point, time: Time) -> Jet:
        moving = jax.jvp(lambda t: self.velocity(point, t), (time,), (jnp.ones_like(time),))
        return Jet.everywhere(*moving)


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

    def current(self, point: Point, time: Time) -> Current:
        """Return velocity, material acceleration and how both change with the place, at once."""
        time = jnp.asarray(time if self.frozen_at is None else self.frozen_at, float)
        jets = (flow.jet(point, time) for flow in self.flows)
        still = jnp.zeros_like(point)
        together = sum(jets, Jet.everywhere(still, still))
        return Current.of(together, steady=self.frozen_at is not None)
